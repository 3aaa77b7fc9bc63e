"""Load the parts of the weather of this installation: advercity's, then other packages'.

Another distribution registers its `WeatherPart`, under the part's name, as an entry point of the
group `advercity.weather_parts`.
"""

from collections.abc import Mapping
from functools import cache, partial
from operator import eq
from typing import Any

from pydantic import Field

from advercity_dsl.registry import Registered, check_model, load_registered
from advercity_dsl.weather_components import Air, Dust, Fog, Hail, Rain, Snow, WeatherComponent
from advercity_dsl.weather_part import OTHERS_POINT_KINDS, WeatherPart

_PHYSICS = "advercity.physics.weather_parts"
# Floating-point sums depend on their order, and datasets hold the digits of this one.
CORE_PARTS = {
    part.name: part
    for part in (
        WeatherPart("air", Air, f"{_PHYSICS}.haze:PHYSICS"),
        WeatherPart("fog", Fog, f"{_PHYSICS}.fog:PHYSICS", (90, 170, 255)),
        WeatherPart("rain", Rain, f"{_PHYSICS}.rain:PHYSICS", (60, 90, 255)),
        WeatherPart("snow", Snow, f"{_PHYSICS}.snow:PHYSICS", (255, 255, 255)),
        WeatherPart("dust", Dust, f"{_PHYSICS}.dust:PHYSICS", (222, 170, 90)),
        WeatherPart("hail", Hail, f"{_PHYSICS}.hail:PHYSICS", (190, 255, 255)),
    )
}
"""The parts of advercity by name, in the order in which their extinctions add up."""


@cache
def load_weather_parts() -> Registered[WeatherPart]:
    """Load the parts of this installation."""
    group = "advercity.weather_parts"
    return load_registered(group, CORE_PARTS, WeatherPart, _check_part)


def _check_part(part: WeatherPart, others: Mapping[str, WeatherPart]) -> None:
    check_model(part.name, part.model, WeatherComponent)
    if part.colour is not None and part.point_kind not in OTHERS_POINT_KINDS:
        low, high = OTHERS_POINT_KINDS[0], OTHERS_POINT_KINDS[-1]
        raise ValueError(f"point_kind is {part.point_kind}; choose one from {low} to {high}")
    for other in others.values():
        if part.point_kind is not None and other.point_kind == part.point_kind:
            raise ValueError(f"point_kind {part.point_kind} belongs to '{other.name}' already")


def list_fields_of_others() -> dict[str, Any]:
    """List the fields of a weather for parts of other distributions."""
    return {
        part.name: (
            part.model,
            Field(
                absent := part.model(),
                exclude_if=partial(eq, absent),
                description=part.model.__doc__,
            ),
        )
        for part in load_weather_parts().found.values()
        if part.name not in CORE_PARTS
    }
