"""Air, light, ground and window for a LiDAR at 905 nm, computed once per weather."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from advercity_dsl import Lidar
from advercity_dsl.weather_components import Lens
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.extinction import AirExtinction
from advercity.randomness import create_generator
from advercity.sensors.covered_glass import find_side, list_coverage
from advercity.sensors.lidar.beams import BeamShape, ScanTime, beam_directions, scan_azimuths_rad
from advercity.sensors.lidar.forward_scattering import (
    Diffraction,
    delay_per_m,
    kept_extinction_per_m,
)
from advercity.sensors.lidar.received_power import Receiver, daylight_noise_factor
from advercity.sensors.lidar.volume_scattering import ParticleTable, SoftTarget
from advercity.sensors.spray_plumes import has_spray

NUM_WINDOW_SECTORS = 360
"""Sectors of the window, one degree each; a drop may block a sector."""
COVERED_WINDOW_LOSS = 0.3
"""Loss of light, one way, where the window is fully covered."""
BLOCKED_PER_COVERED = 2.0
"""Blocked fraction of sectors, relative to the covered fraction of glass."""


@dataclass(frozen=True, eq=False)
class LidarWindow:
    """Drops or dirt on the window before n beams.

    Attributes:
        gain: (n,) factor on the power of returns, both ways.
        is_clear: (n,) whether a beam passes, or a drop blocks its sector.
    """

    gain: FloatArray
    is_clear: NDArray[np.bool_]

    @staticmethod
    def from_lidar(
        lidar: Lidar,
        time: ScanTime,
        coverage: tuple[float, float, float],
        key: tuple[int | str, ...],
        mount_yaw_deg: float = 0.0,
    ) -> "LidarWindow | None":
        """Build the window of a sensor by its coverage (front, side, rear); None if it is clean.

        Front, side and rear refer to the carrier, from which a mount may turn the sensor. The same
        key gives the same blocked sectors, and a greater coverage blocks more of them.
        """
        if not any(coverage):
            return None
        azimuth_deg = (np.arange(NUM_WINDOW_SECTORS) + 0.5) * (360.0 / NUM_WINDOW_SECTORS)
        by_sector = np.array(coverage)[find_side(azimuth_deg + mount_yaw_deg)]
        drops = create_generator(*key, "window").random(NUM_WINDOW_SECTORS)
        is_clear = drops >= BLOCKED_PER_COVERED * by_sector
        ahead_rad = scan_azimuths_rad(lidar) % np.float32(2.0 * math.pi)
        bearing = np.repeat(ahead_rad, lidar.channels)
        if lidar.prisms:
            ahead, left, _ = beam_directions(lidar, time).T
            bearing = np.arctan2(left, ahead) % np.float32(2.0 * math.pi)
        sectors = (bearing * (NUM_WINDOW_SECTORS / (2.0 * math.pi))).astype(np.int32)
        sector = sectors % NUM_WINDOW_SECTORS
        gain = (1.0 - COVERED_WINDOW_LOSS * by_sector) ** 2
        return LidarWindow(gain.astype(np.float32)[sector], is_clear[sector])


@dataclass(frozen=True, eq=False)
class LidarConditions:
    """Air, light and ground for a LiDAR at 905 nm.

    Attributes:
        extinction: Extinction coefficients of the air, part by part.
        has_spray: Whether the road is wet enough for spray.
        wetness: 0 dry to 1 soaked or glazed with ice.
        puddle_coverage: Fraction of the carriageway under standing water.
        snow_cover: Fraction of the ground under snow.
        road_snow_cover: Fraction of carriageways under snow.
        noise_factor: Factor by which daylight raises the receiver's noise.
        sun_direction: (3,) towards the sun's disc; None if clouds or fog hide it.
        window_coverage: Covered fraction of the sensor's window: front, side, rear.
    """

    extinction: AirExtinction
    has_spray: bool
    wetness: float
    puddle_coverage: float
    snow_cover: float
    road_snow_cover: float
    noise_factor: float
    sun_direction: NDArray[np.float64] | None
    window_coverage: tuple[float, float, float]

    @property
    def extinction_per_m(self) -> float:
        """Total extinction coefficient at 905 nm."""
        return self.extinction.at_905nm

    def tabulate_air(self, lidar: Lidar) -> "AirTables":
        """Tabulate the air for a LiDAR; the tables are kept for its next scans."""
        receiver, beam = Receiver.from_lidar(lidar), BeamShape.from_lidar(lidar)
        return _tabulate_air(self.extinction, receiver, beam)


@dataclass(frozen=True, eq=False)
class AirTables:
    """Air for a receiver.

    Attributes:
        extinction_per_m: Extinction coefficient of the light in the receiver's view.
        delay_per_m: Mean delay of this light in range, over the range squared.
        soft_target: Fog and dust; None if there is neither.
        particles: Falling rain, snow and hail.
    """

    extinction_per_m: float
    delay_per_m: float
    soft_target: SoftTarget | None
    particles: tuple[ParticleTable, ...]


@lru_cache(maxsize=8)
def _tabulate_air(extinction: AirExtinction, receiver: Receiver, beam: BeamShape) -> AirTables:
    droplets, falling = extinction.suspended, extinction.precipitation
    diffracting = [
        *(Diffraction.from_droplets(part) for part in droplets if part.droplet_um),
        *(Diffraction.from_precipitation(part) for part in falling),
    ]
    view_rad = receiver.field_of_view_rad
    seen = extinction.at_905nm - kept_extinction_per_m(diffracting, view_rad)
    return AirTables(
        extinction_per_m=seen,
        delay_per_m=delay_per_m(diffracting, view_rad),
        soft_target=SoftTarget.from_extinction(extinction, seen, receiver),
        particles=tuple(ParticleTable.build(item, seen, receiver, beam) for item in falling),
    )


MIN_VISIBLE_SUN_LX = 1_000.0
"""Direct normal illuminance below which the sun's disc no longer blinds."""


def derive_lidar_conditions(atmosphere: Atmosphere, lens: Lens) -> LidarConditions:
    """Derive the conditions of a LiDAR at 905 nm from an atmosphere and the glass before it."""
    return LidarConditions(
        extinction=atmosphere.extinction,
        has_spray=has_spray(atmosphere.water_film_mm),
        wetness=max(atmosphere.wetness, atmosphere.ice_cover),
        puddle_coverage=atmosphere.puddle_coverage,
        snow_cover=1.0 if atmosphere.snow_depth_m else 0.0,
        road_snow_cover=atmosphere.road_snow_cover,
        noise_factor=daylight_noise_factor(atmosphere.ground_lx),
        sun_direction=(
            atmosphere.sun_direction if atmosphere.sun_lx > MIN_VISIBLE_SUN_LX else None
        ),
        window_coverage=list_coverage(lens),
    )
