"""Recorded trajectories of others: tables and scenarios that are read, and the table they become.

`track_file` has the table that a road names and a spec contains; `recorded_tables` and
`openscenario` read what others wrote.
"""
