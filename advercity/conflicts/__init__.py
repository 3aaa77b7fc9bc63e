"""Staged conflicts: solve them for a road, schedule their actors and measure the outcome.

At compile time `binding` matches a declared conflict to a road, `solver` places its actors and
`checks` finds what rules it out. At run time `schedule` times the actors by dry runs of the
traffic. `metrics` and `report` measure the outcome on the trace alone.
"""
