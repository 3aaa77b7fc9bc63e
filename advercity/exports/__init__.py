"""Exports of datasets to other formats: `advercity export`."""
