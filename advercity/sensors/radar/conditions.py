"""Air, road and radome for a radar at 77 GHz, computed once per weather."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather_components import Lens

from advercity.geometry.arrays import Float64Array
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.microwaves import (
    compute_echo,
    fog_attenuation_db_km,
)
from advercity.physics.precipitation import CAMERA_HEIGHT_M, wind_at_height
from advercity.physics.weather_parts.part import Precipitation
from advercity.sensors.covered_glass import find_side, list_coverage
from advercity.sensors.point_kinds import find_point_kind
from advercity.sensors.spray_plumes import has_spray

FILM_MM = 0.5
"""Water on a fully covered radome."""
FILM_LOSS_DB_MM = 6.0
"""One-way loss of a film: 3 dB for 0.5 mm, where 2 to 4 dB are reported."""
ICE_LOSS_DB = 15.0
"""One-way loss of a radome under a closed sheet of ice, where 5 to 15 dB are reported."""
WET_SNOW_FACTOR = 2.0
"""Loss of snow on the radome relative to water: an assumption."""
_MEAN_SIZE_SLOPES = 3.0
"""Diameter of the strongest scatterers, times the slope of their distribution."""


@dataclass(frozen=True, eq=False)
class FallingEcho:
    """Echo of precipitation of one kind.

    Attributes:
        kind: Kind of its detections.
        backscatter_per_m: m² per m³.
        velocity: (3,) mean in the world, m/s.
    """

    kind: int
    backscatter_per_m: float
    velocity: Float64Array


@dataclass(frozen=True, eq=False)
class RadarConditions:
    """Air, road and radome for a radar at 77 GHz.

    Attributes:
        attenuation_db_km: One-way attenuation of the air.
        falling: Rain, snow and hail.
        radome_db: One-way loss of radomes facing ahead, sideways and back.
        wetness: Wetness of roads, 0 dry to 1 soaked.
        has_spray: Whether the road is wet enough for spray.
    """

    attenuation_db_km: float = 0.0
    falling: tuple[FallingEcho, ...] = ()
    radome_db: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wetness: float = 0.0
    has_spray: bool = False

    def select_radome_db(self, mount: Mount) -> float:
        """Select the loss of the radome of a mount."""
        return self.radome_db[find_side(mount.yaw_deg)]


def derive_radar_conditions(atmosphere: Atmosphere, lens: Lens) -> RadarConditions:
    """Derive the conditions of a radar from an atmosphere and the glass before it."""
    air = atmosphere.extinction
    echoes = [(part, compute_echo(part.sizes, part.permittivity)) for part in air.precipitation]
    falling = tuple(
        FallingEcho(
            find_point_kind(part.name), echo.backscatter_per_m, _find_velocity(atmosphere, part)
        )
        for part, echo in echoes
    )
    return RadarConditions(
        attenuation_db_km=fog_attenuation_db_km(air.water_g_m3)
        + sum(
            echo.attenuation_db_km if part.attenuation_db_km is None else part.attenuation_db_km
            for part, echo in echoes
        ),
        falling=falling,
        radome_db=_compute_radome_db(lens, atmosphere.ice_cover),
        wetness=atmosphere.wetness,
        has_spray=has_spray(atmosphere.water_film_mm),
    )


def _find_velocity(atmosphere: Atmosphere, part: Precipitation) -> Float64Array:
    """Compute the velocity (3,) of the strongest scatterers."""
    sizes = part.sizes
    diameter_mm = min(_MEAN_SIZE_SLOPES / sizes.slope_per_mm, sizes.max_melted_mm)
    fall_m_s = part.speed_m_s * float(part.compute_speed(diameter_mm))
    return wind_at_height(atmosphere.wind, CAMERA_HEIGHT_M) - np.array([0.0, 0.0, fall_m_s])


def _compute_radome_db(lens: Lens, ice_cover: float) -> tuple[float, float, float]:
    by_kind = {"water": 1.0, "snow": WET_SNOW_FACTOR, "dust": 0.0}[lens.kind]
    film_db = FILM_MM * FILM_LOSS_DB_MM * by_kind
    front, side, rear = (
        film_db * covered + ICE_LOSS_DB * ice_cover for covered in list_coverage(lens)
    )
    return front, side, rear
