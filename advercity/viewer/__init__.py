"""Live views and recordings of a run in Rerun."""
