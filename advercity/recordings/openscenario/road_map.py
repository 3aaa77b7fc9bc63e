"""Places on the lanes of an OpenDRIVE map, and motion along them."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from advercity.roads.opendrive.document import (
    Connection,
    Contact,
    LaneSection,
    OpenDriveMap,
    Road,
)
from advercity.roads.opendrive.profiles import evaluate_profile
from advercity.roads.opendrive.reference_line import sample_offset_points, sample_plan

BOUNDARY_M = 1e-6
SLOPE_STEP_M = 0.05
"""Half the distance over which the direction of a lane is measured."""
SAMPLE_STEP_M = 2.0
MAX_ASIDE_M = 5.0
"""Beyond this distance from all lanes, a point is on none."""
MAX_LINKS = 10_000
"""Most lanes in one step."""


class LanePlace(NamedTuple):
    """A place on a lane.

    Attributes:
        road: Id of the road.
        lane: Id of the lane.
        station_m: Distance along the road.
        offset_m: Distance to the left of the middle of the lane, seen along the road.
        along: 1 for who faces along the road, -1 for who faces against it.
    """

    road: str
    lane: int
    station_m: float
    offset_m: float
    along: int


Chooser = Callable[[Sequence["LanePlace"]], "LanePlace | None"]
"""Chooses one of the lanes into which a junction leads."""


@dataclass(frozen=True)
class _Samples:
    roads: tuple[str, ...]
    stations_m: NDArray[np.float64]
    points: NDArray[np.float64]


class RoadMap:
    """Lanes of a map, by the ids of its roads."""

    def __init__(self, document: OpenDriveMap) -> None:
        self._document = document
        self._samples: _Samples | None = None

    def get_road(self, road: str) -> Road | None:
        """Return a road; None if the map has none of this id."""
        return self._document.roads.get(road)

    def has_lane(self, place: LanePlace) -> bool:
        """Return whether a lane is there, on a road of the map."""
        road = self.get_road(place.road)
        if road is None or not -BOUNDARY_M <= place.station_m <= road.length_m + 0.1:
            return False
        section = road.sections[self._find_section(road, place.station_m, place.along)]
        return place.lane == 0 or place.lane in section.lanes

    def find_direction(self, road: str, lane: int) -> int:
        """Return 1 where traffic of a lane drives along its road, else -1."""
        is_left_handed = self._document.roads[road].is_left_handed
        return 1 if (lane <= 0) != is_left_handed else -1

    def locate_road(self, road: str, station_m: float, left_m: float) -> tuple[complex, float]:
        """Compute the point at a distance to the left of a road, and the road's heading there."""
        found, at_m = self._document.roads[road], np.array([station_m])
        points = sample_offset_points(found, at_m, np.array([[left_m]]))
        _, headings = sample_plan(found, at_m)
        return complex(*points[0, 0, :2]), float(headings[0])

    def locate(self, place: LanePlace) -> tuple[complex, float]:
        """Compute the point of a place, and the heading of who drives there along its lane."""
        left_m = self.find_left(place)
        point, heading = self.locate_road(place.road, place.station_m, left_m)
        slope = math.atan(self._find_slope(place))
        return point, heading + slope + (0.0 if place.along > 0 else math.pi)

    def _find_slope(self, place: LanePlace) -> float:
        """Measure how fast a lane moves aside, within its section."""
        road = self._document.roads[place.road]
        begins_m, ends_m = _bound_section(
            road, self._find_section(road, place.station_m, place.along)
        )
        low_m = max(place.station_m - SLOPE_STEP_M, begins_m + 3 * BOUNDARY_M)
        high_m = min(place.station_m + SLOPE_STEP_M, ends_m - 3 * BOUNDARY_M)
        if high_m - low_m < SLOPE_STEP_M / 2:
            return 0.0
        before, after = (self.find_left(place._replace(station_m=at)) for at in (low_m, high_m))
        return (after - before) / (high_m - low_m)

    def find_left(self, place: LanePlace) -> float:
        """Compute the distance of a place to the left of the reference line of its road."""
        road = self._document.roads[place.road]
        station_m = min(max(place.station_m, 0.0), road.length_m)
        section = road.sections[self._find_section(road, place.station_m, place.along)]
        middle = float(evaluate_profile(road.lane_offset, np.array([station_m]))[0])
        inner, outer = _find_borders(section, place.lane, station_m - section.begins_m)
        return middle + (inner + outer) / 2 + place.offset_m

    def advance(
        self, place: LanePlace, distance_m: float, offset_m: float, choose: Chooser
    ) -> LanePlace | None:
        """Move along the lane in the plan, to another offset; None beyond the end of all roads."""
        start = self.find_left(place)
        begin, heading = self.locate_road(place.road, place.station_m, start)
        trial_m = place.station_m + place.along * distance_m
        road = self._document.roads[place.road]
        if not 0 <= trial_m <= road.length_m:
            trial_m = place.station_m - place.along * min(distance_m, road.length_m)
        shifted = place._replace(station_m=trial_m, offset_m=offset_m)
        left_m = self.find_left(shifted)
        end, _ = self.locate_road(place.road, trial_m, left_m)
        covered_m = abs(((end - begin) * np.exp(-1j * heading)).real)
        along_m = math.sqrt(max(distance_m**2 - (left_m - start) ** 2, 0.0))
        ratio = abs(trial_m - place.station_m) / covered_m if covered_m > 1e-9 else 1.0
        return self.shift(place._replace(offset_m=offset_m), along_m * ratio, choose)

    def shift(self, place: LanePlace, stations_m: float, choose: Chooser) -> LanePlace | None:
        """Move by a difference of stations; None beyond the end of all roads."""
        for _ in range(MAX_LINKS):
            road = self._document.roads[place.road]
            index = self._find_section(road, place.station_m, place.along)
            begins_m, ends_m = _bound_section(road, index)
            goal_m = place.station_m + place.along * stations_m
            if begins_m - BOUNDARY_M <= goal_m <= ends_m + BOUNDARY_M:
                return place._replace(station_m=goal_m)
            edge_m = ends_m if place.along > 0 else begins_m
            stations_m -= abs(edge_m - place.station_m)
            followed = self._cross(place._replace(station_m=edge_m), road, index, choose)
            if followed is None:
                return None
            place = followed
        return None

    def find_end(self, place: LanePlace) -> LanePlace:
        """Return the end of the road ahead of a place."""
        road = self._document.roads[place.road]
        return place._replace(station_m=road.length_m if place.along > 0 else 0.0)

    def list_followers(self, place: LanePlace) -> list[LanePlace]:
        """List the places behind the end of the road ahead of a place."""
        road = self._document.roads[place.road]
        contact: Contact = "end" if place.along > 0 else "start"
        section = road.sections[-1 if place.along > 0 else 0]
        link = road.get_link(contact)
        if link is None:
            return []
        if link.element_type == "road":
            return self._enter(place, link.id, link.contact, _list_linked(section, place))
        junction = self._document.junctions.get(link.id)
        ways = junction.connections if junction is not None else ()
        return [
            found
            for way in ways
            if way.incoming_road == road.id
            for found in self._enter(place, way.road, way.contact, _list_connected(way, place.lane))
        ]

    def find_nearest(self, point: complex, heading: float) -> LanePlace | None:
        """Find the lane on which a point is, and which way one with a heading faces."""
        best: tuple[float, float, LanePlace] | None = None
        for road_id, station_m in self._list_near(point):
            station_m, left_m, ahead = self._project(road_id, station_m, point)
            if station_m is None:
                continue
            along = 1 if math.cos(heading - ahead) >= 0 else -1
            road = self._document.roads[road_id]
            section = road.sections[self._find_section(road, station_m, along)]
            middle = float(evaluate_profile(road.lane_offset, np.array([station_m]))[0])
            for lane in section.lanes:
                inner, outer = _find_borders(section, lane, station_m - section.begins_m)
                if abs(outer - inner) < 0.05:
                    continue
                away_m = abs(left_m - middle - (inner + outer) / 2) - abs(outer - inner) / 2
                offset_m = left_m - middle - (inner + outer) / 2
                turned = abs(math.sin(heading - ahead))
                rank = max(away_m, 0.0), turned + (along != self.find_direction(road_id, lane))
                if best is None or rank < best[:2]:
                    best = (*rank, LanePlace(road_id, lane, station_m, offset_m, along))
        return best[2] if best is not None and best[0] <= MAX_ASIDE_M else None

    def find_path(self, start: LanePlace, goal: LanePlace) -> list[str] | None:
        """Find the shortest way from a place to another one as roads, both included.

        Returns:
            Ids of the roads; None if none lead there.
        """
        order = count()
        queue: list[tuple[float, int, LanePlace, tuple[str, ...]]] = []
        heappush(queue, (0.0, next(order), start, (start.road,)))
        seen: set[tuple[str, int]] = set()
        while queue:
            length_m, _, place, path = heappop(queue)
            if place.road == goal.road:
                return list(path)
            if (place.road, place.along) in seen:
                continue
            seen.add((place.road, place.along))
            for item in self._list_any_followers(place):
                further_m = length_m + self._document.roads[item.road].length_m
                heappush(queue, (further_m, next(order), item, (*path, item.road)))
        return None

    def _list_any_followers(self, place: LanePlace) -> Iterator[LanePlace]:
        road = self._document.roads[place.road]
        section = road.sections[-1 if place.along > 0 else 0]
        for lane in section.lanes:
            if self.find_direction(place.road, lane) == place.along:
                yield from self.list_followers(place._replace(lane=lane))

    def _cross(self, place: LanePlace, road: Road, index: int, choose: Chooser) -> LanePlace | None:
        following = index + place.along
        if 0 <= following < len(road.sections):
            for lane in _list_linked(road.sections[index], place):
                if lane in road.sections[following].lanes:
                    return place._replace(lane=lane)
            return place if place.lane in road.sections[following].lanes else None
        followers = self.list_followers(place)
        return choose(followers) if len(followers) > 1 else next(iter(followers), None)

    def _enter(
        self, place: LanePlace, road_id: str, contact: Contact, lanes: Sequence[int]
    ) -> list[LanePlace]:
        road = self._document.roads.get(road_id)
        if road is None:
            return []
        along = 1 if contact == "start" else -1
        section = road.sections[0 if contact == "start" else -1]
        station_m = 0.0 if contact == "start" else road.length_m
        sign = 1 if along == place.along else -1
        lanes = lanes or [sign * place.lane]
        return [
            LanePlace(road_id, lane, station_m, sign * place.offset_m, along)
            for lane in lanes
            if lane in section.lanes
        ]

    def _find_section(self, road: Road, station_m: float, along: int) -> int:
        # At a boundary, the section ahead.
        edge_m = station_m + along * 2 * BOUNDARY_M
        begins = [section.begins_m for section in road.sections]
        return max(int(np.searchsorted(begins, edge_m, side="right")) - 1, 0)

    def _list_near(self, point: complex) -> Iterator[tuple[str, float]]:
        """List roads, and their sampled stations nearest to a point, within 60 m."""
        samples = self._samples or self._sample()
        distances = np.hypot(samples.points[:, 0] - point.real, samples.points[:, 1] - point.imag)
        nearest: dict[str, tuple[float, float]] = {}
        for index in np.flatnonzero(distances < 60.0):
            road = samples.roads[index]
            found = float(distances[index]), float(samples.stations_m[index])
            nearest[road] = min(nearest.get(road, found), found)
        yield from ((road, station_m) for road, (_, station_m) in nearest.items())

    def _sample(self) -> _Samples:
        names: list[str] = []
        stations: list[NDArray[np.float64]] = []
        points: list[NDArray[np.float64]] = []
        for road in self._document.roads.values():
            at_m = np.linspace(
                0, road.length_m, max(math.ceil(road.length_m / SAMPLE_STEP_M), 1) + 1
            )
            names += [road.id] * len(at_m)
            stations.append(at_m)
            points.append(sample_plan(road, at_m)[0])
        self._samples = _Samples(tuple(names), np.concatenate(stations), np.concatenate(points))
        return self._samples

    def _project(
        self, road_id: str, station_m: float, point: complex
    ) -> tuple[float, float, float] | tuple[None, float, float]:
        """Refine the station nearest to a point; None if the point is beyond the road's ends."""
        road = self._document.roads[road_id]
        ahead_m, local, heading = 0.0, 0j, 0.0
        for _ in range(5):
            station_m = min(max(station_m + ahead_m, 0.0), road.length_m)
            place, heading = self.locate_road(road_id, station_m, 0.0)
            local = (point - place) * complex(np.exp(-1j * heading))
            ahead_m = local.real
        if abs(ahead_m) > 0.5:
            return None, 0.0, 0.0
        # Across a banked road, the way is longer than in the plan.
        roll = float(evaluate_profile(road.superelevation, np.array([station_m]))[0])
        return station_m, local.imag / math.cos(roll), heading


