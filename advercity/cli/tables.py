"""Formats rows and facts as text or JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from advercity.errors import escape_control_characters
from advercity.pipeline.descriptions import Description

MAX_WIDTH = 100
"""Width of a table of figures in characters."""


def format_columns(rows: Sequence[Mapping[str, Any]], *, max_width: float = math.inf) -> str:
    """Format rows below their heads, numbers aligned to the right, without empty columns.

    Columns beyond a width follow below, next to the first one again.
    """
    heads = [head for head in rows[0] if any(row[head] != "" for row in rows)]
    first, *others = (_format_column(head, [row[head] for row in rows]) for head in heads)
    parts = [[first]]
    for column in others:
        if len(parts[-1]) > 1 and _measure_width([*parts[-1], column]) > max_width:
            parts.append([first])
        parts[-1].append(column)
    return "\n\n".join(map(_join_columns, parts))


def _measure_width(columns: Sequence[Sequence[str]]) -> int:
    return len("  ".join(column[0] for column in columns))


def _join_columns(columns: Sequence[Sequence[str]]) -> str:
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def _format_column(head: str, values: Sequence[Any]) -> list[str]:
    cells = [head, *(escape_control_characters(str(value)) for value in values)]
    width = max(map(len, cells))
    align = ">" if isinstance(values[0], int | float) else "<"
    return [f"{cell:{align}{width}}" for cell in cells]


def format_json(data: Any) -> str:
    """Format data for programs."""
    return json.dumps(data, indent=2, ensure_ascii=False)


def format_facts(facts: Description) -> str:
    """Format one line per fact."""
    escape = escape_control_characters
    escaped = {escape(name): escape(value) for name, value in facts.items()}
    width = max(map(len, escaped))
    return "\n".join(f"{name:<{width}}  {value}" for name, value in escaped.items())
