"""Exports of datasets: formats by name, and the folders they are written to."""
