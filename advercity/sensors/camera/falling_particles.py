"""Drops and flakes in the air near a camera, each at its own position in the world.

Particles of nearly one size fall alike, so each size is a rigid block of cells, repeated in all
directions and moved with the particles' velocity. The position of every particle at any time is a
closed formula: all cameras see the same particles, and frames can be computed in any order.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.physics.precipitation import (
    CAMERA_HEIGHT_M,
    wind_at_height,
)
from advercity.physics.weather_parts.part import Precipitation, load_all_physics
from advercity.randomness import create_generator

CELLS_PER_EDGE = 16
"""Cells along each edge of a block."""
PARTICLES_PER_BLOCK = 2**16
"""Mean number of particles in a block."""
GUSTINESS = 0.3
"""Standard deviation of the wind on flakes, relative to its mean."""
SWAY_HZ = 0.8
SWAY_CYCLE_RAD = 20.0 * math.pi
"""Phase after which a sway, of three frequencies, repeats."""


@dataclass(frozen=True, eq=False)
class FallingParticles:
    """n particles at one moment.

    Attributes:
        position: (n, 3) metres from the requested centre, world axes.
        velocity: (n, 3) m/s.
        diameter_m: (n,) in the air, not melted.
        glint: (n,) brightness relative to the mean of its size.
    """

    position: FloatArray
    velocity: FloatArray
    diameter_m: FloatArray
    glint: FloatArray

    @staticmethod
    def concatenate(parts: Sequence["FallingParticles"]) -> "FallingParticles":
        """Join groups of particles, in order."""
        if not parts:
            return FallingParticles(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0))
        columns = zip(*([*vars(part).values()] for part in parts), strict=True)
        return FallingParticles(*(np.concatenate(column) for column in columns))

    def select(self, where: NDArray[Any]) -> "FallingParticles":
        """Select particles by index or mask."""
        return FallingParticles(*(column[where] for column in vars(self).values()))


@dataclass(frozen=True)
class ParticleBand:
    """A band of sizes and fall speeds.

    Attributes:
        part: The particles at the moment with the most of them.
        low_mm: Least (melted) diameter.
        high_mm: Largest (melted) diameter.
        fall: Fall speed relative to the part's `speed_m_s`.
        fraction: Fraction of the particles of these sizes with this fall speed.
        key: Random key of the band.
    """

    part: Precipitation
    low_mm: float
    high_mm: float
    fall: float
    fraction: float
    key: tuple[int | str, ...]

    def number_m3(self, part: Precipitation) -> float:
        """Compute the mean number of particles per m³."""
        above = part.sizes.number_concentration_above
        return self.fraction * float(above(self.low_mm) - above(self.high_mm))

    def velocity(self, part: Precipitation, air: Atmosphere) -> Float64Array:
        """Compute the velocity (3,) of the particles in m/s."""
        return wind_at_height(air.wind, CAMERA_HEIGHT_M) - [0.0, 0.0, part.speed_m_s * self.fall]

    def sway_m(self, air: Atmosphere) -> float:
        """Compute the amplitude by which gusts sway the particles."""
        if not self.part.sways:
            return 0.0
        gust = GUSTINESS * float(np.linalg.norm(wind_at_height(air.wind, CAMERA_HEIGHT_M)))
        return gust * math.sqrt(2.0) / (2.0 * math.pi * SWAY_HZ)


@dataclass(frozen=True, eq=False)
class ParticleBlock:
    """Particles of nearly one size and speed.

    Attributes:
        band: Their sizes and fall speed.
        number_m3: Mean number of particles per m³.
        velocity: Velocity (3,) of the whole block, m/s.
        cell_m: Edge of a cell.
        cell_starts: (cells + 1,) first particle of each cell in the arrays below.
        offset_m: (n, 3) float32 position within the cell, metres.
        diameter_m: (n,) float32.
        glint: (n,) float32 as in `FallingParticles`.
        sway_m: Amplitude by which gusts move a particle.
        phase: (n,) float32 phase of the sway, radians; empty without sway.
        path_m: (3,) path of the block so far; None if its velocity is constant.
        shown: Fraction of the particles in the air now.
    """

    band: ParticleBand
    number_m3: float
    velocity: Float64Array
    cell_m: float
    cell_starts: NDArray[np.intp]
    offset_m: NDArray[np.float32]
    diameter_m: NDArray[np.float32]
    glint: NDArray[np.float32]
    sway_m: float
    phase: NDArray[np.float32]
    path_m: Float64Array | None = None
    shown: float = 1.0

    @property
    def kind(self) -> str:
        """Name of the part of the weather."""
        return self.band.part.name

    @property
    def max_diameter_m(self) -> float:
        """Largest diameter in the block."""
        return float(self.diameter_m.max(initial=0.0))

    @property
    def fall_speed_m_s(self) -> float:
        """Downward speed."""
        return -float(self.velocity[2])

    def find_particles(
        self, planes: Float64Array, corners: Float64Array, around: Float64Array, time_s: float
    ) -> FallingParticles:
        """Find the particles of all cells that intersect a convex volume; some are outside it.

        Args:
            planes: (p, 4): unit normal inwards and offset; a point x is inside if n·x + d >= 0.
            corners: (k, 3) of the volume; like `planes` in metres from `around`, world axes.
            around: Centre (3,) in the world.
            time_s: Time since the scenario's start.
        """
        # In cells, in the axes of the moving block; integer parts are split off for precision.
        path_m = self.velocity * time_s if self.path_m is None else self.path_m
        origin = (around - path_m) / self.cell_m
        base = np.floor(origin)
        margin = self.cell_m + self.sway_m
        low = np.floor((corners.min(axis=0) - margin) / self.cell_m).astype(np.intp)
        high = np.ceil((corners.max(axis=0) + margin) / self.cell_m).astype(np.intp)
        axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        corner = (cells + base - origin) * self.cell_m
        centre, radius = corner + self.cell_m / 2.0, self.cell_m * math.sqrt(0.75) + self.sway_m
        visible = np.all(centre @ planes[:, :3].T + planes[:, 3] >= -radius, axis=1)
        corner, cells = corner[visible].astype(np.float32), cells[visible] + base.astype(np.intp)
        strides = np.array([CELLS_PER_EDGE * CELLS_PER_EDGE, CELLS_PER_EDGE, 1])
        column = np.mod(cells, CELLS_PER_EDGE) @ strides
        count = self.cell_starts[column + 1] - self.cell_starts[column]
        run = np.repeat(np.arange(len(column)), count)
        start = self.cell_starts[column] - np.cumsum(count) + count
        row = np.arange(len(run)) + start[run]
        if self.shown < 1.0:
            # The golden ratio spreads the chosen particles evenly over any part of the block. The
            # particles of lighter rain also fall in heavier rain.
            falls = row * GOLDEN_FRACTION % 1.0 < self.shown
            row, run = row[falls], run[falls]
        position = corner[run] + self.offset_m[row]
        velocity = np.broadcast_to(self.velocity.astype(np.float32), position.shape)
        if self.sway_m:
            # Frequencies of 1 : 1.3 : 2 do not trace a visible loop.
            omega = 2.0 * math.pi * SWAY_HZ
            angle = self.phase[row] + np.float32(math.fmod(omega * time_s, SWAY_CYCLE_RAD))
            swing = np.stack([np.sin(angle), np.cos(1.3 * angle), 0.4 * np.sin(2.0 * angle)], 1)
            swing_speed = np.stack(
                [np.cos(angle), -1.3 * np.sin(1.3 * angle), 0.8 * np.cos(2.0 * angle)], 1
            )
            position = position + np.float32(self.sway_m) * swing
            velocity = velocity + np.float32(self.sway_m * omega) * swing_speed
        return FallingParticles(position, velocity, self.diameter_m[row], self.glint[row])


def build_particle_blocks(
    air: Atmosphere,
    *key: int | str,
    all_moments: Sequence[Precipitation] | None = None,
) -> tuple[ParticleBlock, ...]:
    """Build the blocks of all drops and flakes large enough to see, the same for the same key.

    `all_moments` is the precipitation at all moments of a changing weather; each block then has the
    largest number of particles of any moment, and `move_blocks` selects from them.
    """
    found = air.extinction.precipitation if all_moments is None else all_moments
    by_name = [[part for part in found if part.name == name] for name in load_all_physics()]
    return tuple(
        _build_block(
            replace(band, part=max(parts, key=band.number_m3)),
            air,
            key,
            changes=all_moments is not None,
        )
        for parts in by_name
        if parts
        for band in _list_bands(max(parts, key=lambda part: part.sizes.max_melted_mm))
    )


def move_blocks(
    blocks: Sequence[ParticleBlock], air: Atmosphere, air_path_m: Float64Array, time_s: float
) -> tuple[ParticleBlock, ...]:
    """Return the blocks at a moment of a changing weather.

    Args:
        blocks: Blocks with the sizes of all moments.
        air: Atmosphere of the moment.
        air_path_m: (3,) path of the air; downwards, of flakes in it; from `WeatherTimeline`.
        time_s: Time since drops and stones began to fall.
    """
    parts = {part.name: part for part in air.extinction.precipitation}
    return tuple(
        replace(
            block,
            velocity=band.velocity(parts[block.kind], air),
            sway_m=band.sway_m(air),
            path_m=_compute_path_m(band, air_path_m, time_s),
            shown=band.number_m3(parts[block.kind]) / block.number_m3,
        )
        for block in blocks
        for band in [block.band]
        if block.kind in parts
    )


def _compute_path_m(band: ParticleBand, air_path_m: Float64Array, time_s: float) -> Float64Array:
    fallen_m = air_path_m[2] if band.part.sways else -time_s
    return np.array([*air_path_m[:2], band.fall * fallen_m])


def _list_bands(part: Precipitation) -> Iterator[ParticleBand]:
    largest_mm, factors = part.sizes.max_melted_mm, part.speed_factors
    edges_mm = (*(edge for edge in part.bands_mm if edge < largest_mm), largest_mm)
    for low_mm, high_mm in itertools.pairwise(edges_mm):
        fall = float(part.compute_speed((low_mm + high_mm) / 2.0))
        for number, factor in enumerate(factors):
            key = (part.name, round(low_mm * 10), *((number,) if len(factors) > 1 else ()))
            yield ParticleBand(part, low_mm, high_mm, factor * fall, 1.0 / len(factors), key)


def _build_block(
    band: ParticleBand,
    air: Atmosphere,
    key: tuple[int | str, ...],
    *,
    changes: bool,
) -> ParticleBlock:
    """Draw the particles of a band; if the weather `changes`, flakes get a phase even in calm."""
    part, sizes = band.part, band.part.sizes
    rng, sway_m = create_generator(*key, *band.key), band.sway_m(air)
    number_m3 = band.number_m3(part)
    cell_m = (PARTICLES_PER_BLOCK / number_m3) ** (1.0 / 3.0) / CELLS_PER_EDGE
    count = rng.poisson(PARTICLES_PER_BLOCK / CELLS_PER_EDGE**3, CELLS_PER_EDGE**3)
    starts = np.concatenate([[0], np.cumsum(count)]).astype(np.intp)
    offset = rng.random((starts[-1], 3), np.float32) * np.float32(cell_m)
    least_mm = np.full(starts[-1], band.low_mm)
    diameter_mm = sizes.sample_diameters_mm(least_mm, rng.random(starts[-1]), band.high_mm)
    sways = sway_m > 0.0 or (changes and part.sways)
    phase = rng.random(starts[-1] if sways else 0, np.float32) * np.float32(SWAY_CYCLE_RAD)
    diameter_m = (diameter_mm * sizes.air_to_melted_diameter * 1e-3).astype(np.float32)
    spread = part.glint_deviation
    # Mean 1 of a log-normal distribution.
    glint = np.exp(spread * rng.standard_normal(starts[-1]) - spread**2 / 2.0).astype(np.float32)
    return ParticleBlock(
        band,
        number_m3,
        band.velocity(part, air),
        cell_m,
        starts,
        offset,
        diameter_m,
        glint,
        sway_m,
        phase,
    )
