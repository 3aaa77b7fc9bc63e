"""3-D models that bodies are made of: where they come from, and how they are made fit.

What actors look like: plain bodies made to the size of their blueprint.
"""
