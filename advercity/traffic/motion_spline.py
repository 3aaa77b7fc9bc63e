"""Build twice differentiable curves in time or along a path from discontinuous values.

SUMO moves its actors by steps of a tick: speeds jump, lanes have corners, people hop. A curve here
is a uniform cubic B-spline whose control values are weighted means of such values, so acceleration
is continuous and linear between ticks. All weights are positive: a curve never overshoots, runs
backwards only where the values do, and is at rest exactly where they are. Sums are elementwise and
in a fixed order, so rounding is the same on all machines.

Heights are such curves along the path instead of in time: a vehicle with slowly changing speed
still follows every bump.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]
"""(n,) plain numbers, or points as east + i north."""

EASING_TICKS = 4
"""Ticks over which a change sets in and ends; they limit the jerk at jumps of position."""
PROFILE_STEP_M = 1.5
"""Distance between controls of a height profile: tyres and springs even out shorter bumps."""


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
        weights = _build_weights(ticks)
        # One more value on each side than the weights need, for the controls beyond the ends.
        beyond = np.arange(1, len(weights) // 2 + 2)
        padded = np.concatenate(
            [samples[0] - first_step * beyond[::-1], samples, samples[-1] + last_step * beyond]
        )
        total = _sum_weighted(padded, weights, len(samples) + 2)
        return MotionSpline(total / weights.sum(), tick_s)

    def hasten(self, gains: Values, *, ticks: int, to_ticks: int) -> "MotionSpline":
        """Return the curve with some changes of speed spread over fewer ticks.

        It differs only near them, since every change keeps its mean time.

        Args:
            gains: (n,) excess of the step after a tick over the one before, the part to hasten.
            ticks: Even number of ticks over which all changes are spread.
            to_ticks: Even number of ticks over which to spread these.
        """
        slow, fast = _build_weights(ticks), _build_weights(to_ticks)
        moved = slow.sum() * np.pad(fast, (len(slow) - len(fast)) // 2) - fast.sum() * slow
        # From a gain on, values are a ramp; the two smoothings differ where it begins.
        ramp = np.cumsum(np.cumsum(moved))[:-2]
        padded = np.pad(gains, len(ramp) // 2 + 1)
        change = _sum_weighted(padded, ramp, len(self.controls)) / (slow.sum() * fast.sum())
        return MotionSpline(self.controls + change, self.tick_s)

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


def _build_weights(ticks: int) -> NDArray[np.int64]:
    """Build the weights of the values around a tick to spread a change over some ticks."""
    return np.convolve(np.ones(ticks, np.int64), np.ones(EASING_TICKS, np.int64))


def _sum_weighted(values: Values, weights: NDArray[np.int64], count: int) -> Values:
    """Sum weights times values from each of the first `count` values on."""
    total = np.zeros(count, dtype=values.dtype)
    for first, weight in enumerate(weights.tolist()):
        total += weight * values[first : first + count]
    return total


def interpolate_smoothly(
    times_s: NDArray[np.float64], values: Values, at_s: NDArray[np.float64]
) -> Values:
    """Interpolate values (n,) by a cubic spline, whose acceleration is constant at both ends.

    It passes through every value, and its second derivative is continuous.

    Args:
        times_s: (n,) rising times of two or more values, evenly spaced or not.
        values: (n,) values.
        at_s: (m,) times from the first to the last.

    Returns:
        (3, m) values, first and second derivatives.
    """
    steps = np.diff(times_s)
    bends = _solve_bends(steps, np.diff(values) / steps)
    cell = np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, len(steps) - 1)
    h, after = steps[cell], (at_s - times_s[cell]) / steps[cell]
    before = 1 - after
    low, high = values[cell], values[cell + 1]
    bend, next_bend = bends[cell], bends[cell + 1]
    cubic = (before**2 - 1) * before * bend + (after**2 - 1) * after * next_bend
    slope = (3 * after**2 - 1) * next_bend - (3 * before**2 - 1) * bend
    return np.stack(
        [
            before * low + after * high + h * h / 6 * cubic,
            (high - low) / h + h / 6 * slope,
            before * bend + after * next_bend,
        ]
    )


def _solve_bends(steps: NDArray[np.float64], slopes: Values) -> Values:
    """Solve for the second derivatives (n + 1,) at the ends of n cubic pieces.

    The matrix is tridiagonal and eliminated in a fixed order.
    """
    count = len(steps) - 1
    if count == 0:
        return np.zeros(2, dtype=slopes.dtype)
    diagonal = 2 * (steps[:-1] + steps[1:])
    diagonal[0] += steps[0]
    diagonal[-1] += steps[-1]
    right = (6 * np.diff(slopes)).tolist()
    pivots = diagonal.tolist()
    off = steps[1:-1].tolist()
    for row in range(1, count):
        factor = off[row - 1] / pivots[row - 1]
        pivots[row] -= factor * off[row - 1]
        right[row] -= factor * right[row - 1]
    inner = [right[-1] / pivots[-1]]
    for row in range(count - 2, -1, -1):
        inner.append((right[row] - off[row] * inner[-1]) / pivots[row])
    return np.array([inner[-1], *inner[::-1], inner[0]], dtype=slopes.dtype)


@dataclass(frozen=True, eq=False)
class HeightProfile:
    """A uniform cubic B-spline of the heights along a path.

    Attributes:
        controls: (n,) control values in m.
        first_m: Station of the first control value.
    """

    controls: NDArray[np.float64]
    first_m: float

    @staticmethod
    def from_samples(
        stations_m: NDArray[np.float64],
        heights_m: NDArray[np.float64],
        *,
        first_m: float,
        first_grade: float,
    ) -> "HeightProfile":
        """Smooth the heights (n,) at stations (n,), which increase from 0, from `first_m` on.

        The path has `first_grade` before the first station, and keeps its grade beyond the last.
        """
        end_m = stations_m[-1]
        count = int((end_m - first_m) / PROFILE_STEP_M) + 4
        grid = first_m + PROFILE_STEP_M * np.arange(count)
        last_m = max(end_m - PROFILE_STEP_M, 0.0)
        last_grade = first_grade
        if end_m > last_m:
            last_rise_m = heights_m[-1] - np.interp(last_m, stations_m, heights_m)
            last_grade = last_rise_m / (end_m - last_m)
        beyond = first_grade * np.minimum(grid, 0.0) + last_grade * np.maximum(grid - end_m, 0.0)
        return HeightProfile(np.interp(grid, stations_m, heights_m) + beyond, first_m)

    def compute_derivatives(self, station: MotionSpline) -> NDArray[np.float64]:
        """Compute heights in m and their first and second derivatives in time: (3, n).

        Args:
            station: Stations (n,) in m over time.
        """
        places = (station.values - self.first_m) / PROFILE_STEP_M
        cells = np.clip(places.astype(np.int64), 1, len(self.controls) - 3)
        t = places - cells
        rest = 1 - t
        a, b, c, d = (self.controls[cells + offset] for offset in (-1, 0, 1, 2))
        bend = rest * (a - 2 * b + c) + t * (b - 2 * c + d)
        grade = (rest * rest * (b - a) + (1 + 2 * t - 2 * t * t) * (c - b) + t * t * (d - c)) / 2
        height = (
            rest * rest * rest * a
            + (4 - 6 * t * t + 3 * t * t * t) * b
            + (1 + 3 * t + 3 * t * t - 3 * t * t * t) * c
            + t * t * t * d
        ) / 6
        grade, bend = grade / PROFILE_STEP_M, bend / PROFILE_STEP_M**2
        speed, acceleration = station.rates, station.accelerations
        return np.stack([height, grade * speed, bend * speed**2 + grade * acceleration])
