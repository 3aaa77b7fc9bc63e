"""YAML and JSON as datasets hold them: plain types, rounded numbers, no anchors, no times."""

import json
import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

UNLIMITED = 2**30
"""Width of lines."""


def plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Python floats, rounded; zero without a sign. Short vectors are quickest as tuples."""
    if isinstance(values, float):
        # As NumPy rounds, at a tenth of what it takes for a single number.
        scale = 10.0**decimals
        scaled = values * scale
        return round(scaled) / scale if math.isfinite(scaled) else values
    if isinstance(values, tuple):
        return [plain(value, decimals=decimals) for value in values]
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


def yaml_bytes(document: Mapping[Any, Any]) -> bytes:
    """A document in the order of its keys; what holds nothing but scalars is on one line.

    PyYAML, which only tells how texts are quoted here, takes six times as long for it all.
    """
    lines: list[str] = []
    if _is_one_line(document):
        lines.append(_line(document))
    else:
        _add_lines(lines, document, "")
    return "\n".join([*lines, ""]).encode()


def json_bytes(document: dict[str, Any]) -> bytes:
    """A document in the order of its keys, without blanks."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _add_lines(lines: list[str], value: Any, indent: str) -> None:
    """Of a mapping or list that takes several."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if _is_one_line(item):
                lines.append(f"{indent}{_scalar(key)}: {_line(item)}")
            else:
                lines.append(f"{indent}{_scalar(key)}:")
                _add_lines(lines, item, f"{indent}  " if isinstance(item, Mapping) else indent)
        return
    for item in value:
        if _is_one_line(item):
            lines.append(f"{indent}- {_line(item)}")
        else:
            first = len(lines)
            _add_lines(lines, item, f"{indent}  ")
            lines[first] = f"{indent}- {lines[first][len(indent) + 2 :]}"


def _is_one_line(value: Any) -> bool:
    inside: Iterable[Any] = ()
    if isinstance(value, Mapping):
        inside = value.values()
    elif isinstance(value, list | tuple):
        inside = value
    return not any(isinstance(item, Mapping | list | tuple) for item in inside)


def _line(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join([f'{_scalar(k)}: {_inside(v)}' for k, v in value.items()])}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inside, value))}]"
    return _scalar(value)


def _inside(value: Any) -> str:
    """A scalar between brackets, where commas part."""
    return _scalar(value, inside=True)


def _scalar(value: Any, *, inside: bool = False) -> str:
    if isinstance(value, float):
        text = repr(value)
        return _by_pyyaml(value) if "e" in text or "n" in text else text
    if isinstance(value, str):
        return _by_pyyaml(value, inside=inside)
    return json.dumps(value)


@lru_cache(maxsize=4096)
def _by_pyyaml(value: str | float, *, inside: bool = False) -> str:
    several_lines = isinstance(value, str) and "\n" in value
    text: str = yaml.dump(
        [value],
        Dumper=yaml.CSafeDumper,
        default_flow_style=inside,
        default_style='"' if several_lines else None,
        width=UNLIMITED,
    )
    return text[1:-2] if inside else text[2:-1]
