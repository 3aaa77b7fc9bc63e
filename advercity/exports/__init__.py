"""Datasets in the formats of others: `advercity export`."""
