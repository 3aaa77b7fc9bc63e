"""Poses, polylines, plane curves and triangle meshes; knows nothing of roads or sensors."""
