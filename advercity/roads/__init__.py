"""advercity.roads."""
