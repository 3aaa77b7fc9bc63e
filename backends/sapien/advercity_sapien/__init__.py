"""SAPIEN rendering backend of advercity."""
