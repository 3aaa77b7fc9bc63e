"""Returns from within the air: fog and dust, single drops and flakes, plumes of spray.

Fog and dust scatter all along the beam, which adds up to one broad return near the sensor
(Rasshofer, Spies and Spies 2011). Drops and flakes large enough for detection are rare and
independent, so the number in a beam is Poisson distributed. Both are tabulated once per weather: a
beam costs a few look-ups, and no particle is simulated.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.geometry.poses import Matrix
from advercity.physics.extinction import AirExtinction
from advercity.physics.weather_parts.part import Precipitation
from advercity.sensors.lidar.beams import (
    FIRST_SCAN,
    BeamGrid,
    BeamShape,
    ScanTime,
    beam_directions,
)
from advercity.sensors.lidar.random_streams import NUM_LEVELS, draw_levels
from advercity.sensors.lidar.received_power import Receiver
from advercity.sensors.spray_plumes import (
    MAX_PLUME_DISTANCE_M,
    PLUME_DECAY_M,
    SprayPlume,
    intersect_box,
    iterate_spraying_states,
)

SPRAY_LIDAR_RATIO_SR = 20.0
"""Extinction over backscatter, for droplets."""
MIN_RANGE_M, MAX_RANGE_M, RANGE_STEP_M = 0.5, 60.0, 0.02
"""Tabulated ranges; beyond, neither fog nor particles are detected."""
LOG_POWER_DEVIATION = 0.3
"""Standard deviation of the logarithm of a return: droplets are never evenly spread."""
NUM_PROFILE_LEVELS = 256
NUM_RANGE_QUANTILES = 1 << 16
MAX_PROFILE_CUT = 0.95
"""Highest cut relative to the peak: returns lifted by noise alone come from near the peak."""


@dataclass(frozen=True, eq=False)
class SoftTarget:
    """Floating particles, as tables over range.

    Attributes:
        profile: (m,) power relative to the threshold by apparent range, in steps of `RANGE_STEP_M`
            from `MIN_RANGE_M`.
        fractions: Fraction of the backscatter of each part of the weather, by name.
        pulse_length_m: Half the length of the receiver's pulses.
    """

    profile: FloatArray
    fractions: Mapping[str, float]
    pulse_length_m: float
    _mass: FloatArray
    """(m,) integral of the profile from the least range, 0 to 1."""
    _range_of_mass: FloatArray
    """Inverse of `_mass`, at even steps."""
    _mass_from: FloatArray
    """(levels + 1,) mass up to the rise of the profile through each level."""
    _mass_to: FloatArray
    """(levels + 1,) mass up to the fall of the profile through each level."""

    @staticmethod
    def from_extinction(
        extinction: AirExtinction, extinction_per_m: float, receiver: Receiver
    ) -> "SoftTarget | None":
        """Tabulate floating particles for a receiver; None if there are none.

        Args:
            extinction: Extinction of the air, part by part.
            extinction_per_m: Extinction of the light in the receiver's view.
            receiver: The receiver.
        """
        backscatter = {
            part.name: part.extinction.at_905nm / part.lidar_ratio_sr
            for part in extinction.suspended
            if part.lidar_ratio_sr
        }
        if not backscatter:
            return None
        total = sum(backscatter.values())
        range_m = np.arange(MIN_RANGE_M, MAX_RANGE_M, RANGE_STEP_M)
        profile = pulse_profile(range_m, total, extinction_per_m, receiver)
        mass = np.cumsum(profile) - profile[0]
        mass /= mass[-1]
        levels = profile.max() * np.arange(NUM_PROFILE_LEVELS + 1) / NUM_PROFILE_LEVELS
        peak = int(profile.argmax())
        rise = np.searchsorted(profile[: peak + 1], levels).clip(0, peak)
        fall = len(profile) - 1 - np.searchsorted(profile[:peak:-1], levels)
        steps = np.linspace(0.0, 1.0, NUM_RANGE_QUANTILES)
        return SoftTarget(
            profile=profile.astype(np.float32),
            fractions={name: value / total for name, value in backscatter.items()},
            pulse_length_m=receiver.pulse_length_m,
            _mass=mass.astype(np.float32),
            _range_of_mass=np.interp(steps, mass, range_m).astype(np.float32),
            _mass_from=mass[rise].astype(np.float32),
            _mass_to=mass[fall].astype(np.float32),
        )

    @property
    def peak_power(self) -> float:
        """Power of the strongest return, relative to the threshold."""
        return float(self.profile.max())

    def sample(
        self, gain: FloatArray, end_m: FloatArray, uniform: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Draw the range and power (n,) of the return of every beam.

        The range is distributed as the part of the profile above the threshold. The power is the
        fluctuating peak, and 0 where a surface leaves no room in front.

        Args:
            gain: (n,) factor on the profile, including fluctuation.
            end_m: (n,) range of each beam's first surface; inf if there is none.
            uniform: (n,) random numbers from 0 to 1.
        """
        power = gain * np.float32(self.peak_power)
        with np.errstate(divide="ignore"):
            cut = np.minimum(np.float32(1.0) / power, np.float32(MAX_PROFILE_CUT))
        level = (cut * NUM_PROFILE_LEVELS).astype(np.int32)
        first, last = self._mass_from.take(level), self._mass_to.take(level)
        room = np.minimum(end_m, MAX_RANGE_M) - np.float32(self.pulse_length_m + MIN_RANGE_M)
        cell = (np.maximum(room, 0.0) * (1.0 / RANGE_STEP_M)).astype(np.int32)
        last = np.minimum(last, self._mass.take(cell, mode="clip"))
        width = np.maximum(last - first, 0.0)
        at = (first + uniform * width) * np.float32(NUM_RANGE_QUANTILES - 1)
        power *= width > 0.0
        return self._range_of_mass.take((at + np.float32(0.5)).astype(np.int32)), power


