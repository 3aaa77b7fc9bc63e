"""From everything that sends light back to the echoes that a receiver tells apart and reports."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.sensors.lidar.received_power import PULSE_LENGTH_M, detection_margin_sigma

ReturnMode = Literal["strongest", "last", "dual"]

_SORT_RANGE_STEP_M = 1.0 / 1024.0


@dataclass(frozen=True, eq=False)
class Returns:
    """k echoes; several may share a beam.

    Attributes:
        beam: (k,) int32.
        range_m: (k,) float32.
        power: (k,) float32 against the threshold.
        noise: (k,) float32 of the receiver when it arrives, standard normal.
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
        """Whether each (k,) passes the receiver's threshold."""
        return self.noise < detection_margin_sigma(self.power)

    def select(self, where: "IndexArray | NDArray[np.bool_]") -> "Returns":
        """Those echoes alone."""
        rows = np.flatnonzero(where) if where.dtype == bool else where
        return Returns(*(getattr(self, item.name).take(rows) for item in fields(self)))

    @staticmethod
    def concatenate(parts: "list[Returns]") -> "Returns":
        """All of them, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return Returns(
            *(
                np.concatenate([getattr(part, item.name) for part in parts])
                for item in fields(Returns)
            )
        )


def select_reported(
    per_beam: Sequence[Returns], others: Sequence[Returns], beams: int, return_mode: ReturnMode
) -> Returns:
    """What the receiver reports of `beams` beams: sorted by beam, and by range where both are.

    Echoes of a beam that overlap are one; of those that pass the threshold it takes what it is
    set to. Echoes of no power are none. Where nothing but two rivals is in a beam, and they do not
    overlap, a comparison settles it, which spares most beams of thick air the sorting.

    Args:
        per_beam: The echoes of up to two sources that have one for every beam, in their order.
        others: The echoes of every other source, each sorted by beam.
        beams: How many there are.
        return_mode: What the receiver is set to.
    """
    crowded = np.zeros(beams, np.bool_)
    for part in others:
        crowded[part.beam] = True
    if len(per_beam) == 2:
        crowded |= _is_contested(per_beam[0], per_beam[1], return_mode)
    seen = [part.is_detected & ~crowded for part in per_beam]
    if len(per_beam) == 2:
        one, other = per_beam
        first = one.range_m >= other.range_m if return_mode == "last" else one.power >= other.power
        seen = [seen[0] & (first | ~seen[1]), seen[1] & ~(first & seen[0])]
    several = merge_overlapping(
        Returns.concatenate(
            [
                *(part.select(crowded & (part.power > 0.0)) for part in per_beam),
                *(part.select(part.power > 0.0) for part in others),
            ]
        )
    )
    found = Returns.concatenate(
        [
            *(part.select(met) for part, met in zip(per_beam, seen, strict=True)),
            select_by_mode(several.select(several.is_detected), return_mode),
        ]
    )
    return found.select(np.argsort(found.beam, kind="stable"))


def _is_contested(one: Returns, other: Returns, report: ReturnMode) -> NDArray[np.bool_]:
    """Beams whose echoes from two sources overlap, or are both reported."""
    both = (one.power > 0.0) & (other.power > 0.0)
    if report == "dual":
        return both
    return both & (np.abs(one.range_m - other.range_m) < PULSE_LENGTH_M)


def merge_overlapping(echoes: Returns) -> Returns:
    """Echoes of a beam that follow each other within a pulse become one.

    Their powers add, the range is their mean by power, and what they are is what the strongest
    of them is. The result is sorted by beam, then range.
    """
    # Sources come sorted by beam, which the stable sort makes use of.
    echoes = echoes.select(np.argsort(_sort_key(echoes), kind="stable"))
    apart = np.diff(echoes.range_m, prepend=np.float32(0.0)) >= PULSE_LENGTH_M
    apart |= np.diff(echoes.beam, prepend=np.int32(-1)) != 0
    first = np.flatnonzero(apart)
    if len(first) == len(echoes):
        return echoes
    one = echoes.select(_strongest_rows(echoes.power, first))
    size = np.diff(first, append=len(echoes))
    several = np.flatnonzero(size > 1)
    parts = echoes.select(np.repeat(size > 1, size))
    begins = np.cumsum(size[several]) - size[several]
    power = np.add.reduceat(parts.power, begins)
    one.range_m[several] = np.add.reduceat(parts.power * parts.range_m, begins) / power
    one.power[several] = power
    return one


def select_by_mode(echoes: Returns, return_mode: ReturnMode) -> Returns:
    """The echoes that are reported of those of each beam, sorted by beam and range.

    Where the strongest is the last, dual adds the second strongest.
    """
    if not len(echoes):
        return echoes
    new_beam = np.diff(echoes.beam, prepend=np.int32(-1)) != 0
    first = np.flatnonzero(new_beam)
    if return_mode == "strongest":
        return (
            echoes
            if len(first) == len(echoes)
            else echoes.select(_strongest_rows(echoes.power, first))
        )
    last = np.append(first[1:], len(echoes)) - 1
    if return_mode == "last":
        return echoes.select(last)
    strongest = _strongest_rows(echoes.power, first)
    both = last[(strongest == last) & (last > first)]
    others = echoes.power.copy()
    others[both] = 0.0
    return echoes.select(np.unique([_strongest_rows(others, first), last]))


def _strongest_rows(power: FloatArray, first: IndexArray) -> IndexArray:
    """Row of the strongest echo of each group, by where groups begin; the nearest of equals."""
    strongest = first.copy()
    size = np.diff(first, append=len(power))
    for step in range(1, int(size.max(initial=1))):
        larger = np.flatnonzero(size > step)
        rows = first[larger] + step
        stronger = power[rows] > power[strongest[larger]]
        strongest[larger[stronger]] = rows[stronger]
    return strongest


def _sort_key(echoes: Returns) -> NDArray[np.int64]:
    """Sorts by beam, then range."""
    range_key = (echoes.range_m * (1.0 / _SORT_RANGE_STEP_M)).astype(np.int64)
    return (echoes.beam.astype(np.int64) << 32) | range_key
