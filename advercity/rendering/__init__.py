"""The seam to renderers, the registry of backends, and ray casting."""
