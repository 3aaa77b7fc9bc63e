"""Compute extinction, sky and light from an authored weather."""
