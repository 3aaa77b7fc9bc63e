"""Values over time, given at some moments and interpolated in between."""

import math
import operator
from collections.abc import Iterator, Sequence
from typing import Any

from advercity_dsl.base import Model, ValuePath

Track = Sequence[tuple[float, Any]]
"""Values at moments in seconds, in order of time."""


def iterate_written_values(model: Model) -> Iterator[tuple[ValuePath, Any]]:
    """Yield path and value of every written field of a model, without its defaults."""
    for name in type(model).model_fields:
        if name not in model.model_fields_set:
            continue
        value = getattr(model, name)
        if isinstance(value, Model):
            yield from (((name, *path), inner) for path, inner in iterate_written_values(value))
        else:
            yield (name,), value


def get_value(model: Model, path: ValuePath) -> Any:
    """Get the value at a path."""
    for name in path:
        model = getattr(model, str(name))
    return model


def replace_value(model: Model, path: ValuePath, value: Any) -> Any:
    """Copy a model with another value at a path, which is not validated."""
    if not path:
        return value
    name = str(path[0])
    return model.model_copy(update={name: replace_value(getattr(model, name), path[1:], value)})


def interpolate_track(name: str, track: Track, time_s: float) -> Any:
    """Compute the value of a field at a time; before and after the track it is constant.

    Visibilities (`mor_m`) are interpolated by their reciprocals, to which extinction is
    proportional, so `None` is a reciprocal of 0; directions (`from_deg`) turn the shorter way; all
    other numbers are linear. Values other than numbers change at once.
    """
    later = next((index for index, (at_s, _) in enumerate(track) if at_s > time_s), len(track))
    if later in (0, len(track)):
        return track[min(later, len(track) - 1)][1]
    (from_s, before), (to_s, after) = track[later - 1], track[later]
    fraction = (time_s - from_s) / (to_s - from_s)
    if name == "mor_m":
        return _interpolate_visibility(before, after, fraction)
    if not (is_number(before) and is_number(after)):
        return before
    step = math.remainder(after - before, 360.0) if name == "from_deg" else after - before
    return before + step * fraction


def is_number(value: Any) -> bool:
    """Return whether a value is a number rather than a flag, a text or nothing."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _interpolate_visibility(
    before: float | None, after: float | None, fraction: float
) -> float | None:
    if before == after:
        return before  # without a rounding error
    start, end = (1.0 / mor_m if mor_m else 0.0 for mor_m in (before, after))
    reciprocal = start + (end - start) * fraction
    return 1.0 / reciprocal if reciprocal else None


def interpolate_direction(
    before_deg: tuple[float, float], after_deg: tuple[float, float], fraction: float
) -> tuple[float, float]:
    """Interpolate between two directions, elevation and azimuth in degrees, along the great circle.

    Between opposite directions, where every circle is as great, both angles are linear.
    """
    start, end = (_to_unit_vector(*direction) for direction in (before_deg, after_deg))
    angle = math.acos(max(-1.0, min(1.0, sum(map(operator.mul, start, end)))))
    if angle < 1e-9 or math.pi - angle < 1e-6:
        linear = (a + (b - a) * fraction for a, b in zip(before_deg, after_deg, strict=True))
        return next(linear), next(linear)
    weights = math.sin((1.0 - fraction) * angle), math.sin(fraction * angle)
    east, north, up = (
        (weights[0] * a + weights[1] * b) / math.sin(angle) for a, b in zip(start, end, strict=True)
    )
    elevation = math.degrees(math.atan2(up, math.hypot(east, north)))
    return elevation, math.degrees(math.atan2(east, north)) % 360.0


def _to_unit_vector(elevation_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    elevation, azimuth = math.radians(elevation_deg), math.radians(azimuth_deg)
    level = math.cos(elevation)
    return level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)
