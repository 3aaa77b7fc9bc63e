"""Signal heads for pedestrians at both ends of crossings with a light."""

from collections.abc import Iterator

import numpy as np

from advercity.geometry.polyline import Points, left_normals
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.signals import TrafficLight

POST_HEIGHT_M = 2.7
"""The head hangs below the top and leaves 2.1 m to walk under."""
POST_KERB_DISTANCE_M = 0.6
POST_SIDE_CLEARANCE_M = 0.4
"""Distance of a post from the kerb, and from the side of the crossing."""


def place_pedestrian_lights(
    name: str, centre: Points, width_m: float, junction_m: Points
) -> Iterator[TrafficLight]:
    """Place a head at each end of a crossing, which faces those who come from the other.

    Posts stand on the side away from the junction, where kerbs are straight.

    Args:
        name: Id of the signal, as in `read_signal_groups`.
        centre: (n, 3) line of the crossing from kerb to kerb.
        width_m: Width of the crossing.
        junction_m: (2,) middle of the junction.
    """
    for end, before in ((centre[0], centre[1]), (centre[-1], centre[-2])):
        outward = (end - before)[:2] / np.linalg.norm((end - before)[:2])
        aside = left_normals(outward)
        aside *= np.sign(aside @ (end[:2] - junction_m)) or 1.0
        x, y = (
            end[:2] + POST_KERB_DISTANCE_M * outward + (width_m / 2 + POST_SIDE_CLEARANCE_M) * aside
        ).tolist()
        top_m = float(end[2]) + KERB_HEIGHT_M + POST_HEIGHT_M
        facing = (-float(outward[0]), -float(outward[1]))
        yield TrafficLight(name, (x, y, top_m), (x, y), facing, "pedestrians")
