"""Bakes images of materials: colour, relief and gloss of a square tile without visible seams."""
