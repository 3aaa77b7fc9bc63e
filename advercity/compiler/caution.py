"""What drivers do about a weather, from their tables."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from advercity_dsl import Caution, Drivers, Weather
from advercity_dsl.drivers import Grip, Step

GRAVITY_M_S2 = 9.81


def caution(drivers: Drivers, weather: Weather) -> Caution:
    """How much slower, farther apart and more gently drivers drive under a weather."""
    tables = _tables(drivers, weather)
    grip_m_s2 = GRAVITY_M_S2 * friction(drivers.grip, weather)
    slower = max(_at("slower_percent", *table) for table in tables)
    headway_s = max(_at("headway_s", *table) for table in tables)
    return Caution(
        speed_share=round(1 - slower / 100, 4),
        headway_s=round(headway_s, 3),
        usual_m_s2=round(drivers.grip.used_share * grip_m_s2, 3),
        hardest_m_s2=round(grip_m_s2, 3),
    )


def friction(grip: Grip, weather: Weather) -> float:
    """Coefficient of friction where tyres roll: in the ruts, as wet and as snowy as they are."""
    bare = grip.dry + (grip.wet - grip.dry) * weather.surface.wetness
    return bare + (grip.snow - bare) * weather.snow.rut_coverage


def visibility_m(weather: Weather) -> float:
    """What haze, fog and dust leave of it together; extinctions add."""
    parts = (weather.air.mor_m, weather.fog.mor_m, weather.dust.mor_m)
    extinction = sum(1 / part for part in parts if part is not None)
    return 1 / extinction if extinction else float("inf")


Table = tuple[Sequence[Step], Sequence[float], float]
"""Steps, the intensity of each, and the intensity that is there."""


def _tables(drivers: Drivers, weather: Weather) -> tuple[Table, ...]:
    rain, snow = weather.rain, weather.snow
    rates = [step.rate_mm_h for step in drivers.rain]
    snow_rates = [step.rate_mm_h for step in drivers.snowfall]
    covers = [step.road_coverage for step in drivers.snow_cover]
    nearness = [-step.mor_m for step in drivers.visibility]
    return (
        (drivers.rain, rates, rain.rate_mm_h),
        (drivers.snowfall, snow_rates, snow.rate_mm_h),
        (drivers.snow_cover, covers, snow.road_coverage),
        (drivers.visibility, nearness, -visibility_m(weather)),
    )


def _at(
    what: Literal["slower_percent", "headway_s"],
    steps: Sequence[Step],
    intensities: Sequence[float],
    there: float,
) -> float:
    if not steps or there < intensities[0]:
        return 0.0
    return float(np.interp(there, intensities, [getattr(step, what) for step in steps]))