def _bound_section(road: Road, index: int) -> tuple[float, float]:
    ends = [*(section.begins_m for section in road.sections[1:]), road.length_m]
    return road.sections[index].begins_m, ends[index]


def _find_borders(section: LaneSection, lane: int, along_m: float) -> tuple[float, float]:
    """Compute the inner and outer border of a lane, to the left of the innermost one."""
    side = 1 if lane > 0 else -1
    inner = outer = 0.0
    at_m = np.array([max(along_m, 0.0)])
    for number in range(1, abs(lane) + 1):
        inner = outer
        found = section.lanes.get(side * number)
        if found is None:
            continue
        if found.widths:
            outer = inner + side * max(float(evaluate_profile(found.widths, at_m)[0]), 0.0)
        elif found.borders:
            outer = float(evaluate_profile(found.borders, at_m)[0])
    return inner, outer


def _list_linked(section: LaneSection, place: LanePlace) -> tuple[int, ...]:
    lane = section.lanes.get(place.lane)
    if lane is None:
        return ()
    return lane.successors if place.along > 0 else lane.predecessors


def _list_connected(way: Connection, lane: int) -> tuple[int, ...]:
    if not way.lane_links:
        return ()
    linked = tuple(to for begin, to in way.lane_links if begin == lane)
    # A lane without links leads nowhere: ids of lanes are never this large.
    return linked or (10**9,)


def choose_straightest(roads: RoadMap, place: LanePlace) -> Chooser:
    """Return a chooser of the way with the least turn."""
    end = roads.find_end(place)
    _, heading = roads.locate(end)

    def measure_turn(follower: LanePlace) -> float:
        _, ahead = roads.locate(roads.find_end(follower))
        return abs(math.remainder(ahead - heading, 2 * math.pi))

    return lambda followers: min(followers, key=measure_turn)


def choose_on_route(route: Sequence[str], choose: Chooser) -> Chooser:
    """Return a chooser of the way on a route; another one chooses where no way is on it."""

    def choose_way(followers: Sequence[LanePlace]) -> LanePlace | None:
        on_route = [item for item in followers if item.road in route]
        return on_route[0] if on_route else choose(followers)

    return choose_way
