"""The reports of a receiver, an inertial unit or a bus over a scenario, as arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.errors import InputError
from advercity.sensors.measurements import CanSample, GnssFix, ImuSample

SampleKind = Literal["gnss", "imu", "can"]
_TURNING = ("compass_rad", "heading_rad")


@dataclass(frozen=True, eq=False)
class SampleSeries:
    """Samples of one sensor, n of them in order of time.

    Attributes:
        times_s: (n,) since the scenario's start, as `Frame.time_s`.
        values: Arrays (n, ...) by field of `GnssFix`, `ImuSample` or `CanSample`.
    """

    times_s: NDArray[np.float64]
    values: Mapping[str, NDArray[Any]]

    def __len__(self) -> int:
        return len(self.times_s)

    def nearest(self, times_s: ArrayLike) -> dict[str, NDArray[Any]]:
        """Return the values (m, ...) of the samples nearest to times (m,)."""
        rows = self._find_nearest(np.atleast_1d(np.asarray(times_s, dtype=np.float64)))
        return {name: values[rows] for name, values in self.values.items()}

    def interpolate(
        self, times_s: ArrayLike, *, max_gap_s: float = math.inf
    ) -> dict[str, NDArray[Any]]:
        """Interpolate values (m, ...) linearly at times (m,), headings the short way round.

        Numbers are NaN before the first and after the last sample, and between samples more than
        `max_gap_s` apart. Values of other types are taken from the nearest sample.
        """
        at = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        nearest = self._find_nearest(at)
        after = np.clip(np.searchsorted(self.times_s, at), 1, max(len(self) - 1, 1))
        before = after - 1
        first_s, last_s = self.times_s[before], self.times_s[after % len(self)]
        part = (at - first_s) / np.where(last_s > first_s, last_s - first_s, 1.0)
        unknown = (part < 0.0) | (part > 1.0) | (last_s - first_s > max_gap_s)
        unknown &= self.times_s[nearest] != at
        found: dict[str, NDArray[Any]] = {}
        for name, values in self.values.items():
            if values.dtype.kind != "f":
                found[name] = values[nearest]
                continue
            change = values[after % len(self)] - values[before]
            if name in _TURNING:
                change = (change + np.pi) % (2.0 * np.pi) - np.pi
            weights = part.reshape(-1, *[1] * (values.ndim - 1))
            between = values[before] + weights * change
            between[unknown] = np.nan
            found[name] = between % (2.0 * np.pi) if name in _TURNING else between
        return found

    def _find_nearest(self, at: NDArray[np.float64]) -> NDArray[np.intp]:
        if not len(self):
            raise InputError("there are no samples to take the nearest of")
        after = np.clip(np.searchsorted(self.times_s, at), 1, max(len(self) - 1, 1))
        before_is_nearer = at - self.times_s[after - 1] <= self.times_s[after % len(self)] - at
        return np.where(before_is_nearer | (len(self) == 1), after - 1, after)


def join_fixes(found: Iterable[tuple[float, GnssFix | None]]) -> SampleSeries:
    """Join fixes of frames, given with the times of the frames."""
    fixes = [one for _, fix in found if fix is not None for one in (*fix.earlier, fix)]
    return SampleSeries(
        np.array([fix.time_s for fix in fixes]),
        {
            "latitude_deg": np.array([fix.latitude_deg for fix in fixes]),
            "longitude_deg": np.array([fix.longitude_deg for fix in fixes]),
            "altitude_m": np.array([fix.altitude_m for fix in fixes]),
            "heading_rad": np.array(
                [np.nan if fix.heading_rad is None else fix.heading_rad for fix in fixes]
            ),
            "solution": np.array(
                ["" if fix.quality is None else fix.quality.solution.value for fix in fixes],
                dtype=np.str_,
            ),
            "satellites": np.array(
                [0 if fix.quality is None else fix.quality.satellites for fix in fixes],
                dtype=np.int64,
            ),
        },
    )


def join_imu_samples(found: Iterable[tuple[float, ImuSample | None]]) -> SampleSeries:
    """Join samples of an inertial unit, given with the times of the frames."""
    samples: list[tuple[float, ImuSample]] = _flatten(found)
    return SampleSeries(
        np.array([time_s for time_s, _ in samples]),
        {
            "specific_force": _stack((one.specific_force for _, one in samples), 3),
            "angular_rate": _stack((one.angular_rate for _, one in samples), 3),
            "compass_rad": np.array([one.compass_rad for _, one in samples]),
        },
    )


def join_can_samples(found: Iterable[tuple[float, CanSample | None]]) -> SampleSeries:
    """Join samples of a bus, given with the times of the frames."""
    samples: list[tuple[float, CanSample]] = _flatten(found)
    return SampleSeries(
        np.array([time_s for time_s, _ in samples]),
        {
            "wheel_speeds_m_s": _stack((one.wheel_speeds_m_s for _, one in samples), 4),
            "speed_m_s": np.array([one.speed_m_s for _, one in samples]),
            "steering_wheel_rad": np.array([one.steering_wheel_rad for _, one in samples]),
            "yaw_rate_rad_s": np.array([one.yaw_rate_rad_s for _, one in samples]),
            "is_braking": np.array([one.is_braking for _, one in samples], dtype=np.bool_),
            "indicator": np.array([one.indicator.value for _, one in samples], dtype=np.str_),
        },
    )


def _flatten(found: Iterable[tuple[float, Any]]) -> list[tuple[float, Any]]:
    """List all samples of frames with their times since the scenario's start."""
    return [
        (round(time_s + one.time_s, 9), one)
        for time_s, sample in found
        if sample is not None
        for one in (*sample.earlier, sample)
    ]


def _stack(rows: Iterable[NDArray[np.float64]], width: int) -> NDArray[np.float64]:
    return np.array(list(rows), dtype=np.float64).reshape(-1, width)
