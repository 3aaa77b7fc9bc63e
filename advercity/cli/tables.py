"""Formats rows and facts as text or JSON."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from advercity.pipeline.descriptions import Description


def format_columns(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows below their heads, numbers aligned to the right."""
    heads = list(rows[0])
    widths = [max(len(head), *(len(str(row[head])) for row in rows)) for head in heads]
    lines = [dict(zip(heads, heads, strict=True)), *rows]
    numbers = [isinstance(rows[0][head], int | float) for head in heads]
    cells = zip(heads, widths, numbers, strict=True)
    columns = [
        [f"{line[head]!s:>{width}}" if number else f"{line[head]!s:<{width}}" for line in lines]
        for head, width, number in cells
    ]
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def format_json(data: Any) -> str:
    """Format data for programs."""
    return json.dumps(data, indent=2, ensure_ascii=False)


def format_facts(facts: Description) -> str:
    """Format one line per fact."""
    width = max(len(name) for name in facts)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in facts.items())
