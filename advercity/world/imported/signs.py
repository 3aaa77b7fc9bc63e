"""Signal heads and signs of an imported road, set where such a road has them.

Heads hang over the far side of the junction, on a mast at the right of the road beyond it; where
no road goes on, they stand there. Signs stand at the right of the approach.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity import curves
from advercity.curves import Points
from advercity.world.built_road import Head, PostedSign
from advercity.world.edges import approach
from advercity.world.imported.net import Net, NetEdge
from advercity.world.imported.surface import Surface

HEAD_HEIGHT_M = 5.8
CLEARANCE_M = 0.8
"""From the edge of the roadway to a mast."""
FARTHEST_MAST_M = 12.0
FARTHEST_SIDE_M = 60.0
STEP_M = 0.25
ARM_LENGTH_M = 7.0


def heads(net: Net, surface: Surface) -> Iterator[Head]:
    """A head for every approach that a light governs."""
    governed = {(link.light, link.from_edge) for link in net.links if link.light}
    for light, name in sorted(governed):
        edge = net.streets[name]
        if edge.driving:
            yield _head(f"{light}/{approach(name)}", edge, surface)


def _head(name: str, edge: NetEdge, surface: Surface) -> Head:
    end, heading = _end(edge)
    far = _far_side(end, heading, edge, surface)
    pole = _beside_road(far, heading, surface.roadway)
    arm = far - pole
    reach = float(np.linalg.norm(arm))
    if reach > ARM_LENGTH_M:
        far = pole + arm * ARM_LENGTH_M / reach
    z = float(surface.height(far[None])[0]) + HEAD_HEIGHT_M
    return Head(
        id=name,
        at_m=(float(far[0]), float(far[1]), z),
        pole_m=(float(pole[0]), float(pole[1])),
        facing=(-float(heading[0]), -float(heading[1])),
    )


def _end(edge: NetEdge) -> tuple[Points, Points]:
    """Where the driving lanes of a street end, (2,), and their direction there, (2,)."""
    lines = [lane.centre[:, :2] for lane in edge.driving]
    end = np.mean([line[-1] for line in lines], axis=0)
    direction = np.mean([line[-1] - line[-2] for line in lines], axis=0)
    return end, direction / np.linalg.norm(direction)


def _far_side(end: Points, heading: Points, edge: NetEdge, surface: Surface) -> Points:
    """Where one leaves the junction that a street ends at, going straight on."""
    area = surface.crossings_of_streets.get(edge.ends)
    ahead = shapely.LineString([end, end + FARTHEST_SIDE_M * heading])
    if area is None or not ahead.intersects(area):
        return end
    crossed = shapely.get_coordinates(ahead.intersection(area))
    return crossed[((crossed - end) @ heading).argmax()]


def _beside_road(point: Points, heading: Points, roadway: BaseGeometry) -> Points:
    """The nearest place off the roadway: just ahead, else to the right."""
    ahead = point + 2 * CLEARANCE_M * heading
    if not _is_near(ahead, roadway):
        return ahead
    right = -curves.left_of(heading)
    for reach in np.arange(0.0, FARTHEST_MAST_M, STEP_M):
        if not _is_near(point + reach * right, roadway):
            return point + reach * right
    return point + FARTHEST_MAST_M * right


def _is_near(point: Points, roadway: BaseGeometry) -> bool:
    return bool(shapely.dwithin(roadway, shapely.Point(point), CLEARANCE_M))


def signs(net: Net, surface: Surface) -> Iterator[PostedSign]:
    """A stop sign for approaches that must stop, a give-way sign for those that always yield."""
    states: dict[str, set[str]] = {}
    for link in net.links:
        states.setdefault(link.from_edge, set()).add(link.state)
    for name, found in states.items():
        edge = net.streets[name]
        kind = "stop" if found <= {"s", "w"} else "yield" if found == {"m"} else None
        if kind is None or not edge.driving:
            continue
        end, heading = _end(edge)
        at = _beside_road(end - CLEARANCE_M * heading, -curves.left_of(heading), surface.roadway)
        yield PostedSign(
            kind, (float(at[0]), float(at[1])), (-float(heading[0]), -float(heading[1]))
        )
