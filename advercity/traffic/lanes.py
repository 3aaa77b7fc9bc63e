"""The SUMO network as typed lanes: where they run, who may use them, and how they join."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError, RunError

LANE_WIDTH_M = 3.5


@dataclass(frozen=True, eq=False)
class Lane:
    """One lane of the network, those inside junctions included.

    Attributes:
        id: SUMO's id, `<edge>_<index>`.
        edge: Id of its edge.
        index: Counts from the right.
        kind: `normal`, `internal`, `crossing` or `walkingarea`.
        length_m: Length that SUMO counts positions in; it may differ a little from the shape's.
        speed_limit_m_s: Limit of the lane.
        shape: (n, 3) points of the centre line in the direction of travel, metres.
        allows: Vehicle classes that may use it; None if all may.
        forbids: Vehicle classes that may not.
    """

    id: str
    edge: str
    index: int
    kind: str
    length_m: float
    speed_limit_m_s: float
    shape: NDArray[np.float64]
    allows: frozenset[str] | None
    forbids: frozenset[str]

    def permits(self, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use this lane."""
        if self.allows is not None:
            return vehicle_class in self.allows
        return not {vehicle_class, "all"} & self.forbids

    @property
    def is_sidewalk(self) -> bool:
        """Whether it is there for people on foot only."""
        permitted = self.permits("pedestrian") and not self.permits("passenger")
        return self.kind == "normal" and permitted

    @property
    def is_driven(self) -> bool:
        """Whether it is a driving lane between junctions."""
        return self.kind == "normal" and self.permits("passenger")

    @cached_property
    def stations_m(self) -> NDArray[np.float64]:
        """(n,) position of every point of `shape`, from 0 to `length_m`."""
        steps = np.linalg.norm(np.diff(self.shape, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        return along * (self.length_m / max(along[-1], 1e-6))

    def at(self, position_m: float) -> NDArray[np.float64]:
        """World point (3,) at a position along the lane."""
        return np.array([np.interp(position_m, self.stations_m, axis) for axis in self.shape.T])

    def heading_rad(self, position_m: float) -> float:
        """Direction of travel at a position, counter-clockwise from east."""
        piece = int(np.searchsorted(self.stations_m, position_m, side="right")) - 1
        first = min(max(piece, 0), len(self.shape) - 2)
        east, north, _ = self.shape[first + 1] - self.shape[first]
        return float(np.arctan2(north, east))

    def nearest(self, point: tuple[float, float]) -> tuple[float, float]:
        """Position along the lane nearest to a point (x, y), and the distance between them."""
        starts, steps = self.shape[:-1, :2], np.diff(self.shape[:, :2], axis=0)
        squared = np.maximum((steps**2).sum(axis=1), 1e-12)
        share = np.clip(((np.array(point) - starts) * steps).sum(axis=1) / squared, 0, 1)
        distances = np.linalg.norm(starts + share[:, None] * steps - point, axis=1)
        best = int(np.argmin(distances))
        along = self.stations_m[best : best + 2]
        return float(along[0] + share[best] * (along[1] - along[0])), float(distances[best])


@dataclass(frozen=True)
class Joint:
    """A way from one lane into the next between junctions; `via` lies inside the junction."""

    origin: str
    target: str
    via: str | None
    direction: str
    """SUMO's letter: `s` straight, `l` left, `r` right, `t` turns around."""


@dataclass(frozen=True, eq=False)
class LaneGraph:
    """All lanes of a network and how they join."""

    lanes: Mapping[str, Lane]
    joints: tuple[Joint, ...]

    @cached_property
    def driven(self) -> tuple[Lane, ...]:
        """Driving lanes between junctions, in the order of the file."""
        return tuple(lane for lane in self.lanes.values() if lane.is_driven)

    @cached_property
    def sidewalks(self) -> Mapping[str, Lane]:
        """Sidewalks by edge; of two on one edge SUMO uses the right one."""
        found: dict[str, Lane] = {}
        for lane in self.lanes.values():
            if lane.is_sidewalk:
                found.setdefault(lane.edge, lane)
        return found

    @cached_property
    def shortest_m(self) -> Mapping[str, float]:
        """Length of the shortest lane of every edge."""
        found: dict[str, float] = {}
        for lane in self.lanes.values():
            found[lane.edge] = min(lane.length_m, found.get(lane.edge, lane.length_m))
        return found

    @cached_property
    def onward(self) -> Mapping[str, tuple[Joint, ...]]:
        """Joints that leave a driving lane, turning around left out."""
        return _grouped(
            joint
            for joint in self.joints
            if joint.direction != "t"
            and self.lanes[joint.origin].is_driven
            and self.lanes[joint.target].is_driven
        )

    @cached_property
    def entries(self) -> tuple[Lane, ...]:
        """Driving lanes that begin at the edge of the site."""
        edges = {lane.edge for lane in self.driven}
        reached = {
            self.lanes[joint.target].edge for joints in self.onward.values() for joint in joints
        }
        return tuple(lane for lane in self.driven if lane.edge in edges - reached)

    def lane_at(self, point: tuple[float, float], heading_rad: float) -> tuple[Lane, float]:
        """The driving lane at a point that leads within 60 degrees of a heading, and where on it.

        Raises:
            InputError: No such lane is within a lane's width.
        """
        found = [(*lane.nearest(point)[::-1], lane) for lane in self.driven]
        fitting = [
            (distance, position, lane)
            for distance, position, lane in found
            if distance < LANE_WIDTH_M
            and np.cos(lane.heading_rad(position) - heading_rad) > np.cos(np.pi / 3)
        ]
        if not fitting:
            raise InputError(
                f"no driving lane at {point[0]:g}, {point[1]:g} leads"
                f" {np.degrees(heading_rad):g} degrees from east; move or turn the vehicle"
            )
        _, position, lane = min(fitting, key=lambda item: item[0])
        return lane, position

    def joint(self, lane: Lane, edge: str) -> Joint:
        """A way into an edge: from this lane if there is one, else from a lane beside it."""
        ways = [
            joint
            for joints in self.onward.values()
            for joint in joints
            if self.lanes[joint.origin].edge == lane.edge and self.lanes[joint.target].edge == edge
        ]
        return min(ways, key=lambda way: way.origin != lane.id)

    def inside(self, joint: Joint) -> Iterator[Lane]:
        """Lanes inside the junction that a joint leads through."""
        step = joint
        while step.via is not None:
            yield self.lanes[step.via]
            step = next(other for other in self.joints if other.origin == step.via)

    def edges_after(self, edge: str, *, straight_first: bool = False) -> tuple[str, ...]:
        """Edges that some lane of an edge leads into, as in the file or straight ones first."""
        ways = [
            joint
            for origin, joints in self.onward.items()
            for joint in joints
            if self.lanes[origin].edge == edge
        ]
        if straight_first:
            ways.sort(key=lambda joint: joint.direction != "s")
        return tuple(dict.fromkeys(self.lanes[joint.target].edge for joint in ways))

    def ways_from(self, lane: Lane) -> tuple[Lane, ...]:
        """Lanes to go on in, one an edge: from this lane, or if it ends, from its neighbours."""
        targets = self._targets(lane.edge, lane.id) or self._targets(lane.edge, None)
        return tuple({target.edge: target for target in reversed(targets)}.values())

    def _targets(self, edge: str, lane: str | None) -> list[Lane]:
        return [
            self.lanes[joint.target]
            for origin, joints in self.onward.items()
            for joint in joints
            if self.lanes[origin].edge == edge and lane in (None, origin)
        ]

    def beside(self, *, crossing: bool) -> Mapping[str, tuple[str, ...]]:
        """Sidewalks (edges) one can walk into from each sidewalk, with or without crossings."""
        footways = [joint for joint in self.joints if self._is_footway(joint)]
        back = [replace(joint, origin=joint.target, target=joint.origin) for joint in footways]
        steps = _grouped(footways + back)
        return {
            edge: tuple(sorted(self._reached(lane.id, steps, crossing=crossing) - {edge}))
            for edge, lane in self.sidewalks.items()
        }

    def _is_footway(self, joint: Joint) -> bool:
        on_foot = ("walkingarea", "crossing")
        return any(self.lanes[end].kind in on_foot for end in (joint.origin, joint.target))

    def _reached(
        self, start: str, steps: Mapping[str, tuple[Joint, ...]], *, crossing: bool
    ) -> set[str]:
        seen, todo, found = {start}, [start], set[str]()
        while todo:
            for joint in steps.get(todo.pop(), ()):
                lane = self.lanes[joint.target]
                if lane.id in seen or (lane.kind == "crossing" and not crossing):
                    continue
                seen.add(lane.id)
                if lane.is_sidewalk:
                    if lane is self.sidewalks[lane.edge]:
                        found.add(lane.edge)
                else:
                    todo.append(lane.id)
        return found


def read_lanes(network: Path) -> LaneGraph:
    """The lanes of a SUMO network file; RunError if it is none.

    Where a street leaves the site SUMO lets people walk around its end; nobody does that here.
    """
    try:
        root = ElementTree.parse(network).getroot()  # noqa: S314 - written by our own netconvert
        ends = tuple(
            f":{item.attrib['id']}_"
            for item in root.iter("junction")
            if item.attrib["type"] == "dead_end"
        )
        lanes = {
            lane.id: lane
            for edge in root.iter("edge")
            if not edge.attrib["id"].startswith(ends)
            for lane in _lanes(edge)
        }
        joints = tuple(_joint(item) for item in root.iter("connection"))
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise RunError(f"{network}: not a SUMO network: {error}") from error
    known = tuple(joint for joint in joints if joint.origin in lanes and joint.target in lanes)
    return LaneGraph(lanes, known)


def _lanes(edge: ElementTree.Element) -> Iterator[Lane]:
    for lane in edge.iter("lane"):
        numbers = [
            [float(part) for part in text.split(",")] for text in lane.attrib["shape"].split()
        ]
        points = [(*point, 0.0)[:3] for point in numbers]
        yield Lane(
            id=lane.attrib["id"],
            edge=edge.attrib["id"],
            index=int(lane.attrib["index"]),
            kind=edge.get("function", "normal"),
            length_m=float(lane.attrib["length"]),
            speed_limit_m_s=float(lane.attrib["speed"]),
            shape=np.array(points),
            allows=frozenset(lane.attrib["allow"].split()) if "allow" in lane.attrib else None,
            forbids=frozenset(lane.get("disallow", "").split()),
        )


def _joint(item: ElementTree.Element) -> Joint:
    origin = f"{item.attrib['from']}_{item.attrib['fromLane']}"
    target = f"{item.attrib['to']}_{item.attrib['toLane']}"
    return Joint(origin, target, item.get("via"), item.attrib["dir"])


def _grouped(joints: Iterable[Joint]) -> dict[str, tuple[Joint, ...]]:
    groups: dict[str, list[Joint]] = {}
    for joint in joints:
        groups.setdefault(joint.origin, []).append(joint)
    return {origin: tuple(found) for origin, found in groups.items()}
