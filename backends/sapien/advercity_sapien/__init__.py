"""SAPIEN rendering backend of advercity."""

from advercity_sapien.backend import SapienBackend

__all__ = ["SapienBackend"]
