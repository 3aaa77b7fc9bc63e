"""Bakes images of materials: colour, relief and gloss of a square that repeats without a seam."""
