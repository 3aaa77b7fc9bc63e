"""Sensors in the data of a rig, which are not validated yet."""

from collections.abc import Iterator
from typing import Any, cast

from advercity_dsl.base import ValuePath

CARRIERS = ("vehicle", "roadside_unit")


def iterate_sensors(data: Any, kind: str) -> Iterator[tuple[ValuePath, dict[str, Any]]]:
    """Yield the path and data of every sensor of a kind, such as `lidar`, of all carriers."""
    for carrier in CARRIERS:
        sensors = _get_mapping(data, carrier)
        more = _get_mapping(sensors, f"more_{kind}s")
        yield (carrier, kind), _get_mapping(sensors, kind)
        yield from (((carrier, f"more_{kind}s", name), _get_mapping(more, name)) for name in more)


def _get_mapping(data: Any, key: str) -> dict[str, Any]:
    value = cast(dict[str, Any], data).get(key) if isinstance(data, dict) else None
    return cast(dict[str, Any], value) if isinstance(value, dict) else {}
