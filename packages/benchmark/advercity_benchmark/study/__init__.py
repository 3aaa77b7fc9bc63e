"""How far generated recordings are from real ones: pictures by features, LiDAR by statistics."""
