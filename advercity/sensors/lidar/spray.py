"""Water that wheels throw up from a wet road: a plume behind each fast vehicle."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl import Lidar, Weather
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.sensors.lidar.beams import beams
from advercity.sensors.lidar.fan import Fan
from advercity.traffic.trace import ActorState

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

LEAST_FILM_MM = 0.3
LEAST_SPEED_M_S = 30.0 / 3.6
REFERENCE_SPEED_M_S = 60.0 / 3.6
WATER_G_M3 = 0.5
"""Liquid water right behind a vehicle at that speed; it grows with the square of the speed."""
EXTINCTION_PER_G_M3 = 0.03
"""Extinction in 1/m of 1 g/m³ of drops with a Sauter diameter of 0.1 mm."""
LENGTH_M, HEIGHT_M = 12.0, 1.3
FADING_M = 6.5
FARTHEST_M = 60.0
"""Plumes farther away are left out: they send back too little and dim too little."""
_CORNERS = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3)
WHEELED = ("car", "van", "truck", "motorcycle")


@dataclass(frozen=True, eq=False)
class Passage:
    """Beams (k,) through one plume: where they enter, how far they go in it, how thick it is."""

    beam: Rows
    enter_m: Floats
    through_m: Floats
    extinction: Floats


def hangs(weather: Weather) -> bool:
    """Whether enough water lies on the road."""
    return weather.surface.film_mm > LEAST_FILM_MM


def passages(
    lidar: Lidar, world_from_lidar: Matrix, states: Iterable[ActorState]
) -> Iterator[Passage]:
    """Every plume that beams of a LiDAR go through.

    Args:
        lidar: The sensor.
        world_from_lidar: (4, 4) where it is.
        states: Everybody on the road.
    """
    directions, fan = beams(lidar), Fan.of(lidar, world_from_lidar)
    for state in states:
        if state.speed_m_s < LEAST_SPEED_M_S or state.actor.actor_class not in WHEELED:
            continue
        length, width, _ = state.actor.size
        middle = np.array([-(length + LENGTH_M) / 2.0, 0.0, HEIGHT_M / 2.0])
        world_from_plume = state.world_from_body @ poses.pose(middle)
        half = np.array([LENGTH_M, width, HEIGHT_M]) / 2.0
        if np.linalg.norm(world_from_plume[:3, 3] - world_from_lidar[:3, 3]) > FARTHEST_M:
            continue
        plume_from_lidar = poses.inverse(world_from_plume) @ world_from_lidar
        thickness = EXTINCTION_PER_G_M3 * WATER_G_M3
        thickness *= (state.speed_m_s / REFERENCE_SPEED_M_S) ** 2
        rows = fan.towards(poses.transform(world_from_plume, _CORNERS * half))
        yield _through_box(directions[rows], rows, plume_from_lidar, half, thickness)


def _through_box(
    directions: Floats, rows: Rows, plume_from_lidar: Matrix, half: Matrix, thickness: float
) -> Passage:
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
    return Passage(
        beam=rows[inside],
        enter_m=enter,
        through_m=leave - enter,
        extinction=np.float32(thickness) * np.exp(-behind / np.float32(FADING_M)),
    )
