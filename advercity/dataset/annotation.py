"""Which actors a viewpoint annotates, and what it says of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.reading import Reading
from advercity.poses import Matrix
from advercity.traffic.trace import ActorState


@dataclass(frozen=True, eq=False)
class Annotation:
    """An actor as one viewpoint has it, in the right-handed world frame.

    Attributes:
        state: Who it is and where.
        location: (3,) where the original puts it: on the ground under a vehicle, in the middle
            of a pedestrian's body.
        centre: (3,) middle of its box.
        distance_m: From the viewpoint's origin to `location`.
        bearing_rad: Direction in which the viewpoint sees it; 0 ahead, positive to the left.
        relative_yaw_rad: Its heading less the viewpoint's, in (-pi, pi].
        lidar_hits: Rays of the noise-free LiDAR that met it.
    """

    state: ActorState
    location: NDArray[np.float64]
    centre: NDArray[np.float64]
    distance_m: float
    bearing_rad: float
    relative_yaw_rad: float
    lidar_hits: int


def annotate(reading: Reading) -> tuple[Annotation, ...]:
    """Everybody but the viewpoint itself within LiDAR range whom its noise-free LiDAR hits.

    Weather and noise play no part in it, so the annotations of a scenario are the same under
    every weather. Distances count from the true viewpoint, not from the estimated one.
    """
    annotations = (
        _annotation(reading, state)
        for state in reading.frame.states
        if state.actor.id != reading.agent.number and reading.visible.get(state.actor.id, 0) > 0
    )
    range_m = reading.agent.sensors.lidar.range_m
    return tuple(item for item in annotations if item.distance_m < range_m)


def box_centre(state: ActorState) -> NDArray[np.float64]:
    """Middle (3,) of an actor's box, which stands upright on its origin in its body frame."""
    return poses.transform(state.world_from_body, (0.0, 0.0, state.actor.size[2] / 2))


def _annotation(reading: Reading, state: ActorState) -> Annotation:
    centre = box_centre(state)
    on_foot = state.actor.actor_class == "pedestrian"
    location = centre if on_foot else state.world_from_body[:3, 3]
    ahead, left, _ = poses.transform(poses.inverse(reading.world_from_agent), location)
    return Annotation(
        state=state,
        location=location,
        centre=centre,
        distance_m=float(np.linalg.norm(location - reading.world_from_agent[:3, 3])),
        bearing_rad=float(np.arctan2(left, ahead)),
        relative_yaw_rad=_relative_yaw(state.world_from_body, reading.world_from_agent),
        lidar_hits=reading.visible[state.actor.id],
    )


def _relative_yaw(world_from_object: Matrix, world_from_viewpoint: Matrix) -> float:
    difference = poses.angles(world_from_object)[0] - poses.angles(world_from_viewpoint)[0]
    return float(np.pi - (np.pi - difference) % (2 * np.pi))
