"""Runs of advercity on clusters of machines."""
