"""YAML and JSON of documents of plain types and rounded numbers."""

import json
import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

UNLIMITED_LINE_WIDTH = 2**30
"""Line width at which PyYAML never folds a text."""


def to_plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Convert numbers to rounded Python floats, zeros to +0.0; short vectors go best as tuples."""
    if isinstance(values, float):
        # Rounds as `np.round` does, which takes ten times as long for a single number. `round`
        # returns an int, and so loses the sign of zero.
        scale = 10.0**decimals
        scaled = values * scale
        return round(scaled) / scale if math.isfinite(scaled) else values
    if isinstance(values, tuple):
        return [to_plain(value, decimals=decimals) for value in values]
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


def format_yaml(document: Mapping[Any, Any]) -> bytes:
    """Format a document in the order of its keys; collections of scalars are on one line.

    PyYAML takes six times as long for a whole document; here it only quotes texts.
    """
    lines: list[str] = []
    if _is_one_line(document):
        lines.append(_format_line(document))
    else:
        _append_lines(lines, document, "")
    return "\n".join([*lines, ""]).encode()


def format_json(document: dict[str, Any]) -> bytes:
    """Format a document in the order of its keys, without blanks."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _append_lines(lines: list[str], value: Any, indent: str) -> None:
    if isinstance(value, Mapping):
        for key, item in value.items():
            if _is_one_line(item):
                lines.append(f"{indent}{_format_scalar(key)}: {_format_line(item)}")
            else:
                lines.append(f"{indent}{_format_scalar(key)}:")
                _append_lines(lines, item, f"{indent}  " if isinstance(item, Mapping) else indent)
        return
    for item in value:
        if _is_one_line(item):
            lines.append(f"{indent}- {_format_line(item)}")
        else:
            first = len(lines)
            _append_lines(lines, item, f"{indent}  ")
            lines[first] = f"{indent}- {lines[first][len(indent) + 2 :]}"


def _is_one_line(value: Any) -> bool:
    inside: Iterable[Any] = ()
    if isinstance(value, Mapping):
        inside = value.values()
    elif isinstance(value, list | tuple):
        inside = value
    return not any(isinstance(item, Mapping | list | tuple) for item in inside)


def _format_line(value: Any) -> str:
    if isinstance(value, Mapping):
        items = [f"{_format_scalar(k)}: {_format_flow_item(v)}" for k, v in value.items()]
        return f"{{{', '.join(items)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_format_flow_item, value))}]"
    return _format_scalar(value)


def _format_flow_item(value: Any) -> str:
    """Format a scalar inside brackets, where a text with a comma needs quotes."""
    return _format_scalar(value, inside=True)


def _format_scalar(value: Any, *, inside: bool = False) -> str:
    if isinstance(value, float):
        text = repr(value)
        # YAML 1.1 reads `1e-09` as a text, and writes `.nan` and `.inf`: PyYAML knows how.
        return _format_with_pyyaml(value) if "e" in text or "n" in text else text
    if isinstance(value, str):
        return _format_with_pyyaml(value, inside=inside)
    return json.dumps(value)


# Texts repeat from frame to frame: classes, blueprints, keys.
@lru_cache(maxsize=4096)
def _format_with_pyyaml(value: str | float, *, inside: bool = False) -> str:
    is_multiline = isinstance(value, str) and "\n" in value
    text: str = yaml.dump(
        [value],
        Dumper=yaml.CSafeDumper,
        default_flow_style=inside,
        default_style='"' if is_multiline else None,
        width=UNLIMITED_LINE_WIDTH,
    )
    return text[1:-2] if inside else text[2:-1]  # `[x]\n` or `- x\n`
