"""advercity.geometry."""
