"""Traffic on SUMO, and the trace it leaves."""
