"""How drivers differ from each other, and from moment to moment.

Each driver's draws have a random stream of its own, and what changes with time is a function of
time alone: dry runs rely on every run doing the same, whatever other drivers do.
"""

import math
from dataclasses import dataclass

import numpy as np

from advercity.randomness import create_generator

HEADWAYS, GAPS = (1.0, 0.35, 0.5, 2.2), (1.0, 0.35, 0.5, 2.2)
"""Median, standard deviation of the logarithm, least and greatest ratio to the class."""
ACCELERATIONS = (0.85, 0.2, 0.6, 1.0)
"""The same; engineering values, as for headways and gaps. No driver exceeds the class."""
BRAKINGS = (1.0, 0.28, 0.5, 2.0)
"""The same. Drivers who stop first at a red light decelerate with 2.2, 3.0 and 3.9 m/s2 at the
15th, 50th and 85th percentile (Gates and others, Transportation Research Record 2030, 2007)."""
SWAY_FRACTION = 0.02
"""Amplitude of the slow changes of speed of a driver whom nobody hinders, as a fraction of it.

It makes an acceleration noise of 0.1 m/s2 in town, a hundredth of g as on free roads (Jones and
Potts, Operations Research 10, 1962: 0.01 to 0.03 g)."""
SWAY_PERIODS_S = ((6.0, 9.0), (9.0, 15.0), (15.0, 30.0))
"""Shortest and longest period of each of the waves that the changes consist of."""


@dataclass(frozen=True)
class DrivingStyle:
    """What one driver does relative to its class.

    Attributes:
        headway_ratio: Of its time gap.
        gap_ratio: Of its gap at standstill.
        acceleration_ratio: Of its maximum acceleration.
        braking_ratio: Of its maximum braking in everyday traffic; the higher, the later it brakes.
        waves: Period in seconds and phase in radians of each wave of its speed.
    """

    headway_ratio: float = 1.0
    gap_ratio: float = 1.0
    acceleration_ratio: float = 1.0
    braking_ratio: float = 1.0
    waves: tuple[tuple[float, float], ...] = ()

    def sway_at(self, time_s: float) -> float:
        """Compute the ratio of the speed that the driver wants at a time to its mean."""
        waves = (math.sin(2 * math.pi * time_s / period + at) for period, at in self.waves)
        return 1.0 + SWAY_FRACTION * sum(waves)


MEDIAN_STYLE = DrivingStyle()


def draw_driving_style(seed: int, number: int) -> DrivingStyle:
    """Draw the style of a driver, by the seed of the traffic and the vehicle's id."""
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
