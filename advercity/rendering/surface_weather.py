"""Effects of a weather on surfaces: water, ice and snow, in the form used by renderers."""

from dataclasses import dataclass

from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere

NO_WATER_LEVEL = -1.0
"""Water level below every hollow."""
RUT_FRACTION = 0.3
"""Fraction of a lane's width in ruts."""
RIPPLE_SLOPE, RIPPLE_REFERENCE_RAIN_MM_H = 0.06, 50.0
"""Root mean square of the slope of puddles' water in rain of this rate."""
INDEX_MATCHED_RATIO = 0.85
"""Albedo of a rough surface with water-filled pores over its albedo in air, without the water's own
faces: water matches the index of grains better (Lekner and Dorf 1988)."""
CLEAN_SNOW, DIRTY_SNOW = (0.86, 0.88, 0.91), (0.55, 0.52, 0.48)
"""Albedo of snow, and of snow in ruts."""
SNOW_DEPTH_M, SNOW_DEPTH_ON_ROAD_M = 0.002, 0.005
"""Depth of snow at which all but 1/e of level ground is under it."""


@dataclass(frozen=True)
class SurfaceWeather:
    """Water, ice and snow on surfaces.

    Attributes:
        wetness: 0 dry to 1 soaked.
        puddle_level: Level up to which the hollows of roads are filled; NO_WATER_LEVEL for none.
        ripple_slope: Root mean square of the slope of puddles' water.
        ice_cover: Fraction of the texture of surfaces filled by clear ice.
        snow_depth_m: Depth of lying snow in the open.
        snow_between_ruts: Fraction of a carriageway under snow, beside its ruts.
        snow_in_ruts: The same in its ruts.
    """

    wetness: float
    puddle_level: float
    ripple_slope: float
    ice_cover: float
    snow_depth_m: float
    snow_between_ruts: float
    snow_in_ruts: float


def compute_surface_weather(atmosphere: Atmosphere) -> SurfaceWeather:
    """Compute water, ice and snow on surfaces under an atmosphere."""
    coverage = atmosphere.puddle_coverage
    rain = min(1.0, atmosphere.rain_mm_h / RIPPLE_REFERENCE_RAIN_MM_H)
    return SurfaceWeather(
        wetness=atmosphere.wetness,
        puddle_level=water.puddle_water_level(coverage) if coverage > 0.0 else NO_WATER_LEVEL,
        ripple_slope=RIPPLE_SLOPE * rain**0.5,
        ice_cover=atmosphere.ice_cover,
        snow_depth_m=atmosphere.snow_depth_m,
        snow_between_ruts=_compute_snow_between_ruts(atmosphere),
        snow_in_ruts=atmosphere.rut_snow_cover,
    )


def _compute_snow_between_ruts(atmosphere: Atmosphere) -> float:
    """Compute the snow cover between the ruts from the road's and the cover in the ruts."""
    in_ruts = RUT_FRACTION * atmosphere.rut_snow_cover
    return min(1.0, (atmosphere.road_snow_cover - in_ruts) / (1.0 - RUT_FRACTION))
