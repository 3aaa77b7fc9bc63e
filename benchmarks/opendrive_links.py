"""Transitions from lane to lane of an OpenDRIVE map, and those that an import lacks."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from opendrive_samples import Floats, LaneSamples, OpenDriveMap, build_poses
from scipy.spatial import KDTree

from advercity.roads.lane_segments import LaneSegment
from advercity.roads.network_file import LaneConnection

STEP_M = 1.0
NEAR_END_M = 10.0
"""Part of a lane at its end in which the imported one is looked for; it may end earlier."""
MAX_DISTANCE_M = 1.5
MIN_WIDTH_M = 1.0
MAX_CONNECTIONS = 4
"""Connections that one transition may consist of, over short lanes between."""


class LaneKey(NamedTuple):
    """A lane of one lane section."""

    road: str
    section: int
    lane: int


def list_links(opendrive: OpenDriveMap) -> list[tuple[LaneKey, LaneKey]]:
    """List where vehicles get to from each lane outside junctions: the next lanes outside."""
    graph = _LinkGraph(opendrive)
    found: list[tuple[LaneKey, LaneKey]] = []
    for origin in graph.list_lanes():
        if not graph.is_in_junction(origin):
            found += [(origin, target) for target in graph.find_next_outside(origin)]
    return found


def list_missing_links(
    opendrive: OpenDriveMap,
    lanes: Iterable[LaneSegment],
    connections: Iterable[LaneConnection],
    offset_m: Sequence[float],
) -> list[str]:
    """List the transitions that no connections of the imported lanes make."""
    imported = _ImportedLanes(lanes, connections, offset_m)
    samples: dict[LaneKey, LaneSamples] = {}
    missing: list[str] = []
    for pair in list_links(opendrive):
        for key in pair:
            section = opendrive.sections[key.road][key.section]
            samples.setdefault(key, section.sample(key.lane, STEP_M))
        origin, target = (samples[key] for key in pair)
        count = int(NEAR_END_M / STEP_M)
        end, start = _poses(origin)[-count:], _poses(target)[:count]
        if len(end) and len(start) and not imported.are_connected(end, start):
            missing.append(f"no way from {_describe(pair[0])} to {_describe(pair[1])}")
    return missing


def count_links(opendrive: OpenDriveMap) -> int:
    """Count the transitions of a map."""
    return len(list_links(opendrive))


def _describe(key: LaneKey) -> str:
    return f"road {key.road} section {key.section} lane {key.lane}"


def _poses(lane: LaneSamples) -> Floats:
    return build_poses(lane.centre, lane.heading)[lane.width_m >= MIN_WIDTH_M]


class _LinkGraph:
    """Successors of lanes, in the direction of travel."""

    def __init__(self, opendrive: OpenDriveMap) -> None:
        self._map = opendrive
        self._junctions = {
            item.get("id", ""): list(item.iterfind("connection"))
            for item in opendrive.root.iterfind("junction")
        }

    def list_lanes(self) -> Iterator[LaneKey]:
        for road, sections in self._map.sections.items():
            for index, section in enumerate(sections):
                for lane in section.lanes:
                    if section.is_for_vehicles(lane):
                        yield LaneKey(road, index, lane)

    def is_in_junction(self, key: LaneKey) -> bool:
        return self._map.roads[key.road].junction != ""

    def find_next_outside(self, origin: LaneKey) -> list[LaneKey]:
        found: dict[LaneKey, None] = {}
        seen: set[LaneKey] = set()
        left = [origin]
        while left:
            for key in self._find_next(left.pop()):
                if key in seen:
                    continue
                seen.add(key)
                if self.is_in_junction(key):
                    left.append(key)
                else:
                    found[key] = None
        return list(found)

    def _find_next(self, key: LaneKey) -> Iterator[LaneKey]:
        sections = self._map.sections[key.road]
        along = sections[key.section].runs_along(key.lane)
        side = "successor" if along else "predecessor"
        index = key.section + (1 if along else -1)
        linked = [int(item.get("id", 0)) for item in self._element(key).iterfind(f"link/{side}")]
        if 0 <= index < len(sections):
            yield from self._keep([LaneKey(key.road, index, lane) for lane in linked])
            return
        link = self._map.roads[key.road].element.find(f"link/{side}")
        if link is None:
            return
        if link.get("elementType") == "junction":
            yield from self._cross(key, self._junctions.get(link.get("elementId", ""), ()))
        else:
            at_start = link.get("contactPoint") == "start"
            yield from self._enter(link.get("elementId", ""), linked, at_start=at_start)

    def _cross(self, key: LaneKey, connections: Iterable[Element]) -> Iterator[LaneKey]:
        for item in connections:
            if item.get("incomingRoad") == key.road:
                entered = item.get("connectingRoad") or item.get("linkedRoad") or ""
                lanes = [
                    int(link.get("to", 0))
                    for link in item.iterfind("laneLink")
                    if int(link.get("from", 0)) == key.lane
                ]
                at_start = item.get("contactPoint") == "start"
                yield from self._enter(entered, lanes, at_start=at_start)

    def _enter(self, road: str, lanes: Iterable[int], *, at_start: bool) -> Iterator[LaneKey]:
        sections = self._map.sections.get(road, [])
        index = 0 if at_start else len(sections) - 1
        for key in self._keep([LaneKey(road, index, lane) for lane in lanes] if sections else []):
            # Lanes that lead here from there are linked, too.
            if sections[index].runs_along(key.lane) == at_start:
                yield key

    def _keep(self, keys: Iterable[LaneKey]) -> Iterator[LaneKey]:
        for key in keys:
            section = self._map.sections[key.road][key.section]
            if key.lane in section.lanes and section.is_for_vehicles(key.lane):
                yield key

    def _element(self, key: LaneKey) -> Element:
        return self._map.sections[key.road][key.section].lanes[key.lane]


class _ImportedLanes:
    """Imported lanes for cars between junctions, found by pose, and how they connect."""

    def __init__(
        self,
        lanes: Iterable[LaneSegment],
        connections: Iterable[LaneConnection],
        offset_m: Sequence[float],
    ) -> None:
        poses: list[Floats] = []
        self._ids: list[str] = []
        for lane in lanes:
            if lane.kind == "driving" and not lane.in_junction:
                at = np.linspace(0.0, lane.length_m, 2 + int(lane.length_m / STEP_M))
                points = lane.points_at(at, 0.5) + np.array([*offset_m, 0.0])
                tangent = np.gradient(points[:, :2], axis=0)
                poses.append(build_poses(points, np.arctan2(tangent[:, 1], tangent[:, 0])))
                self._ids += [lane.id] * len(at)
        self._tree = KDTree(np.concatenate(poses))
        self._next: dict[str, set[str]] = defaultdict(set)
        for link in connections:
            self._next[link.origin].add(link.target)

    def are_connected(self, end: Floats, start: Floats) -> bool:
        """Whether a car gets from a lane near some poses to one near others."""
        reached, targets = self._find_near(end), self._find_near(start)
        for _ in range(MAX_CONNECTIONS):
            if reached & targets:
                return True
            reached = reached.union(*(self._next[lane] for lane in reached))
        return bool(reached & targets)

    def _find_near(self, poses: Floats) -> set[str]:
        near = self._tree.query_ball_point(poses, MAX_DISTANCE_M)
        return {self._ids[index] for found in near for index in found}
