"""Which actors a viewpoint annotates, and what it says of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.reading import Reading
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
    own, visible = reading.agent.number, reading.visible
    seen = [
        state
        for state in reading.frame.states
        if state.actor.id != own and visible.get(state.actor.id, 0) > 0
    ]
    if not seen:
        return ()
    world_from_object = np.stack([state.world_from_body for state in seen])
    heights = np.array([state.actor.size[2] for state in seen])
    on_foot = np.array([state.actor.actor_class == "pedestrian" for state in seen])
    grounds = world_from_object[:, :3, 3]
    centres = grounds + world_from_object[:, :3, 2] * (heights[:, None] / 2)
    locations = np.where(on_foot[:, None], centres, grounds)
    places = poses.transform(poses.inverse(reading.world_from_agent), locations)
    yaws = np.arctan2(world_from_object[:, 1, 0], world_from_object[:, 0, 0])
    turned = yaws - poses.angles(reading.world_from_agent)[0]
    rows = zip(
        seen,
        locations,
        centres,
        np.linalg.norm(locations - reading.world_from_agent[:3, 3], axis=1).tolist(),
        np.arctan2(places[:, 1], places[:, 0]).tolist(),
        (np.pi - (np.pi - turned) % (2 * np.pi)).tolist(),
        (visible[state.actor.id] for state in seen),
        strict=True,
    )
    range_m = reading.agent.sensors.lidar.range_m
    return tuple(Annotation(*row) for row in rows if row[3] < range_m)


def box_centre(state: ActorState) -> NDArray[np.float64]:
    """Middle (3,) of an actor's box, which stands upright on its origin in its body frame."""
    return poses.transform(state.world_from_body, (0.0, 0.0, state.actor.size[2] / 2))
