"""The live view and recordings in Rerun."""
