"""Echoes of the air: cells full of rain, snow or hail, and plumes of spray."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from advercity_dsl import Radar

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.physics.microwaves import compute_echo, water_permittivity
from advercity.physics.weather_parts.part import ParticleSizeDistribution
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar.antenna import (
    compute_angles,
    compute_range_cell_m,
    compute_two_way_gain,
)
from advercity.sensors.radar.conditions import FallingEcho
from advercity.sensors.radar.paths import Paths
from advercity.sensors.radar.placement import PlacedRadar
from advercity.sensors.spray_plumes import (
    MAX_PLUME_DISTANCE_M,
    PLUME_DECAY_M,
    SPRAY_EXTINCTION_PER_G_M3,
    SprayPlume,
    iterate_spraying_states,
)

VELOCITY_SPREAD_M_S = 1.0
"""Standard deviation of radial velocities per cell by turbulence, gusts and drop sizes; assumed."""
SPRAY_DROP_SLOPE_PER_MM, SPRAY_LARGEST_MM = 30.0, 1.0
"""Exponential sizes with a Sauter diameter of 0.1 mm, as in `SPRAY_EXTINCTION_PER_G_M3`."""
SPRAY_SPEED_RATIO = 0.5
"""Velocity of drops over their vehicle's: an assumption."""
_PLUME_SAMPLES = (12, 3, 3)


@dataclass(frozen=True, eq=False)
class FallingClutter:
    """Mean power of precipitation of one kind in the cells of a moving radar.

    Attributes:
        radar: The sensor.
        echo: Echo of the precipitation.
        velocity: (3,) of the precipitation relative to the radar, in its frame, m/s.
    """

    radar: Radar
    echo: FallingEcho
    velocity: Float64Array

    def compute_strength(self, range_m: FloatArray, direction: FloatArray) -> FloatArray:
        """Compute the strength (n,), as in `Paths`, of a cell's volume, all velocities together."""
        radar = self.radar
        elevation = compute_angles(direction)[1]
        solid_angle = np.cos(elevation) * math.radians(radar.azimuth_cell_deg)
        solid_angle = solid_angle * math.radians(radar.elevation_cell_deg)
        section = self.echo.backscatter_per_m * solid_angle * compute_range_cell_m(radar)
        return compute_two_way_gain(radar, direction, direction) * section / range_m**2

    def compute_fraction(self, direction: FloatArray, rate_m_s: FloatArray) -> FloatArray:
        """Compute the fraction (n,) of the strength in a velocity cell."""
        off = (rate_m_s - direction @ self.velocity) / VELOCITY_SPREAD_M_S
        peak = self.radar.speed_cell_m_s / (VELOCITY_SPREAD_M_S * math.sqrt(2.0 * math.pi))
        return min(peak, 1.0) * np.exp(-(off**2) / 2.0)


def list_spray_paths(placed: PlacedRadar, states: Iterable[ActorState]) -> Iterator[Paths]:
    """Yield paths from a moving radar to sample points of vehicles' plumes."""
    radar_from_world = poses.invert_pose(placed.world_from_radar)
    for state in iterate_spraying_states(states):
        plume = SprayPlume.from_state(state)
        offset = plume.world_from_plume[:3, 3] - placed.world_from_radar[:3, 3]
        if np.linalg.norm(offset) <= MAX_PLUME_DISTANCE_M:
            relative = SPRAY_SPEED_RATIO * state.motion.velocity - placed.velocity
            points, section_m2 = _sample_plume(plume)
            own = poses.transform_points(radar_from_world @ plume.world_from_plume, points)
            yield _build_paths(placed.radar, own, section_m2, radar_from_world[:3, :3] @ relative)


def _sample_plume(plume: SprayPlume) -> tuple[Float64Array, Float64Array]:
    """Sample a plume: points (n, 3) in its frame, and the cross-section (n,) of each."""
    axes = [(np.arange(count) + 0.5) / count * 2.0 - 1.0 for count in _PLUME_SAMPLES]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) * plume.half_size_m
    volume_m3 = float(np.prod(2.0 * plume.half_size_m)) / len(points)
    water_g_m3 = plume.peak_extinction_per_m / SPRAY_EXTINCTION_PER_G_M3
    behind_m = plume.half_size_m[0] - points[:, 0]
    decay = np.exp(-behind_m / PLUME_DECAY_M)
    return points, _spray_backscatter_per_g() * water_g_m3 * volume_m3 * decay


@cache
def _spray_backscatter_per_g() -> float:
    """Compute the backscatter of 1 g/m³ of spray, m² per m³."""
    # 1 g of water is 1000 mm³; an exponential distribution holds pi N / slope^4 of it.
    intercept = 1e3 * SPRAY_DROP_SLOPE_PER_MM**4 / math.pi
    sizes = ParticleSizeDistribution(intercept, SPRAY_DROP_SLOPE_PER_MM, SPRAY_LARGEST_MM)
    return compute_echo(sizes, water_permittivity()).backscatter_per_m


def _build_paths(
    radar: Radar, points: Float64Array, section_m2: Float64Array, velocity: Float64Array
) -> Paths:
    range_m = np.linalg.norm(points, axis=1)
    direction = points / range_m[:, None]
    count, zeros = len(points), np.zeros(len(points), np.float32)
    strength = compute_two_way_gain(radar, direction, direction) * section_m2 / range_m**4
    return Paths(
        direction=direction.astype(np.float32),
        range_m=range_m.astype(np.float32),
        rate_m_s=(direction @ velocity).astype(np.float32),
        strength=strength.astype(np.float32),
        field=zeros.astype(np.complex64),
        detour_m=zeros,
        mirrorings=np.zeros(count, np.uint8),
        instance=np.zeros(count, np.int32),
        kind=np.full(count, PointKind.SPRAY, np.uint8),
    ).select(np.flatnonzero((strength > 0.0) & (range_m < radar.range_m)))
