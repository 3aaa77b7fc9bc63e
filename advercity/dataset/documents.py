"""YAML and JSON as datasets hold them: plain types, rounded numbers, no anchors, no times."""

import json
import math
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike


def plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Python floats, rounded; zero without a sign."""
    if isinstance(values, float):
        # As NumPy rounds, at a tenth of what it takes for a single number.
        scale = 10.0**decimals
        scaled = values * scale
        return round(scaled) / scale if math.isfinite(scaled) else values
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


def yaml_bytes(document: dict[str, Any]) -> bytes:
    """A document in the order of its keys, lists of numbers on one line."""
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=200)
    return text.encode()


def json_bytes(document: dict[str, Any]) -> bytes:
    """A document in the order of its keys, without blanks."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode() + b"\n"


class _Dumper(yaml.CSafeDumper):
    """Plain YAML without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True
