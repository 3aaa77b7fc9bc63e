"""Validates metadata with mlcroissant, and loads the records that they describe."""

import json
import sys
import warnings

import mlcroissant as mlc  # pyright: ignore[reportMissingImports]

with warnings.catch_warnings(record=True):
    dataset = mlc.Dataset(f"{sys.argv[1]}/croissant.json")
issues = dataset.metadata.ctx.issues
frames = list(dataset.records("frames"))
objects = list(dataset.records("objects"))


def plain(record):  # pyright: ignore[reportMissingParameterType, reportUnknownParameterType]
    """Convert a record to plain types."""
    return {
        name.partition("/")[2]: value.decode() if isinstance(value, bytes) else value
        for name, value in record.items()
    }


print(
    json.dumps(
        {
            "errors": sorted(issues.errors),
            "warnings": sorted(issues.warnings),
            "frames": len(frames),
            "objects": len(objects),
            "first_frame": plain(frames[0]),
            "first_object": plain(objects[0]),
        },
        default=float,
    )
)
