"""The pipeline over frames and scenarios."""
