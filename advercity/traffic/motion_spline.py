"""Twice differentiable curves through time, made from values that jump from tick to tick.

SUMO moves its actors by steps of a tick: speeds jump, lanes have corners, people hop. A curve here
is a uniform cubic B-spline whose control values are weighted means of such values, so acceleration
is continuous and linear between ticks. All weights are positive: a curve never overshoots, never
runs backwards where the values do not, and stands exactly where they stand. Sums are elementwise
and in a fixed order, so that no machine rounds them differently.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]
"""(n,) plain numbers, or points as east + i north."""

EASING_TICKS = 4
"""Ticks over which a change sets in and ends: bounds jerk where positions jump."""


@dataclass(frozen=True, eq=False)
class MotionSpline:
    """A uniform cubic B-spline over the ticks of an actor.

    Attributes:
        controls: (n + 2,) control values, from one tick before the first to one after the last.
        tick_s: Length of a tick.
    """

    controls: Values
    tick_s: float

    @staticmethod
    def from_samples(
        samples: Values,
        tick_s: float,
        *,
        ticks: int,
        first_step: complex = 0.0,
        last_step: complex = 0.0,
    ) -> "MotionSpline":
        """Smooth the values (n,) of successive ticks.

        Args:
            samples: (n,) values.
            tick_s: Length of a tick.
            ticks: Even number of ticks over which a change is spread.
            first_step: Change per tick before the first.
            last_step: Change per tick after the last.
        """
        weights = np.convolve(np.ones(ticks, int), np.ones(EASING_TICKS, int)).tolist()
        # One more value on each side than the weights need, for the controls beyond the ends.
        beyond = np.arange(1, len(weights) // 2 + 2)
        padded = np.concatenate(
            [samples[0] - first_step * beyond[::-1], samples, samples[-1] + last_step * beyond]
        )
        count = len(samples) + 2
        total = np.zeros(count, dtype=padded.dtype)
        for first, weight in enumerate(weights):
            total += weight * padded[first : first + count]
        return MotionSpline(total / sum(weights), tick_s)

    @property
    def values(self) -> Values:
        """Values (n,) at the ticks."""
        before, here, after = self.controls[:-2], self.controls[1:-1], self.controls[2:]
        return (before + 4 * here + after) / 6

    @property
    def rates(self) -> Values:
        """First derivatives (n,) at the ticks, per second."""
        steps = np.diff(self.controls)
        return (steps[:-1] + steps[1:]) / (2 * self.tick_s)

    @property
    def middle_rates(self) -> Values:
        """First derivatives (n - 1,) in the middle between ticks, per second."""
        steps = np.diff(self.controls)
        return (steps[:-2] + 6 * steps[1:-1] + steps[2:]) / (8 * self.tick_s)

    @property
    def accelerations(self) -> Values:
        """Second derivatives (n,) at the ticks, per square second."""
        return np.diff(self.controls, n=2) / self.tick_s**2

    @property
    def derivatives(self) -> Values:
        """Values, first and second derivatives at the ticks: (3, n)."""
        return np.stack([self.values, self.rates, self.accelerations])
