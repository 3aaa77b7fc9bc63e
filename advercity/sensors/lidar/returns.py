"""Returns of a scan, and their resolution, detection and selection by the receiver."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.sensors.lidar.received_power import detection_margin_sigma

ReturnMode = Literal["strongest", "last", "dual"]

_SORT_RANGE_STEP_M = 1.0 / 1024.0
"""Resolution of ranges in sort keys; a power of two, so the division is exact."""


@dataclass(frozen=True, eq=False)
class Returns:
    """k returns, several of which may belong to one beam.

    Attributes:
        beam: (k,) int32 row of the beam.
        range_m: (k,) float32.
        power: (k,) float32 relative to the threshold.
        noise: (k,) float32 of the receiver at the return's arrival, standard normal.
        kind: (k,) uint8 of `PointKind`.
        semantic: (k,) uint8 of `Semantic`.
        instance: (k,) int32 id of the actor, or 0.
    """

    beam: NDArray[np.int32]
    range_m: FloatArray
    power: FloatArray
    noise: FloatArray
    kind: NDArray[np.uint8]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.beam)

    @property
    def is_detected(self) -> NDArray[np.bool_]:
        """Whether each return (k,) exceeds the receiver's threshold."""
        return self.noise < detection_margin_sigma(self.power)

    def select(self, where: "IndexArray | NDArray[np.bool_]") -> "Returns":
        """Select returns by row numbers or by a mask (k,)."""
        rows = np.flatnonzero(where) if where.dtype == bool else where
        return Returns(*(getattr(self, item.name).take(rows) for item in fields(self)))

    @staticmethod
    def concatenate(parts: "list[Returns]") -> "Returns":
        """Concatenate returns in order."""
        if len(parts) == 1:
            return parts[0]
        names = [item.name for item in fields(Returns)]
        return Returns(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def select_reported(
    per_beam: Sequence[Returns],
    others: Sequence[Returns],
    beams: int,
    return_mode: ReturnMode,
    pulse_length_m: float,
) -> Returns:
    """Select the returns reported by the receiver, sorted by beam, then by range.

    Overlapping returns of a beam merge. Among the returns above the threshold, the mode of the
    receiver decides. Returns without power do not exist.

    Args:
        per_beam: Returns of up to two sources with exactly one per beam, in the order of beams.
        others: Returns of all other sources, each sorted by beam.
        beams: Number of beams.
        return_mode: Mode of the receiver.
        pulse_length_m: Returns closer than this overlap.
    """
    # Sorting is the cost here. Most beams have returns of the one or two per-beam sources only, and
    # a comparison decides; only crowded beams are merged and sorted.
    crowded = np.zeros(beams, np.bool_)
    for part in others:
        crowded[part.beam] = True
    if len(per_beam) == 2:
        crowded |= _is_contested(per_beam[0], per_beam[1], return_mode, pulse_length_m)
    reported = [part.is_detected & ~crowded for part in per_beam]
    if len(per_beam) == 2:
        one, other = per_beam
        first = one.range_m >= other.range_m if return_mode == "last" else one.power >= other.power
        reported = [reported[0] & (first | ~reported[1]), reported[1] & ~(first & reported[0])]
    strong = [part.select(crowded & (part.power > 0.0)) for part in per_beam]
    strong += [part.select(part.power > 0.0) for part in others]
    merged = merge_overlapping(Returns.concatenate(strong), pulse_length_m)
    clear = [part.select(rows) for part, rows in zip(per_beam, reported, strict=True)]
    resolved = select_by_mode(merged.select(merged.is_detected), return_mode)
    found = Returns.concatenate([*clear, resolved])
    return found.select(np.argsort(found.beam, kind="stable"))


def _is_contested(
    one: Returns, other: Returns, return_mode: ReturnMode, pulse_length_m: float
) -> NDArray[np.bool_]:
    """Find the beams whose returns from two sources overlap, or are both reported."""
    both = (one.power > 0.0) & (other.power > 0.0)
    if return_mode == "dual":
        return both
    return both & (np.abs(one.range_m - other.range_m) < pulse_length_m)


def merge_overlapping(returns: Returns, pulse_length_m: float) -> Returns:
    """Merge successive returns of a beam within a pulse's length.

    Powers add, the range is the power-weighted mean, all else is taken from the strongest. The
    result is sorted by beam, then by range.
    """
    # The stable sort is fast because every source is sorted by beam already.
    returns = returns.select(np.argsort(_compute_sort_keys(returns), kind="stable"))
    apart = np.diff(returns.range_m, prepend=np.float32(0.0)) >= pulse_length_m
    apart |= np.diff(returns.beam, prepend=np.int32(-1)) != 0
    first = np.flatnonzero(apart)
    if len(first) == len(returns):
        return returns
    one = returns.select(_find_strongest_rows(returns.power, first))
    size = np.diff(first, append=len(returns))
    several = np.flatnonzero(size > 1)
    parts = returns.select(np.repeat(size > 1, size))
    begins = np.cumsum(size[several]) - size[several]
    power = np.add.reduceat(parts.power, begins)
    one.range_m[several] = np.add.reduceat(parts.power * parts.range_m, begins) / power
    one.power[several] = power
    return one


def select_by_mode(returns: Returns, return_mode: ReturnMode) -> Returns:
    """Select the returns to report of each beam, from returns sorted by beam and range.

    Where the strongest is the last, "dual" adds the second strongest.
    """
    if not len(returns):
        return returns
    new_beam = np.diff(returns.beam, prepend=np.int32(-1)) != 0
    first = np.flatnonzero(new_beam)
    if return_mode == "strongest":
        rows = _find_strongest_rows(returns.power, first)
        return returns if len(first) == len(returns) else returns.select(rows)
    last = np.append(first[1:], len(returns)) - 1
    if return_mode == "last":
        return returns.select(last)
    strongest = _find_strongest_rows(returns.power, first)
    both = last[(strongest == last) & (last > first)]
    others = returns.power.copy()
    others[both] = 0.0
    return returns.select(np.unique([_find_strongest_rows(others, first), last]))


def _find_strongest_rows(power: FloatArray, first: IndexArray) -> IndexArray:
    """Find the row of each group's strongest return, by first rows; of equals, the nearest."""
    strongest = first.copy()
    size = np.diff(first, append=len(power))
    for step in range(1, int(size.max(initial=1))):
        larger = np.flatnonzero(size > step)
        rows = first[larger] + step
        stronger = power[rows] > power[strongest[larger]]
        strongest[larger[stronger]] = rows[stronger]
    return strongest


def _compute_sort_keys(returns: Returns) -> NDArray[np.int64]:
    """Compute keys that sort by beam, then by range."""
    range_key = (returns.range_m * (1.0 / _SORT_RANGE_STEP_M)).astype(np.int64)
    return (returns.beam.astype(np.int64) << 32) | range_key
