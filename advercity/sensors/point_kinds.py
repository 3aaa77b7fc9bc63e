"""Kinds of points for parts of the weather, from advercity and other distributions."""

from collections.abc import Mapping
from functools import cache

from advercity_dsl.weather_parts import load_weather_parts

from advercity.sensors.measurements import PointKind


def find_point_kind(name: str) -> int:
    """Find the kind of the points of a part of the weather, by its name."""
    own = load_weather_parts().found[name].point_kind
    return PointKind[name.upper()] if own is None else own


@cache
def list_point_kinds() -> Mapping[int, str]:
    """List the names of all kinds of points by their values, with parts of other distributions."""
    others = load_weather_parts().found.values()
    own = {part.point_kind: part.name for part in others if part.point_kind is not None}
    return {kind.value: kind.name.lower() for kind in PointKind} | own
