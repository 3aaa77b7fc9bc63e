"""Formats that datasets are exported to, each an entry point of `advercity.exports`."""
