"""Routes through a road: lane centre lines of streets, connected inside junctions.

The compiler works on them, before there is a SUMO network.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from advercity_dsl import MapNetwork, Road, Vehicle
from advercity_dsl.road import Movement, StripKind
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from advercity.errors import InputError
from advercity.geometry import curves, polyline
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.arms import build_arms, list_movements
from advercity.roads.imported_streets import ImportedStreets, read_imported_streets
from advercity.roads.signals import find_declared_green_s
from advercity.roads.streets import StreetLayout, StripLayout, lay_out_streets

SEARCH_STEP_M = 0.25
"""Step of the search for the nearest station; compiled specs hold the result."""
HEADING_SPAN_M = 1.0
"""Length of the chord for a heading: corners of the polyline must not jerk."""
CROSSING_GAP_M = 1.0
"""Paths cross if they are closer than this."""
LANE_CHANGE_M = 30.0
"""Length over which a vehicle changes from one lane to another."""


LaneChoice = tuple[str, bool, int, int]
"""A street, whether along its axis, the lane at its start and the lane at its end."""


@dataclass(frozen=True)
class RouteSegment:
    """A street on a route.

    Attributes:
        street: The street.
        follows_axis: Whether the route follows its axis.
        lane: Number of the lane at its end, 1 is the innermost.
        start_m: Station of the path at which it begins.
        end_m: Station of the path at which it ends.
    """

    street: StreetLayout
    follows_axis: bool
    lane: int
    start_m: float
    end_m: float

    def strips_on_side(self, *, right: bool) -> tuple[StripLayout, ...]:
        """List strips right or left of the axis, seen in the direction of travel."""
        return self.street.strips_in_direction(along=self.follows_axis == right)

    def lateral_offset(self, t: float) -> float:
        """Convert an offset `t` to an offset to the left of the lane's centre line."""
        centre = self.street.find_lane(self.lane, along=self.follows_axis).centre_t
        return (t - centre) if self.follows_axis else (centre - t)


@dataclass(frozen=True, eq=False)
class RoutePath:
    """The path of a vehicle with its streets.

    Attributes:
        points: (n, 2) metres, from the start of its first street.
        segments: Streets in order.
    """

    points: NDArray[np.float64]
    segments: tuple[RouteSegment, ...]

    @cached_property
    def line(self) -> StationedPolyline:
        """The polyline with stations in metres along the chords."""
        return StationedPolyline.from_points(self.points)

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return self.line.length_m

    def point_at(self, station_m: float, left_m: float = 0.0) -> NDArray[np.float64]:
        """Interpolate the point (2,) at a station, moved `left_m` to the left of the path."""
        normal = polyline.left_normals(polyline.unit_vectors(self.heading_at(station_m)))
        return self.line.points_at(station_m) + left_m * normal

    def heading_at(self, station_m: float) -> float:
        """Compute the direction of travel at a station, radians counter-clockwise from east."""
        return float(self.headings_at(station_m))

    def headings_at(self, stations_m: ArrayLike) -> NDArray[np.float64]:
        """Compute directions of travel (m,) at stations (m,)."""
        return self.line.headings_at(stations_m, span_m=HEADING_SPAN_M)

    def find_nearest_station(self, point: ArrayLike) -> float:
        """Find the sampled station nearest to a point (2,)."""
        gaps = np.linalg.norm(self._search_points - np.asarray(point), axis=1)
        return float(self._search_stations[np.argmin(gaps)])

    def find_crossing_station(self, other: "RoutePath") -> float | None:
        """Find the sampled station where another path crosses this one; None if none does."""
        tree = KDTree(other.line.sample_points(SEARCH_STEP_M))
        gaps, _ = tree.query(self._search_points, distance_upper_bound=2 * CROSSING_GAP_M)
        if gaps.min() > CROSSING_GAP_M:
            return None
        return float(self._search_stations[np.argmax(gaps <= max(CROSSING_GAP_M / 2, gaps.min()))])

    @cached_property
    def _search_stations(self) -> NDArray[np.float64]:
        return np.arange(0.0, self.length_m, SEARCH_STEP_M)

    @cached_property
    def _search_points(self) -> NDArray[np.float64]:
        return self.line.points_at(self._search_stations)


