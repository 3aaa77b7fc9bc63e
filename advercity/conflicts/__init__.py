"""Staged conflicts: solving them for a road, scheduling their actors, and measuring the outcome.

At compile time `binding` matches a declared conflict to a road, `solver` places its actors and
`checks` says whether it can happen. At run time `schedule` times the actors by dry runs of the
traffic. `metrics` and `report` measure what happened, from the trace alone.
"""