def pulse_profile(
    range_m: Float64Array, backscatter: float, extinction_per_m: float, receiver: Receiver
) -> Float64Array:
    """Compute the power (n,) returned by an unbounded layer, relative to the threshold.

    A sine-squared pulse, twice the receiver's `pulse_length_m`, integrates over its length; the
    delay of its own centre is subtracted.

    Args:
        range_m: (n,) apparent range, metres.
        backscatter: Backscatter coefficient of the layer, 1/(m sr).
        extinction_per_m: Extinction coefficient of the air at 905 nm.
        receiver: The receiver.
    """
    pulse_m = receiver.pulse_length_m
    step = pulse_m / 32.0
    along = (np.arange(64) + 0.5) * step
    shape = np.sin(np.pi * along / (2.0 * pulse_m)) ** 2 * step
    scatterer_m = range_m[:, None] + pulse_m - along
    layer = receiver.received_power(
        np.maximum(scatterer_m, 0.0),
        np.full_like(scatterer_m, math.pi * backscatter),
        extinction_per_m,
    )
    return np.where(scatterer_m > 0.0, layer, 0.0) @ shape


MIN_PARTICLE_POWER = 0.4
"""Power below which particles are left out: noise would have to add three standard deviations."""


@dataclass(frozen=True, eq=False)
class ParticleTable:
    """Rate, range and power of the particles of one kind in a beam.

    Attributes:
        part: The particles.
        expected: Mean number of particles per beam with at least `MIN_PARTICLE_POWER`.
        range_m: (NUM_LEVELS,) quantiles of their ranges.
        min_diameter_mm: (NUM_LEVELS,) melted diameter of a particle with this power, by range.
    """

    part: Precipitation
    expected: float
    range_m: FloatArray
    min_diameter_mm: FloatArray

    @staticmethod
    def build(
        part: Precipitation,
        extinction_per_m: float,
        receiver: Receiver,
        beam: BeamShape,
    ) -> "ParticleTable":
        """Tabulate particles in air of an extinction coefficient at 905 nm."""
        range_m = np.arange(MIN_RANGE_M, MAX_RANGE_M, RANGE_STEP_M)
        least_mm = min_detectable_diameter_mm(
            range_m, part, extinction_per_m, receiver, beam, MIN_PARTICLE_POWER
        )
        number_m3 = part.sizes.number_concentration_above(least_mm)
        per_m = beam.cross_section_m2(range_m) * number_m3
        steps = np.concatenate([[0.0], (per_m[1:] + per_m[:-1]) / 2.0 * RANGE_STEP_M])
        count = np.cumsum(steps)
        middle = np.interp((np.arange(NUM_LEVELS) + 0.5) * (count[-1] / NUM_LEVELS), count, range_m)
        least = np.interp(middle, range_m, least_mm)
        return ParticleTable(
            part, float(count[-1]), middle.astype(np.float32), least.astype(np.float32)
        )

    def sample(
        self, beams: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
        """Draw beam (k,) ascending, range (k,) and power (k,) of all particles in a scan.

        The caller drops particles behind a surface.
        """
        count = int(rng.poisson(beams * self.expected))
        beam = np.sort(rng.integers(beams, size=count, dtype=np.int32))
        level = draw_levels(rng, count)
        least_mm = self.min_diameter_mm.take(level)
        diameter_mm = least_mm + self._sample_excess_mm(least_mm, rng.random(count, np.float32))
        power = np.float32(MIN_PARTICLE_POWER) * (diameter_mm / least_mm) ** 2
        return beam, self.range_m.take(level), power

    def _sample_excess_mm(self, least_mm: FloatArray, uniform: FloatArray) -> FloatArray:
        """Draw diameters (k,) above the least: exponential, truncated at the largest."""
        sizes = self.part.sizes
        slope = np.float32(sizes.slope_per_mm)
        cut = 1.0 - np.exp(-slope * np.maximum(sizes.max_melted_mm - least_mm, 0.0))
        return -np.log1p(-uniform * cut) / slope


def min_detectable_diameter_mm(
    range_m: Float64Array,
    part: Precipitation,
    extinction_per_m: float,
    receiver: Receiver,
    beam: BeamShape,
    power: float,
) -> Float64Array:
    """Compute the melted diameter (n,) of a particle with `power` times the threshold."""
    # Relative to a target that fills the beam, a particle returns its area over the beam's.
    reflectance = np.full_like(range_m, part.reflectance)
    filling = receiver.received_power(range_m, reflectance, extinction_per_m)
    area_m2 = power / filling * beam.cross_section_m2(range_m)
    return np.sqrt(area_m2 * 4.0 / math.pi) * 1e3 / part.sizes.air_to_melted_diameter


@dataclass(frozen=True, eq=False)
class PlumeCrossing:
    """Beams through one plume of spray.

    Attributes:
        beam: (k,) rows of beams.
        enter_m: (k,) range of each beam's entry.
        through_m: (k,) length of its path inside.
        extinction_per_m: (k,) extinction coefficient in the middle of the path.
    """

    beam: IndexArray
    enter_m: FloatArray
    through_m: FloatArray
    extinction_per_m: FloatArray


def find_plume_crossings(
    lidar: Lidar,
    world_from_lidar: Matrix,
    states: Iterable[ActorState],
    *,
    time: ScanTime = FIRST_SCAN,
) -> Iterator[PlumeCrossing]:
    """Find the plumes in the beams of a LiDAR at a pose (4, 4), in the order of vehicles."""
    directions = beam_directions(lidar, time)
    grid = BeamGrid.from_lidar(lidar, world_from_lidar)
    for state in iterate_spraying_states(states):
        plume = SprayPlume.from_state(state)
        offset = plume.world_from_plume[:3, 3] - world_from_lidar[:3, 3]
        if np.linalg.norm(offset) <= MAX_PLUME_DISTANCE_M:
            rows = grid.find_beams_towards(plume.corners)
            plume_from_lidar = poses.invert_pose(plume.world_from_plume) @ world_from_lidar
            yield _intersect_plume(directions[rows], rows, plume_from_lidar, plume)


def _intersect_plume(
    directions: FloatArray, rows: IndexArray, plume_from_lidar: Matrix, plume: SprayPlume
) -> PlumeCrossing:
    directions = directions @ plume_from_lidar[:3, :3].T.astype(np.float32)
    origin = plume_from_lidar[:3, 3].astype(np.float32)
    half = plume.half_size_m.astype(np.float32)
    enter, leave = intersect_box(origin, directions, half, epsilon=1e-6)
    inside = np.flatnonzero(leave > enter)
    enter, leave, along = enter[inside], leave[inside], directions[inside, 0]
    behind_m = half[0] - (origin[0] + along * (enter + leave) / 2.0)
    decay = np.exp(-behind_m / np.float32(PLUME_DECAY_M))
    return PlumeCrossing(
        beam=rows[inside],
        enter_m=enter,
        through_m=leave - enter,
        extinction_per_m=np.float32(plume.peak_extinction_per_m) * decay,
    )
