"""Poses, polylines, plane curves and triangle meshes, independent of roads and sensors."""
