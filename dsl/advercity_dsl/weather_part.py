"""The record of a part of the weather.

The module of such a record imports only from here and from `base`, `units` and
`weather_components`: weathers load the record during the import of the language.
"""

from dataclasses import dataclass

from advercity_dsl.weather_components import WeatherComponent

OTHERS_POINT_KINDS = range(64, 256)
"""Values of the point kinds of other distributions."""


@dataclass(frozen=True)
class WeatherPart:
    """A part of the weather in the air or on the ground.

    Attributes:
        name: Key in a weather and its keyframes; part of the names of random streams.
        model: Model of the key's value. Without values, the part is absent.
        physics: Names, as `module:attribute`, the `PartPhysics` of
            `advercity.physics.weather_parts.part`; it is loaded on first use.
        colour: Red, green and blue of its points in viewers; None if it returns none.
        point_kind: Value of its points in files, one of `OTHERS_POINT_KINDS`; parts of advercity
            have a `PointKind`.
    """

    name: str
    model: type[WeatherComponent]
    physics: str
    colour: tuple[int, int, int] | None = None
    point_kind: int | None = None