@dataclass(frozen=True, eq=False)
class RoutePlanner:
    """Finds routes through a declared or imported road."""

    road: Road

    @cached_property
    def _imported(self) -> ImportedStreets | None:
        network = self.road.imported
        return read_imported_streets(network.network) if isinstance(network, MapNetwork) else None

    @cached_property
    def streets(self) -> Mapping[str, StreetLayout]:
        """Sampled streets by id."""
        if self._imported:
            return self._imported.streets
        return lay_out_streets(self.road)

    @cached_property
    def movements(self) -> Mapping[str, tuple[Movement, ...]]:
        """Movements by junction."""
        if self._imported:
            return self._imported.movements
        return {
            name: tuple(list_movements(junction, build_arms(name, self.streets)))
            for name, junction in self.road.junctions.items()
        }

    @cached_property
    def controls(self) -> Mapping[str, str]:
        """Rule of right of way by junction, in the words of declared junctions."""
        if self._imported:
            return self._imported.controls
        return {name: junction.control for name, junction in self.road.junctions.items()}

    def find_straightest(self, route: Sequence[str], *, backwards: bool) -> str | None:
        """Find the street straight on from the end of a route, or before its start; None without.

        Streets of the route are left out.
        """
        index = 0 if backwards else len(route) - 1
        street, along = self.streets[route[index]], self.is_along_axis(route, index)
        junction = street.begins if along == backwards else street.ends
        found: list[tuple[float, str]] = []
        for item in self.movements.get(junction, ()):
            here, there = item.to_street, item.from_street
            if not backwards:
                here, there = there, here
            if here == route[index] and there not in route:
                found.append((abs(self.turn_angle(item, junction)), there))
        return min(found)[1] if found else None

    def find_next_green_s(self, first: str, second: str, from_s: float) -> float | None:
        """Compute the first time from `from_s` on with green for a movement.

        Args:
            first: Street before the movement.
            second: Street behind it.
            from_s: Time since the scenario's start.

        Returns:
            Seconds since the scenario's start; None if no light governs the movement.
        """
        if self._imported:
            governed = self._imported.signals.get((first, second))
            return governed[0].find_next_green_s(governed[1], from_s) if governed else None
        junction = self.find_junction(first, second)
        signals = self.road.junctions[junction].signals if junction else None
        return find_declared_green_s(signals, first, from_s) if signals else None

    def have_green_together(self, junction: str, streets: Collection[str]) -> bool:
        """Return whether a junction's lights let streets go at the same time."""
        if self._imported:
            return self._imported.have_green_together(junction, streets)
        declared = self.road.junctions.get(junction)
        signals = declared.signals if declared else None
        return signals is not None and any({*streets} <= {*phase} for phase in signals.phases)

    def find_junction(self, first: str, second: str) -> str | None:
        """Find the junction with a movement from a street into another; None without one."""
        return self._junctions.get((first, second))

    @cached_property
    def _junctions(self) -> dict[tuple[str, str], str]:
        """Junction of each pair of streets with a movement, the first in the file."""
        found: dict[tuple[str, str], str] = {}
        for name, movements in self.movements.items():
            for item in movements:
                found.setdefault((item.from_street, item.to_street), name)
        return found

    def find_intersection(self, vehicle: Vehicle) -> int | None:
        """Find after which street of its route a vehicle makes its manoeuvre; None if nowhere."""
        for index, (first, second) in enumerate(pairwise(vehicle.route)):
            junction = self.find_junction(first, second)
            movements = self.movements.get(junction or "", ())
            streets = {name for item in movements for name in (item.from_street, item.to_street)}
            if junction == vehicle.junction if vehicle.junction else len(streets) > 2:
                return index
        return None

    def approach_heading(self, street: str, junction: str) -> float:
        """Compute the heading, radians, with which a street leads into a junction."""
        layout = self.streets[street]
        at_end = layout.ends == junction
        return float(layout.headings[-1] if at_end else layout.headings[0] + np.pi)

    def turn_angle(self, movement: Movement, junction: str) -> float:
        """Compute the turn of a movement, in (-pi, pi] radians; positive to the left."""
        leaves = self.approach_heading(movement.to_street, junction) + np.pi
        turned = leaves - self.approach_heading(movement.from_street, junction)
        return float(np.pi - (np.pi - turned) % (2 * np.pi))

    def build_path(self, streets: Sequence[str], lane: int | None = None) -> RoutePath:
        """Build the path along streets, in the lanes from each into the next.

        It starts in the numbered lane; None is the innermost suitable one. InputError if no
        movement leads from one street into the next.
        """
        return self._join_lanes(list(self._choose_lanes(streets, lane)))

    def _choose_lanes(self, streets: Sequence[str], lane: int | None) -> Iterator[LaneChoice]:
        fitting = self._find_fitting_lanes(streets)
        entered = lane
        for index, street in enumerate(streets):
            along = self.is_along_axis(streets, index)
            leaves = fitting[index]
            start = entered if entered is not None else min(leaves)
            left = min(leaves, key=lambda number: abs(number - start))
            yield street, along, start, left
            if index + 1 < len(streets):
                links = [
                    item.to_lane
                    for items in self.movements.values()
                    for item in items
                    if (item.from_street, item.from_lane, item.to_street)
                    == (street, left, streets[index + 1])
                ]
                # Where no lane leads on, the vehicle changes lanes in the next street.
                entered = next((lane for lane in links if lane in fitting[index + 1]), links[0])

    def _find_fitting_lanes(self, streets: Sequence[str]) -> list[set[int]]:
        """List, per street, the lanes from which the remaining streets can be reached."""
        along = self.is_along_axis(streets, len(streets) - 1)
        last = {
            strip.lane_number
            for strip in self.streets[streets[-1]].strips_in_direction(along=along)
            if strip.lane_number
        }
        if not last:
            raise InputError(f"'{streets[-1]}' is one-way")
        fitting = [last]
        for first, second in reversed(list(pairwise(streets))):
            links = [
                item
                for items in self.movements.values()
                for item in items
                if item.from_street == first and item.to_street == second
            ]
            if not links:
                raise InputError(f"no movement leads from '{first}' into '{second}'")
            good = {item.from_lane for item in links if item.to_lane in fitting[0]}
            fitting.insert(0, good or {item.from_lane for item in links})
        return fitting

    def is_along_axis(self, streets: Sequence[str], index: int) -> bool:
        """Whether a route follows the axis of one of its streets.

        A single street does, unless it is one-way against its axis.
        """
        if len(streets) == 1:
            strips = self.streets[streets[0]].strips_in_direction(along=True)
            return any(strip.kind is StripKind.LANE for strip in strips)
        if index + 1 < len(streets):
            junction = self.find_junction(streets[index], streets[index + 1])
            return self.streets[streets[index]].ends == junction
        junction = self.find_junction(streets[index - 1], streets[index])
        return self.streets[streets[index]].begins == junction

    def _join_lanes(self, taken: Sequence[LaneChoice]) -> RoutePath:
        pieces: list[NDArray[np.float64]] = []
        segments: list[RouteSegment] = []
        for name, along, entered, left in taken:
            street = self.streets[name]
            line = _build_driven_line(street, entered, left, along=along)
            begins_m = 0.0
            if segments:
                before = segments[-1]
                link = curves.build_connecting_curve(
                    pieces[-1][-1],
                    before.street.directed_tangents(along=before.follows_axis)[-1],
                    line[0],
                    street.directed_tangents(along=along)[0],
                    radius_m=self._find_turn_radius_m(before.street.id, name),
                )
                # Both ends of the link repeat the lanes' own points.
                pieces.append(link[1:-1])
                begins_m = polyline.polyline_length(np.concatenate([*pieces, line[:1]]))
            ends_m = begins_m + polyline.polyline_length(line)
            pieces.append(line)
            segments.append(RouteSegment(street, along, left, begins_m, ends_m))
        return RoutePath(polyline.drop_repeated_points(np.concatenate(pieces)), tuple(segments))

    def _find_turn_radius_m(self, first: str, second: str) -> float:
        """Find the declared radius of turns from a street into another; infinity without one."""
        junction = self.road.junctions.get(self.find_junction(first, second) or "")
        return (junction.turn_radius_m if junction else None) or np.inf


