"""Background traffic, connected vehicles and pedestrians, simulated by SUMO into a trace.

`simulation` is the entry: it starts `sumo_worker` as a child process, which draws the demand,
repeats dry runs until all staged conflicts happen, and writes the trace.
"""
