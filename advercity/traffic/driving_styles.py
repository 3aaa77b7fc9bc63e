"""Differences between drivers, and slow changes of each driver's wanted speed.

Each driver's draws have their own random stream, and changes are a function of time alone: dry
runs need the same behaviour in every run, independent of other drivers.
"""

import math
from dataclasses import dataclass

import numpy as np

from advercity.randomness import create_generator

HEADWAYS, GAPS = (1.0, 0.35, 0.5, 2.2), (1.0, 0.35, 0.5, 2.2)
"""Median, standard deviation of the logarithm, minimum and maximum ratio to the class.

Engineering values."""
ACCELERATIONS = (0.85, 0.2, 0.6, 1.0)
"""Laws of the same form; engineering values. No driver exceeds the class."""
BRAKINGS = (1.0, 0.28, 0.5, 2.0)
"""A law of the same form. Drivers who stop first at a red light decelerate with 2.2, 3.0 and
3.9 m/s2 at the 15th, 50th and 85th percentile (Gates and others, Transportation Research Record
2030, 2007)."""
SWAY_FRACTION = 0.02
"""Amplitude of each wave of a free driver's speed, as a fraction of the speed.

It causes an acceleration noise of 0.1 m/s2 in town, a hundredth of g as on free roads (Jones and
Potts, Operations Research 10, 1962: 0.01 to 0.03 g)."""
SWAY_PERIODS_S = ((6.0, 9.0), (9.0, 15.0), (15.0, 30.0))
"""Minimum and maximum period of each wave."""


@dataclass(frozen=True)
class DrivingStyle:
    """Driving of one driver, as ratios to its class.

    Attributes:
        headway_ratio: Ratio of time gaps.
        gap_ratio: Ratio of gaps at standstill.
        acceleration_ratio: Ratio of maximum accelerations.
        braking_ratio: Ratio of maximum everyday braking; the higher, the later a driver brakes.
        waves: Period in seconds and phase in radians of each wave of its speed.
    """

    headway_ratio: float = 1.0
    gap_ratio: float = 1.0
    acceleration_ratio: float = 1.0
    braking_ratio: float = 1.0
    waves: tuple[tuple[float, float], ...] = ()

    def sway_at(self, time_s: float) -> float:
        """Compute the ratio of the wanted speed at a time to its mean."""
        waves = (math.sin(2 * math.pi * time_s / period + at) for period, at in self.waves)
        return 1.0 + SWAY_FRACTION * sum(waves)


MEDIAN_STYLE = DrivingStyle()


def draw_driving_style(seed: int, number: int) -> DrivingStyle:
    """Draw the style of a driver by the seed of the traffic and the id of the vehicle."""
    draw = create_generator(seed, "driving style", number)

    def draw_ratio(median: float, spread: float, least: float, greatest: float) -> float:
        ratio = median * math.exp(spread * float(draw.standard_normal()))
        return round(min(max(ratio, least), greatest), 3)

    ratios = tuple(draw_ratio(*law) for law in (HEADWAYS, GAPS, ACCELERATIONS, BRAKINGS))
    waves = tuple(
        (float(draw.uniform(*periods)), float(draw.uniform(0, 2 * np.pi)))
        for periods in SWAY_PERIODS_S
    )
    return DrivingStyle(*ratios, waves=waves)