def _build_driven_line(
    street: StreetLayout, entered: int, left: int, *, along: bool
) -> NDArray[np.float64]:
    """Build the line (n, 2) of a vehicle that changes from one lane of a street to another."""
    line = _build_lane_line(street, entered, along=along)
    if left == entered:
        return line
    target = _build_lane_line(street, left, along=along)
    fine = max(int(polyline.polyline_length(line)), 2)
    line, target = (polyline.resample_polyline(item, fine) for item in (line, target))
    fraction = np.clip(polyline.polyline_stations(line) / LANE_CHANGE_M, 0, 1)[:, None]
    return (1 - fraction) * line + fraction * target


def _build_lane_line(street: StreetLayout, lane: int, *, along: bool) -> NDArray[np.float64]:
    return street.directed_line(street.find_lane(lane, along=along).centre_t, along=along)[:, :2]


def build_ego_path(planner: RoutePlanner, ego: Vehicle) -> tuple[RoutePath, float, float]:
    """Build the ego's path, and find the stations of its spawn and its destination on it."""
    street = planner.streets[ego.route[0]]
    along = planner.is_along_axis(ego.route, 0)
    gaps = {
        strip.lane_number: _compute_lateral_gap(street, strip, ego)
        for strip in street.strips_in_direction(along=along)
        if strip.kind is StripKind.LANE
    }
    lane = min(gaps, key=lambda number: gaps[number])
    path = planner.build_path(ego.route, lane)
    start_m, end_m = (path.find_nearest_station(p) for p in (ego.spawn_m, ego.destination_m))
    return path, start_m, end_m


def _compute_lateral_gap(street: StreetLayout, strip: StripLayout, ego: Vehicle) -> float:
    line = street.offset_line(strip.centre_t)[:, :2]
    fine = polyline.resample_polyline(line, max(int(polyline.polyline_length(line)), 2))
    return float(np.linalg.norm(fine - np.array(ego.spawn_m), axis=1).min())
