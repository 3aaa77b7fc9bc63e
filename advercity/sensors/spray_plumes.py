"""Spray from wheels on a wet road: a box-shaped plume behind each fast vehicle.

LiDARs, radars and cameras share the same plumes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from advercity_dsl.units import KM_H_PER_M_S

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.geometry.poses import Matrix

MIN_SPRAY_FILM_MM = 0.3
"""Depth of water below which tyres displace it sideways rather than throw it up."""
MIN_SPRAY_SPEED_M_S = 30.0 / KM_H_PER_M_S
SPRAY_REFERENCE_SPEED_M_S = 60.0 / KM_H_PER_M_S
SPRAY_WATER_G_M3 = 0.5
"""Liquid water directly behind a vehicle at the reference speed; it grows with speed squared."""
SPRAY_EXTINCTION_PER_G_M3 = 0.03
"""Extinction in 1/m of 1 g/m³ of drops with a Sauter diameter of 0.1 mm: 3 / (density d)."""
PLUME_LENGTH_M, PLUME_HEIGHT_M = 12.0, 1.3
PLUME_DECAY_M = 6.5
"""Distance behind the vehicle over which the water falls to 1/e."""
MAX_PLUME_DISTANCE_M = 60.0
"""Distance beyond which plumes are left out, as they scatter and attenuate too little."""
SPRAYING_CLASSES = ("car", "van", "truck", "motorcycle")


def has_spray(water_film_mm: float) -> bool:
    """Return whether the water on the road is deep enough for spray."""
    return water_film_mm > MIN_SPRAY_FILM_MM


@dataclass(frozen=True, eq=False)
class SprayPlume:
    """The plume of one vehicle, a box with its axes along the vehicle's.

    Attributes:
        world_from_plume: (4, 4) pose of its centre.
        half_size_m: (3,) half of length, width and height.
        peak_extinction_per_m: Extinction coefficient at its front end, any wavelength.
    """

    world_from_plume: Matrix
    half_size_m: Float64Array
    peak_extinction_per_m: float

    @staticmethod
    def from_state(state: ActorState) -> "SprayPlume":
        """Build the plume behind a spraying vehicle."""
        length, width, _ = state.actor.size
        centre = np.array([-(length + PLUME_LENGTH_M) / 2.0, 0.0, PLUME_HEIGHT_M / 2.0])
        relative_speed = state.speed_m_s / SPRAY_REFERENCE_SPEED_M_S
        return SprayPlume(
            world_from_plume=state.world_from_body @ poses.pose_matrix(centre),
            half_size_m=np.array([PLUME_LENGTH_M, width, PLUME_HEIGHT_M]) / 2.0,
            peak_extinction_per_m=SPRAY_EXTINCTION_PER_G_M3 * SPRAY_WATER_G_M3 * relative_speed**2,
        )

    @property
    def corners(self) -> Float64Array:
        """Corners (8, 3) of the box in the world."""
        return poses.transform_points(self.world_from_plume, _UNIT_CORNERS * self.half_size_m)


_UNIT_CORNERS = np.array([[x, y, z] for y in (-1, 1) for x in (-1, 1) for z in (-1, 1)])


def iterate_spraying_states(states: Iterable[ActorState]) -> Iterator[ActorState]:
    """Yield the vehicles of a spraying class that are fast enough."""
    for state in states:
        if state.speed_m_s >= MIN_SPRAY_SPEED_M_S and state.actor.actor_class in SPRAYING_CLASSES:
            yield state


def intersect_box(
    origin: FloatArray, directions: FloatArray, half_size: FloatArray, *, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    """Intersect rays with a box around the frame's origin (slab test).

    Components of `directions` (..., 3) smaller than `epsilon` count as `epsilon`, as they are
    divisors. Returns the distances (...) of each ray's entry, at least 0, and exit; a ray past the
    box has its exit before its entry.
    """
    slope = 1.0 / np.where(np.abs(directions) < epsilon, epsilon, directions)
    low, high = (-half_size - origin) * slope, (half_size - origin) * slope
    return np.minimum(low, high).max(axis=-1).clip(0.0), np.maximum(low, high).min(axis=-1)
