"""Echoes of air that is thick with droplets or grains: fog, dust.

Light scattered all along the beam adds up to one broad echo near the sensor (Rasshofer, Spies and
Spies 2011). Tabulated once per weather; a beam costs a few look-ups.

Echoes of single drops and flakes that fly through a beam.

Particles that send back enough are rare and independent, so how many a beam meets is a Poisson
number. Rate, range and size come from tables made once per weather; no particle is simulated.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.geometry.poses import Matrix
from advercity.physics.extinction import AirExtinction
from advercity.physics.precipitation import ParticleSizeDistribution
from advercity.sensors.lidar.beams import (
    BEAM_APERTURE_M,
    BEAM_DIVERGENCE_RAD,
    BeamGrid,
    beam_directions,
)
from advercity.sensors.lidar.random_streams import NUM_LEVELS, draw_levels
from advercity.sensors.lidar.received_power import PULSE_LENGTH_M, received_power
from advercity.sensors.measurements import PointKind
from advercity.sensors.spray_plumes import (
    MAX_PLUME_DISTANCE_M,
    MIN_SPRAY_SPEED_M_S,
    PLUME_DECAY_M,
    PLUME_HEIGHT_M,
    PLUME_LENGTH_M,
    SPRAY_EXTINCTION_PER_G_M3,
    SPRAY_REFERENCE_SPEED_M_S,
    SPRAY_WATER_G_M3,
    SPRAYING_CLASSES,
)

_UNIT_BOX_CORNERS = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(
    -1, 3
)


@dataclass(frozen=True, eq=False)
class PlumeCrossing:
    """Beams (k,) through one plume: where they enter, how far they go in it, how thick it is."""

    beam: IndexArray
    enter_m: FloatArray
    through_m: FloatArray
    extinction: FloatArray


def find_plume_crossings(
    lidar: Lidar, world_from_lidar: Matrix, states: Iterable[ActorState]
) -> Iterator[PlumeCrossing]:
    """Every plume that beams of a LiDAR go through.

    Args:
        lidar: The sensor.
        world_from_lidar: (4, 4) where it is.
        states: Everybody on the road.
    """
    directions, fan = beam_directions(lidar), BeamGrid.from_lidar(lidar, world_from_lidar)
    for state in states:
        if state.speed_m_s < MIN_SPRAY_SPEED_M_S or state.actor.actor_class not in SPRAYING_CLASSES:
            continue
        length, width, _ = state.actor.size
        middle = np.array([-(length + PLUME_LENGTH_M) / 2.0, 0.0, PLUME_HEIGHT_M / 2.0])
        world_from_plume = state.world_from_body @ poses.pose_matrix(middle)
        half = np.array([PLUME_LENGTH_M, width, PLUME_HEIGHT_M]) / 2.0
        if np.linalg.norm(world_from_plume[:3, 3] - world_from_lidar[:3, 3]) > MAX_PLUME_DISTANCE_M:
            continue
        plume_from_lidar = poses.invert_pose(world_from_plume) @ world_from_lidar
        thickness = SPRAY_EXTINCTION_PER_G_M3 * SPRAY_WATER_G_M3
        thickness *= (state.speed_m_s / SPRAY_REFERENCE_SPEED_M_S) ** 2
        rows = fan.find_beams_towards(
            poses.transform_points(world_from_plume, _UNIT_BOX_CORNERS * half)
        )
        yield _intersect_plume(directions[rows], rows, plume_from_lidar, half, thickness)


def _intersect_plume(
    directions: FloatArray,
    rows: IndexArray,
    plume_from_lidar: Matrix,
    half: Matrix,
    thickness: float,
) -> PlumeCrossing:
    """Slab test of rays from the LiDAR against a box around the plume's origin."""
    own = directions @ plume_from_lidar[:3, :3].T.astype(np.float32)
    start, reach = plume_from_lidar[:3, 3].astype(np.float32), half.astype(np.float32)
    slope = 1.0 / np.where(np.abs(own) < 1e-6, np.float32(1e-6), own)
    one, other = (-reach - start) * slope, (reach - start) * slope
    enter = np.minimum(one, other).max(axis=1).clip(0.0)
    leave = np.maximum(one, other).min(axis=1)
    inside = np.flatnonzero(leave > enter)
    enter, leave, own = enter[inside], leave[inside], own[inside]
    behind = reach[0] - (start[0] + own[:, 0] * (enter + leave) / 2.0)
    return PlumeCrossing(
        beam=rows[inside],
        enter_m=enter,
        through_m=leave - enter,
        extinction=np.float32(thickness) * np.exp(-behind / np.float32(PLUME_DECAY_M)),
    )


