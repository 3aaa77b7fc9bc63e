"""One self-contained page about a dataset."""
