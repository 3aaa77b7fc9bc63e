"""OpenSCENARIO XML 1.x: the scenario is played, and the motion of its actors becomes tracks.

`scenario` reads a file; `storyboard`, `actions`, `conditions`, `positions` and `trajectories` parse
its parts into functions of a `Stage`, and `player` calls them step by step.
"""
