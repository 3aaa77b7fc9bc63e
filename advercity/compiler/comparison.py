"""What differs between two specs, field by field."""

from typing import Any, cast

from advercity_dsl import Spec

LEFT_OUT = ("provenance",)
"""Says where a spec comes from, not what it is."""


def leaves(data: Any, path: str = "") -> dict[str, Any]:
    """Every value of nested data that is no mapping or list, by its dotted path."""
    if isinstance(data, dict) and data:
        items = cast(dict[str, Any], data).items()
    elif isinstance(data, list) and data:
        items = enumerate(cast(list[Any], data))
    else:
        return {path: data}
    found: dict[str, Any] = {}
    for key, value in items:
        found |= leaves(value, f"{path}.{key}" if path else str(key))
    return found


def compared(first: Spec, second: Spec) -> list[tuple[str, Any, Any]]:
    """Path and both values of every field that differs; None where one has none."""
    one, other = (
        leaves(spec.model_dump(mode="json", exclude=set(LEFT_OUT))) for spec in (first, second)
    )
    paths = [*one, *(path for path in other if path not in one)]
    return [
        (path, one.get(path), other.get(path))
        for path in paths
        if path not in one or path not in other or one[path] != other[path]
    ]
