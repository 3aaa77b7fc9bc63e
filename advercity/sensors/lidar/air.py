"""What a laser pulse meets on its way, worked out once per weather."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.sensors.lidar import spray
from advercity.sensors.lidar.particles import ParticleTable, tables_of
from advercity.sensors.lidar.power import noise_factor
from advercity.sensors.lidar.soft import SoftTarget
from advercity.weather import extinction
from advercity.weather.atmosphere import Atmosphere


@dataclass(frozen=True, eq=False)
class LidarAir:
    """Air, light and ground as a LiDAR at 905 nm has them.

    Attributes:
        extinction: Of everything, 1/m.
        soft: Fog and dust; None if there is neither.
        particles: What falls.
        spray: Whether the road is wet enough for wheels to throw water up.
        wetness: 0 dry to 1 soaked.
        puddle_coverage: Share of the carriageway under standing water.
        snow_cover: Share of the ground under snow.
        road_snow_cover: The same of carriageways.
        noise: Factor on the receiver's noise by daylight.
        sun_direction: (3,) towards the sun's disc; None if it is not to be seen.
        window_coverage: Share of the sensor's window that drops or dirt cover: front, side, rear.
    """

    extinction: float
    soft: SoftTarget | None
    particles: tuple[ParticleTable, ...]
    spray: bool
    wetness: float
    puddle_coverage: float
    snow_cover: float
    road_snow_cover: float
    noise: float
    sun_direction: NDArray[np.float64] | None
    window_coverage: tuple[float, float, float]


VISIBLE_SUN_LX = 1_000.0
"""Direct sunlight below this is no disc any more."""


def air_of(weather: Weather, atmosphere: Atmosphere) -> LidarAir:
    """The air of `weather`, whose light is that of `atmosphere`."""
    total = atmosphere.extinction_905nm
    fog, dust = extinction.of_fog(weather).at_905nm, extinction.of_dust(weather).at_905nm
    sun_lx = atmosphere.sun_lx * max(0.0, float(atmosphere.sun_direction[2]))
    coverage = weather.lens.coverage
    return LidarAir(
        extinction=total,
        soft=SoftTarget.of(fog=fog, dust=dust, extinction=total) if fog or dust else None,
        particles=tables_of(weather, total),
        spray=spray.hangs(weather),
        wetness=atmosphere.wetness,
        puddle_coverage=atmosphere.puddle_coverage,
        snow_cover=1.0 if weather.snow.depth_mm else 0.0,
        road_snow_cover=weather.snow.road_coverage,
        noise=noise_factor(sun_lx + atmosphere.sky_lx),
        sun_direction=(atmosphere.sun_direction if atmosphere.sun_lx > VISIBLE_SUN_LX else None),
        window_coverage=(
            (coverage.front, coverage.side, coverage.rear)
            if weather.lens.enabled
            else (0.0, 0.0, 0.0)
        ),
    )
