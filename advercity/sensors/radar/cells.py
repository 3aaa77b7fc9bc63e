"""Resolution cells of a radar, and the power of paths in each.

Only cells with paths are kept. Their key is a number of four digits: velocity, azimuth, elevation
and range. Successive ranges are successive keys, with room for the windows of detectors.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from itertools import product

import numpy as np
from advercity_dsl import Radar
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar.antenna import build_directions, compute_angles, compute_range_cell_m
from advercity.sensors.radar.paths import Paths
from advercity.sensors.radar.surfaces import WAVENUMBER_PER_M

MARGIN_CELLS = 32
"""Cells beyond both ends of each axis, as room for windows."""
NEIGHBOUR_LEAKAGE = 0.25
"""Power of a target in the cell next to its own: -6 dB, for a Hann window."""
MIN_SPREAD_POWER = 1.0
"""Power over the noise from which fields are spread over cells."""
GHOSTS_PER_TARGET = 4.0
"""Ratio of mirrored to straight power up to which both are one target: a lossless mirror below a
target, as the road nearly is, adds three times the straight power."""

_TABLE_SIZE = 1 << 16
_HASH_FACTOR = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio, whose multiples spread evenly."""

Keys = NDArray[np.int64]


@dataclass(frozen=True)
class CellGrid:
    """The cells of a radar.

    Attributes:
        radar: The sensor.
        counts: Numbers of velocities, azimuths, elevations and ranges.
    """

    radar: Radar
    counts: tuple[int, int, int, int]

    @staticmethod
    def from_radar(radar: Radar) -> "CellGrid":
        """Build the grid of a radar."""
        counts = (
            math.ceil(2.0 * radar.max_speed_m_s / radar.speed_cell_m_s),
            math.ceil(radar.azimuth_fov_deg / radar.azimuth_cell_deg),
            math.ceil(radar.elevation_fov_deg / radar.elevation_cell_deg),
            math.ceil(radar.range_m / compute_range_cell_m(radar)),
        )
        return CellGrid(radar, counts)

    @property
    def size(self) -> int:
        """Number of all cells."""
        return math.prod(self.counts)

    @property
    def strides(self) -> tuple[int, int, int, int]:
        """Differences of keys from a cell to the next of each axis."""
        _, azimuths, elevations, ranges = (count + 2 * MARGIN_CELLS for count in self.counts)
        return azimuths * elevations * ranges, elevations * ranges, ranges, 1

    def fold(self, rate_m_s: FloatArray) -> FloatArray:
        """Fold velocities (n,) into the unambiguous interval."""
        limit = self.radar.max_speed_m_s
        return (rate_m_s + limit) % (2.0 * limit) - limit

    def locate(
        self, range_m: FloatArray, rate_m_s: FloatArray, direction: FloatArray
    ) -> NDArray[np.int64]:
        """Find the numbers (4, n) of the cells of targets along each axis."""
        pairs = zip(self._place(range_m, rate_m_s, direction), self.counts, strict=True)
        return np.stack([np.clip(item, 0, count - 1).astype(np.int64) for item, count in pairs])

    def compute_offsets(
        self, range_m: FloatArray, rate_m_s: FloatArray, direction: FloatArray
    ) -> FloatArray:
        """Compute the offsets (4, n) of targets from the middles of their cells, in cells."""
        places = np.stack(self._place(range_m, rate_m_s, direction))
        middles = self.locate(range_m, rate_m_s, direction) + 0.5
        return np.clip(places - middles, -0.5, 0.5)

    def _place(
        self, range_m: FloatArray, rate_m_s: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Compute the places of targets, in cells from the first edge of each axis."""
        radar = self.radar
        azimuth, elevation = np.degrees(compute_angles(direction))
        return (
            (self.fold(rate_m_s) + radar.max_speed_m_s) / radar.speed_cell_m_s,
            (azimuth + radar.azimuth_fov_deg / 2.0) / radar.azimuth_cell_deg,
            (elevation + radar.elevation_fov_deg / 2.0) / radar.elevation_cell_deg,
            range_m / compute_range_cell_m(radar),
        )

    def list_neighbours(self, keys: Keys) -> Keys:
        """List the keys (n, 8) of the next cells along each axis."""
        steps = [side * stride for stride in self.strides for side in (-1, 1)]
        return keys[:, None] + np.array(steps)

    def list_volume(self, free_m: Float64Array) -> tuple[FloatArray, FloatArray]:
        """List the directions (n, 3) and ranges (n,) of the middles of free cells.

        Cells are ordered by azimuth, elevation and range; `free_m` (azimuths, elevations) is the
        free range of each beam.
        """
        radar, (_, azimuths, elevations, ranges) = self.radar, self.counts
        azimuth = (np.arange(azimuths) + 0.5) * radar.azimuth_cell_deg - radar.azimuth_fov_deg / 2
        elevation = (np.arange(elevations) + 0.5) * radar.elevation_cell_deg
        elevation -= radar.elevation_fov_deg / 2.0
        range_m = (np.arange(ranges) + 0.5) * compute_range_cell_m(radar)
        beam, step = np.nonzero(range_m < free_m.reshape(-1, 1))
        across, up = (np.radians(part) for part in (azimuth, elevation))
        return build_directions(across[beam // elevations], up[beam % elevations]), range_m[step]

    def encode(self, numbers: NDArray[np.int64]) -> Keys:
        """Compute the keys (n,) of cells by their numbers (4, n)."""
        return np.asarray(self.strides) @ (numbers + MARGIN_CELLS)


@dataclass(frozen=True, eq=False)
class Cells:
    """The n cells with paths, by ascending key.

    Attributes:
        keys: (n,).
        power: (n,) mean of the scattered power, over the receiver's noise.
        field: (n,) complex root of the power that adds in phase, over the receiver's noise.
        range_m: (n,) mean of the paths, weighted by power.
        rate_m_s: (n,) mean of the paths, weighted by power, not folded.
        direction: (n, 3) mean of the paths, weighted by power, unit.
        instance: (n,) int32 id of the target with the most power.
        kind: (n,) uint8 kind of the target with the most power.
    """

    keys: Keys
    power: FloatArray
    field: NDArray[np.complex128]
    range_m: FloatArray
    rate_m_s: FloatArray
    direction: FloatArray
    instance: NDArray[np.int32]
    kind: NDArray[np.uint8]

    def look_up(self, values: FloatArray, keys: Keys) -> Float64Array:
        """Look up values (n,) of cells by keys (any shape); 0 for cells without paths."""
        if not len(self.keys):
            return np.zeros(keys.shape)
        row = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[row] == keys, values[row], 0.0)


def spread_fields(grid: CellGrid, cells: Cells) -> NDArray[np.complex128]:
    """Spread the fields (n,) of cells over the next ones, as a Hann window does.

    This adds up the parts of one target in several cells. A target keeps its full power in its own
    cell, as in a receiver with interpolated peaks.
    """
    rows = np.flatnonzero(np.abs(cells.field) ** 2 > MIN_SPREAD_POWER)
    spread, strong = cells.field.copy(), cells.field[rows]
    offsets = grid.compute_offsets(cells.range_m[rows], cells.rate_m_s[rows], cells.direction[rows])
    sides = (-1, 0, 1)
    own = compute_hann_response(offsets)
    relative = {side: compute_hann_response(side - offsets) / own for side in sides}
    for steps in product(sides, repeat=4):
        keys = cells.keys[rows] + np.dot(steps, grid.strides)
        into = np.minimum(np.searchsorted(cells.keys, keys), len(cells.keys) - 1)
        is_met = (cells.keys[into] == keys) & (keys != cells.keys[rows])
        factor = np.prod([relative[side][axis] for axis, side in enumerate(steps)], axis=0)
        spread[into[is_met]] += (factor * strong)[is_met]
    return spread


def compute_hann_response(offset_cells: FloatArray) -> FloatArray:
    """Compute the amplitude (any shape) of a target off a cell's middle, relative to the middle.

    On the border of two cells it is 0.85, a scalloping loss of 1.42 dB (Harris, Proc. IEEE 66, 51,
    1978, table 1); in the middle of the next cell it is 0.5.
    """
    beside = np.sinc(offset_cells - 1.0) + np.sinc(offset_cells + 1.0)
    return np.sinc(offset_cells) + 0.5 * beside


class NumberPurpose(IntEnum):
    """Purpose of a cell's random number; values decide bytes."""

    FIRST_LOOK = 0
    SECOND_LOOK = 1
    ECHO_PHASE = 2
    NOISE = 3
    NOISE_PHASE = 4
    WINDOW = 5


class CellNumbers:
    """Random numbers of cells; a cell's numbers do not depend on other echoes."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._exponential = rng.standard_exponential(_TABLE_SIZE)

    def draw_exponential(self, keys: Keys, purpose: NumberPurpose) -> Float64Array:
        """Draw exponential numbers of mean 1, shaped as the keys."""
        # One multiplication alone would give neighbours evenly spaced numbers.
        mixed = (keys.astype(np.uint64) * np.uint64(16) + np.uint64(purpose)) * _HASH_FACTOR
        mixed = (mixed ^ (mixed >> np.uint64(29))) * _HASH_FACTOR
        return self._exponential[(mixed >> np.uint64(48)).astype(np.intp)]

    def draw_phasor(self, keys: Keys, purpose: NumberPurpose) -> NDArray[np.complex128]:
        """Draw complex numbers of magnitude 1."""
        # The exponential of a negative exponential number is even between 0 and 1.
        return np.exp(2j * math.pi * np.exp(-self.draw_exponential(keys, purpose)))


def collect_cells(grid: CellGrid, paths: Paths, snr_factor: FloatArray) -> Cells:
    """Sum up paths by cell; `snr_factor` (n,) converts strengths to signal-to-noise ratios."""
    keys, cell = np.unique(
        grid.encode(grid.locate(paths.range_m, paths.rate_m_s, paths.direction)),
        return_inverse=True,
    )
    scattered = paths.strength * snr_factor
    field = paths.field * np.sqrt(snr_factor).astype(np.complex128)
    weight = scattered + np.abs(field) ** 2 + 1e-30
    total = np.bincount(cell, weight, len(keys))

    def average(values: FloatArray) -> FloatArray:
        return np.bincount(cell, weight * values, len(keys)) / total

    direction = np.stack([average(axis) for axis in paths.direction.T], axis=1)
    strongest = _find_strongest(cell, weight, paths, len(keys))
    return Cells(
        keys=keys,
        power=_interfere(paths, cell, scattered, len(keys)),
        field=_sum_complex(cell, field, len(keys)),
        range_m=average(paths.range_m),
        rate_m_s=average(paths.rate_m_s),
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        instance=paths.instance[strongest],
        kind=paths.kind[strongest],
    )


def _interfere(paths: Paths, cell: IndexArray, power: FloatArray, count: int) -> FloatArray:
    """Add straight and mirrored waves to powers (count,), which fade as far as detours agree.

    Straight and mirrored waves come from the same surfaces. Where all detours in a cell are alike,
    their fields add; where they vary by more than a wavelength, their powers add.
    """
    # A mirror on one leg turns the phase; on both legs it turns it back.
    turned = np.where(paths.mirrorings == 1, -1.0, 1.0)
    phasor = turned * np.exp(-1j * WAVENUMBER_PER_M * paths.detour_m.astype(np.float64))
    together, alone = np.zeros(count, complex), np.zeros(count)
    for mirrorings in range(3):
        rows = np.flatnonzero((paths.mirrorings == mirrorings) & (power > 0.0))
        own = np.bincount(cell[rows], power[rows], count)
        agreed = _sum_complex(cell[rows], power[rows].astype(np.complex128) * phasor[rows], count)
        root = np.sqrt(np.maximum(own, 1e-30))
        together += agreed / root
        alone += own - np.abs(agreed / root) ** 2
    return np.abs(together) ** 2 + np.maximum(alone, 0.0)


def _sum_complex(
    cell: IndexArray, values: NDArray[np.complex128], count: int
) -> NDArray[np.complex128]:
    real, imaginary = (np.bincount(cell, part, count) for part in (values.real, values.imag))
    return real + 1j * imaginary


def _find_strongest(cell: IndexArray, weight: FloatArray, paths: Paths, count: int) -> IndexArray:
    """Find a row (count,) of the target with the most power in every cell."""
    weight = np.where(paths.kind == PointKind.GHOST, weight / GHOSTS_PER_TARGET, weight)
    order = np.lexsort((paths.kind, paths.instance, cell))
    columns = np.stack([cell, paths.instance, paths.kind])[:, order]
    is_first = np.ones(len(order), np.bool_)
    is_first[1:] = (columns[:, 1:] != columns[:, :-1]).any(axis=0)
    first = np.flatnonzero(is_first)
    total = np.add.reduceat(weight[order], first)
    best = _find_largest(cell[order[first]], total, count)
    return order[first[best]]


def _find_largest(cell: IndexArray, value: FloatArray, count: int) -> IndexArray:
    """Find the row (count,) of the largest value of every cell."""
    order = np.lexsort((value, cell))
    return order[np.cumsum(np.bincount(cell, minlength=count)) - 1]