LIDAR_RATIO_SR = {"fog": 18.8, "dust": 50.0, "spray": 20.0}
"""Extinction over backscatter: O'Connor et al., JTECH 21, 777 (2004) for droplets."""
MIN_RANGE_M = 0.5
LOG_POWER_DEVIATION = 0.3
"""Standard deviation of the logarithm of an echo: droplets are never evenly spread."""
MAX_RANGE_M = 60.0
RANGE_STEP_M = 0.02
NUM_PROFILE_LEVELS = 256
NUM_RANGE_QUANTILES = 1 << 16
MAX_PROFILE_CUT = 0.95
"""Of the peak: an echo that only noise lifts over the threshold comes from there."""


@dataclass(frozen=True, eq=False)
class SoftTarget:
    """Fog, dust or both at once, as tables over range.

    Attributes:
        profile: (m,) power by apparent range, `NEAREST_M` + i `STEP_M`, against the threshold.
        dust_fraction: Share of the echo that dust sends.
    """

    profile: FloatArray
    dust_fraction: float
    _mass: FloatArray
    """Integral of the profile (m,) from the nearest range, from 0 to 1."""
    _range_of_mass: FloatArray
    """Its inverse at even steps."""
    _mass_from: FloatArray
    """Mass (CUTS + 1,) below the range where the profile rises through each share of its peak."""
    _mass_to: FloatArray
    """The same for where it falls through it."""

    @staticmethod
    def from_extinction(extinction: AirExtinction) -> "SoftTarget | None":
        """Tabulate the fog and dust of an air; None if it has neither."""
        by_fog = extinction.fog.at_905nm / LIDAR_RATIO_SR["fog"]
        by_dust = extinction.dust.at_905nm / LIDAR_RATIO_SR["dust"]
        if not by_fog and not by_dust:
            return None
        range_m = np.arange(MIN_RANGE_M, MAX_RANGE_M, RANGE_STEP_M)
        profile = pulse_profile(range_m, by_fog + by_dust, extinction.at_905nm)
        mass = np.cumsum(profile) - profile[0]
        mass /= mass[-1]
        levels = profile.max() * np.arange(NUM_PROFILE_LEVELS + 1) / NUM_PROFILE_LEVELS
        peak = int(profile.argmax())
        rise = np.searchsorted(profile[: peak + 1], levels).clip(0, peak)
        fall = len(profile) - 1 - np.searchsorted(profile[:peak:-1], levels)
        steps = np.linspace(0.0, 1.0, NUM_RANGE_QUANTILES)
        return SoftTarget(
            profile=profile.astype(np.float32),
            dust_fraction=by_dust / (by_fog + by_dust),
            _mass=mass.astype(np.float32),
            _range_of_mass=np.interp(steps, mass, range_m).astype(np.float32),
            _mass_from=mass[rise].astype(np.float32),
            _mass_to=mass[fall].astype(np.float32),
        )

    @property
    def peak_power(self) -> float:
        """Power of the strongest echo."""
        return float(self.profile.max())

    def sample(
        self, gain: FloatArray, end_m: FloatArray, uniform: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Range and power (n,) of the echo of every beam; where there is no room, power is 0.

        An echo comes from where the profile is above the threshold, more often from where it is
        high; its power is that of the peak, which fluctuates.

        Args:
            gain: (n,) factor on the profile, fluctuation included.
            end_m: (n,) where each beam is stopped; inf if nowhere.
            uniform: (n,) random numbers from 0 to 1.
        """
        power = gain * np.float32(self.peak_power)
        with np.errstate(divide="ignore"):
            cut = np.minimum(np.float32(1.0) / power, np.float32(MAX_PROFILE_CUT))
        level = (cut * NUM_PROFILE_LEVELS).astype(np.int32)
        first, last = self._mass_from.take(level), self._mass_to.take(level)
        room = np.minimum(end_m, MAX_RANGE_M) - np.float32(PULSE_LENGTH_M + MIN_RANGE_M)
        cell = (np.maximum(room, 0.0) * (1.0 / RANGE_STEP_M)).astype(np.int32)
        last = np.minimum(last, self._mass.take(cell, mode="clip"))
        width = np.maximum(last - first, 0.0)
        at = (first + uniform * width) * np.float32(NUM_RANGE_QUANTILES - 1)
        power *= width > 0.0
        return self._range_of_mass.take((at + np.float32(0.5)).astype(np.int32)), power


def pulse_profile(
    range_m: Float64Array, backscatter: float, extinction_per_m: float
) -> Float64Array:
    """Power (n,) against the threshold of a layer without end, by apparent range.

    A pulse of the shape sine squared, that stretches over twice `PULSE_LENGTH_M`, gathers light
    from all that it covers; the delay of its own middle is taken off.

    Args:
        range_m: (n,) metres.
        backscatter: 1/(m sr).
        extinction_per_m: Of the air, at 905 nm.
    """
    step = PULSE_LENGTH_M / 32.0
    along = (np.arange(64) + 0.5) * step
    shape = np.sin(np.pi * along / (2.0 * PULSE_LENGTH_M)) ** 2 * step
    reached = range_m[:, None] + PULSE_LENGTH_M - along
    layer = received_power(
        np.maximum(reached, 0.0), np.full_like(reached, math.pi * backscatter), extinction_per_m
    )
    return np.where(reached > 0.0, layer, 0.0) @ shape


PARTICLE_REFLECTANCE = {"rain": 0.05, "snow": 0.2}
"""Of a drop seen from a few mrad beside the beam, where the glory right behind it is missed; of a
flake."""
PARTICLE_POINT_KIND = {"rain": PointKind.RAIN, "snow": PointKind.SNOW}
PARTICLE_MIN_RANGE_M = 0.5
PARTICLE_MAX_RANGE_M = 60.0
PARTICLE_RANGE_STEP_M = 0.02
MIN_PARTICLE_POWER = 0.4
"""Weaker particles are left out; three standard deviations of noise would have to help."""


@dataclass(frozen=True, eq=False)
class ParticleTable:
    """How often, where and how strongly a beam meets particles of one kind."""

    sizes: ParticleSizeDistribution
    expected: float
    """Particles of at least `LEAST_POWER` that a beam meets."""
    range_m: FloatArray
    """Where they are: quantiles (LEVELS,)."""
    min_diameter_mm: FloatArray
    """Melted diameter (LEVELS,) there of a particle of that power."""

    @staticmethod
    def build(sizes: ParticleSizeDistribution, extinction_per_m: float) -> "ParticleTable":
        """The table for air of that extinction at 905 nm."""
        range_m = np.arange(PARTICLE_MIN_RANGE_M, PARTICLE_MAX_RANGE_M, PARTICLE_RANGE_STEP_M)
        least_mm = min_detectable_diameter_mm(range_m, sizes, extinction_per_m, MIN_PARTICLE_POWER)
        per_m = beam_cross_section_m2(range_m) * sizes.number_concentration_above(least_mm)
        steps = np.concatenate([[0.0], (per_m[1:] + per_m[:-1]) / 2.0 * PARTICLE_RANGE_STEP_M])
        met = np.cumsum(steps)
        middle = np.interp((np.arange(NUM_LEVELS) + 0.5) * (met[-1] / NUM_LEVELS), met, range_m)
        least = np.interp(middle, range_m, least_mm)
        return ParticleTable(
            sizes, float(met[-1]), middle.astype(np.float32), least.astype(np.float32)
        )

    def sample(
        self, beams: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
        """Beam (k,) ascending, range (k,) and power (k,) of all that a turn of beams meets.

        As if nothing else stood in the way; what is behind a surface is for the caller to drop.
        """
        count = int(rng.poisson(beams * self.expected))
        beam = np.sort(rng.integers(beams, size=count, dtype=np.int32))
        level = draw_levels(rng, count)
        least_mm = self.min_diameter_mm.take(level)
        diameter_mm = least_mm + self._sample_excess_mm(least_mm, rng.random(count, np.float32))
        power = np.float32(MIN_PARTICLE_POWER) * (diameter_mm / least_mm) ** 2
        return beam, self.range_m.take(level), power

    def _sample_excess_mm(self, least_mm: FloatArray, uniform: FloatArray) -> FloatArray:
        """How much larger (k,) than the least each is: exponential, cut at the largest."""
        slope = np.float32(self.sizes.slope_per_mm)
        cut = 1.0 - np.exp(-slope * np.maximum(self.sizes.max_melted_mm - least_mm, 0.0))
        return -np.log1p(-uniform * cut) / slope


def beam_cross_section_m2(range_m: Float64Array) -> Float64Array:
    """Cross-section (n,) of a beam, an ellipse."""
    wide, high = (
        size + opening * range_m
        for size, opening in zip(BEAM_APERTURE_M, BEAM_DIVERGENCE_RAD, strict=True)
    )
    return math.pi / 4.0 * wide * high


def min_detectable_diameter_mm(
    range_m: Float64Array, sizes: ParticleSizeDistribution, extinction_per_m: float, power: float
) -> Float64Array:
    """Melted diameter (n,) of a particle that returns `power`, against the threshold."""
    filling = received_power(
        range_m, np.full_like(range_m, PARTICLE_REFLECTANCE[sizes.kind]), extinction_per_m
    )
    area_m2 = power / filling * beam_cross_section_m2(range_m)
    return np.sqrt(area_m2 * 4.0 / math.pi) * 1e3 / sizes.air_to_melted_diameter
