"""Samples of an OpenDRIVE map by the formulas of the standard (ASAM OpenDRIVE 1.8).

They share no code with the importer, so that the two can be compared. Points are in the coordinates
of the map, s is the distance along a road's reference line, t the distance to its left.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SPEED_UNITS_M_S = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
VEHICLE_LANES = frozenset(
    {"driving", "bidirectional", "bus", "taxi", "HOV", "entry", "exit", "onRamp", "offRamp"}
    | {"connectingRamp", "slipLane", "mwyEntry", "mwyExit"}
)
"""Types of lanes that motor vehicles drive on."""
NOT_SAMPLED = (
    "road/lateralProfile/crossSectionSurface",
    "road/lanes/laneSection[@singleSide='true']",
)
HEADING_SCALE_M = 3.0
"""Metres that a radian counts as, where samples are compared as poses."""
SAME_PLACE_M = 1e-6
"""A record that starts at most so far ahead of a place is valid there: numbers are rounded."""
END_MARGIN_M = 1e-5
"""Lanes are sampled to so far from the end of their section, where the next records start."""
TANGENT_STEP_M = 0.02
"""Distance between the two points that a heading is taken from."""
POLY3_STEPS = 4000
"""Chords whose lengths turn a distance along a cubic curve into its parameter."""


@dataclass(frozen=True, eq=False)
class Cubics:
    """A piecewise cubic polynomial, zero before its first piece.

    Attributes:
        starts: (n,) start of each piece, ascending.
        coefficients: (n, 4) constant, linear, quadratic and cubic coefficient.
    """

    starts: Floats
    coefficients: Floats

    @classmethod
    def from_elements(cls, elements: Iterable[Element], start: str = "s") -> "Cubics":
        """Read pieces whose start is in the named attribute; of equal starts the last is valid."""
        rows = {
            float(item.get(start, 0)): [float(item.get(name, 0)) for name in "abcd"]
            for item in elements
        }
        starts = sorted(rows)
        return cls(np.array(starts), np.array([rows[s] for s in starts]).reshape(-1, 4))

    def at(self, s: Floats) -> Floats:
        """Evaluate at distances (n,)."""
        if not len(self.starts):
            return np.zeros_like(s)
        index = find_pieces(self.starts, s)
        powers = np.maximum(s - self.starts[index], 0.0)[:, None] ** np.arange(4)
        values = (self.coefficients[index] * powers).sum(axis=1)
        return np.where(s + SAME_PLACE_M < self.starts[0], 0.0, values)


def find_pieces(starts: Floats, s: Floats) -> NDArray[np.intp]:
    """Find the pieces that distances are in; the first also for those before it."""
    return np.maximum(np.searchsorted(starts, s + SAME_PLACE_M, side="right") - 1, 0)


class Road:
    """The surface of a road: its reference line, profiles and shape.

    Attributes:
        id: Id of the road.
        junction: Id of the junction that it is in, or empty.
        length_m: Length as declared, or of its geometries if these are shorter.
        element: Its element.
    """

    def __init__(self, element: Element) -> None:
        self.element = element
        self.id = element.get("id", "")
        junction = element.get("junction", "-1")
        self.junction = "" if junction == "-1" else junction
        self._geometries = sorted(
            element.iterfind("planView/geometry"), key=lambda item: float(item.get("s", 0))
        )
        self._geometry_starts = np.array([float(item.get("s", 0)) for item in self._geometries])
        ends = [float(item.get("s", 0)) + float(item.get("length", 0)) for item in self._geometries]
        self.length_m = min(float(element.get("length", 0)), max(ends, default=0.0))
        self._elevation = Cubics.from_elements(element.iterfind("elevationProfile/elevation"))
        self._superelevation = Cubics.from_elements(
            element.iterfind("lateralProfile/superelevation")
        )
        self._shapes = _read_shapes(element)

    def reference_line(self, s: Floats) -> tuple[Floats, Floats]:
        """Compute points (n, 2) and headings (n,) of the reference line."""
        points, headings = np.zeros((len(s), 2)), np.zeros(len(s))
        pieces = find_pieces(self._geometry_starts, s)
        for index in np.unique(pieces):
            geometry, among = self._geometries[index], pieces == index
            along = s[among] - self._geometry_starts[index]
            u, v, turn = _compute_local_curve(geometry, along)
            heading = float(geometry.get("hdg", 0))
            cos, sin = math.cos(heading), math.sin(heading)
            points[among, 0] = float(geometry.get("x", 0)) + cos * u - sin * v
            points[among, 1] = float(geometry.get("y", 0)) + sin * u + cos * v
            headings[among] = heading + turn
        return points, headings

    def surface(self, s: Floats, t: Floats, level_from: Floats, height_m: Floats) -> Floats:
        """Compute points (n, 3) of the road's surface.

        Args:
            s: (n,) distances along the reference line.
            t: (n,) distances to its left.
            level_from: (n,) t beyond which superelevation and shape no longer count.
            height_m: (n,) height of the lane above the road.
        """
        points, heading = self.reference_line(s)
        step = TANGENT_STEP_M
        # The surface turns about the reference line: first by its slope, then by superelevation.
        slope = np.arctan((self._elevation.at(s + step) - self._elevation.at(s)) / step)
        roll = self._superelevation.at(s)
        aside = np.column_stack([-np.sin(heading), np.cos(heading)])
        along = np.column_stack([np.cos(heading), np.sin(heading)])
        banked = np.where(np.abs(t) > np.abs(level_from), level_from, t)
        plan = points + (banked * np.cos(roll) + t - banked)[:, None] * aside
        plan -= (banked * np.sin(slope) * np.sin(roll))[:, None] * along
        z = self._elevation.at(s) + banked * np.cos(slope) * np.sin(roll)
        return np.column_stack([plan, z + self._shape_at(s, banked) + height_m])

    def _shape_at(self, s: Floats, t: Floats) -> Floats:
        if not self._shapes:
            return np.zeros_like(s)
        stations = np.array([station for station, _ in self._shapes])
        values = np.array([shape.at(t) for _, shape in self._shapes])
        before = find_pieces(stations, s)
        after = np.minimum(before + 1, len(stations) - 1)
        gap = np.where(after > before, stations[after] - stations[before], 1.0)
        part = np.clip((s - stations[before]) / gap, 0.0, 1.0) * (after > before)
        rows = np.arange(len(s))
        return (1 - part) * values[before, rows] + part * values[after, rows]


def _read_shapes(road: Element) -> list[tuple[float, Cubics]]:
    groups: dict[float, list[Element]] = {}
    for item in road.iterfind("lateralProfile/shape"):
        groups.setdefault(float(item.get("s", 0)), []).append(item)
    return [(s, Cubics.from_elements(groups[s], start="t")) for s in sorted(groups)]


def _compute_local_curve(geometry: Element, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Compute u, v and heading of a geometry, all (n,), in its own frame."""
    length = float(geometry.get("length", 0))
    for shape in geometry:
        match shape.tag:
            case "line":
                return along, np.zeros_like(along), np.zeros_like(along)
            case "arc":
                curvature = float(shape.get("curvature", 0))
                return integrate_curvature(curvature, curvature, length, along)
            case "spiral":
                start, end = (float(shape.get(name, 0)) for name in ("curvStart", "curvEnd"))
                return integrate_curvature(start, end, length, along)
            case "poly3":
                return _compute_poly3(shape, length, along)
            case "paramPoly3":
                scale = 1.0 if shape.get("pRange") == "arcLength" else 1 / length
                p = along * scale
                (u, slope_u), (v, slope_v) = (_evaluate_curve(shape, axis, p) for axis in "UV")
                return u, v, np.arctan2(slope_v, slope_u)
            case _:
                continue
    raise ValueError(f"a geometry at s={geometry.get('s')} has no shape")


def integrate_curvature(
    start: float, end: float, length: float, along: Floats
) -> tuple[Floats, Floats, Floats]:
    """Integrate a curvature that changes linearly over a length: u, v and heading, all (n,)."""
    change = (end - start) / length if length else 0.0
    nodes, weights = np.polynomial.legendre.leggauss(64)
    at = along[:, None] * (nodes + 1) / 2
    turn = start * at + change * at**2 / 2
    half = along / 2
    heading = start * along + change * along**2 / 2
    return half * (np.cos(turn) @ weights), half * (np.sin(turn) @ weights), heading


def _compute_poly3(shape: Element, length: float, along: Floats) -> tuple[Floats, Floats, Floats]:
    u = np.linspace(0.0, length, POLY3_STEPS)
    v, _ = _evaluate_curve(shape, "", u)
    stations = np.concatenate([[0.0], np.hypot(np.diff(u), np.diff(v)).cumsum()])
    at = np.interp(along, stations, u)
    v, slope = _evaluate_curve(shape, "", at)
    return at, v, np.arctan(slope)


def _evaluate_curve(shape: Element, axis: str, at: Floats) -> tuple[Floats, Floats]:
    """Evaluate the cubic of a geometry's axis, `U`, `V` or empty, and its derivative."""
    a, b, c, d = (float(shape.get(name + axis, 0)) for name in "abcd")
    return a + b * at + c * at**2 + d * at**3, b + 2 * c * at + 3 * d * at**2


def build_poses(points: Floats, heading: Floats) -> Floats:
    """Join points (n, 3) and headings (n,) to rows whose distances say how alike poses are."""
    direction = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.hstack([points, HEADING_SCALE_M * direction])


@dataclass(frozen=True, eq=False)
class LaneSamples:
    """A lane of one lane section, sampled in the direction of travel.

    Attributes:
        road: Id of its road.
        lane: Its id.
        type: Its type in the file.
        section: Number of its lane section, from 0.
        s: (n,) distances along the reference line, m.
        borders: (2, n, 3) its inner and outer border, m.
        heading: (n,) direction of travel, rad.
        width_m: (n,) distance between its borders.
        speed_limit_m_s: (n,) its limit, NaN where the file has none.
    """

    road: str
    lane: int
    type: str
    section: int
    s: Floats
    borders: Floats
    heading: Floats
    width_m: Floats
    speed_limit_m_s: Floats

    @property
    def centre(self) -> Floats:
        """Points (n, 3) half way between its borders, m."""
        return self.borders.mean(axis=0)


class LaneSection:
    """Lanes side by side from one distance along a road to another.

    Attributes:
        index: Number of the section, from 0.
        start_m, end_m: Distances between which it is valid.
        lanes: Elements of its lanes by id, without the centre lane.
    """

    def __init__(self, road: Road, element: Element, index: int, end_m: float) -> None:
        self.road = road
        self.index = index
        self.start_m, self.end_m = float(element.get("s", 0)), end_m
        self.lanes = {
            int(lane.get("id", 0)): lane
            for side in ("left", "right")
            for lane in element.iterfind(f"{side}/lane")
        }
        self._offset = Cubics.from_elements(road.element.iterfind("lanes/laneOffset"))

    def is_for_vehicles(self, lane: int) -> bool:
        """Whether motor vehicles drive on a lane."""
        return self.lanes[lane].get("type") in VEHICLE_LANES

    def sample(self, lane: int, step_m: float) -> LaneSamples:
        """Sample a lane at distances of at most `step_m`, its ends included."""
        count = max(2, math.ceil((self.end_m - self.start_m) / step_m) + 1)
        end_m = max(self.start_m, self.end_m - END_MARGIN_M)
        s = np.linspace(self.start_m, end_m, count)
        ahead = np.minimum(s + TANGENT_STEP_M / 2, end_m)
        behind = np.maximum(s - TANGENT_STEP_M / 2, self.start_m)
        tangent = self._centre(lane, ahead) - self._centre(lane, behind)
        inner, outer = self._surface_borders(lane, s)
        order = slice(None) if self.runs_along(lane) else slice(None, None, -1)
        tangent = tangent if self.runs_along(lane) else -tangent
        element = self.lanes[lane]
        return LaneSamples(
            road=self.road.id,
            lane=lane,
            type=element.get("type", ""),
            section=self.index,
            s=s[order],
            borders=np.stack([inner[order], outer[order]]),
            heading=np.arctan2(tangent[order, 1], tangent[order, 0]),
            width_m=np.linalg.norm(outer - inner, axis=1)[order],
            speed_limit_m_s=self._speed_limits(element, s)[order],
        )

    def _centre(self, lane: int, s: Floats) -> Floats:
        inner, outer = self._surface_borders(lane, s)
        return (inner + outer) / 2

    def _surface_borders(self, lane: int, s: Floats) -> tuple[Floats, Floats]:
        """Compute the inner and outer border, both (n, 3)."""
        borders = self._border_offsets(lane, s)
        side = math.copysign(1, lane)
        level = np.full_like(s, side * math.inf)
        for between, number in enumerate(self._lanes_up_to(lane)):
            if self.lanes[number].get("level") in ("true", "1"):
                level = borders[between]
                break
        heights = _read_heights(self.lanes[lane], s - self.start_m)
        inner, outer = (
            self.road.surface(s, t, level, height)
            for t, height in zip(borders[-2:], heights, strict=True)
        )
        return inner, outer

    def _border_offsets(self, lane: int, s: Floats) -> list[Floats]:
        """Compute t of the borders from the centre lane to the outer one of a lane."""
        side, at = math.copysign(1, lane), s - self.start_m
        borders = [self._offset.at(s)]
        for number in self._lanes_up_to(lane):
            element = self.lanes[number]
            if element.find("width") is None and element.find("border") is not None:
                border = Cubics.from_elements(element.iterfind("border"), start="sOffset").at(at)
                borders.append(side * np.abs(border))
            else:
                width = Cubics.from_elements(element.iterfind("width"), start="sOffset").at(at)
                borders.append(borders[-1] + side * np.maximum(width, 0.0))
        return borders

    def _lanes_up_to(self, lane: int) -> list[int]:
        return sorted(
            (number for number in self.lanes if number * lane > 0 and abs(number) <= abs(lane)),
            key=abs,
        )

    def runs_along(self, lane: int) -> bool:
        """Whether a lane leads along the reference line."""
        along = (lane < 0) == (self.road.element.get("rule", "RHT") != "LHT")
        return along != (self.lanes[lane].get("direction") == "reversed")

    def _speed_limits(self, lane: Element, s: Floats) -> Floats:
        limits = np.full_like(s, math.nan)
        for item in sorted(self.road.element.iterfind("type"), key=_start):
            speed = item.find("speed")
            limits[s >= _start(item)] = math.nan if speed is None else read_speed_m_s(speed)
        for item in sorted(lane.iterfind("speed"), key=_start):
            limits[s - self.start_m >= _start(item)] = read_speed_m_s(item)
        return limits


def _start(item: Element) -> float:
    return float(item.get("s", item.get("sOffset", 0))) - SAME_PLACE_M


def _read_heights(lane: Element, at: Floats) -> tuple[Floats, Floats]:
    inner, outer = np.zeros_like(at), np.zeros_like(at)
    for item in sorted(lane.iterfind("height"), key=_start):
        inner[at >= _start(item)] = float(item.get("inner", 0))
        outer[at >= _start(item)] = float(item.get("outer", 0))
    return inner, outer


def read_speed_m_s(speed: Element) -> float:
    """Read a speed limit; NaN for `no limit` and `undefined`."""
    try:
        return float(speed.get("max", "")) * SPEED_UNITS_M_S[speed.get("unit", "m/s")]
    except (ValueError, KeyError):
        return math.nan


class OpenDriveMap:
    """The roads of a map and their lane sections, in file order.

    Raises:
        ValueError: The map has something that is not sampled, or a value that is no number.
    """

    def __init__(self, root: Element) -> None:
        for name in NOT_SAMPLED:
            if root.find(name) is not None:
                raise ValueError(f"{name.rpartition('/')[2]} is not sampled")
        self.root = root
        self.roads = {road.id: road for road in map(Road, root.iterfind("road"))}

    @cached_property
    def sections(self) -> dict[str, list[LaneSection]]:
        """Lane sections by road, in the order of s; those without length are left out."""
        return {road.id: list(_read_sections(road)) for road in self.roads.values()}

    def sample_vehicle_lanes(self, step_m: float) -> Iterator[LaneSamples]:
        """Sample the lanes that motor vehicles drive on."""
        for sections in self.sections.values():
            for section in sections:
                for lane in filter(section.is_for_vehicles, section.lanes):
                    yield section.sample(lane, step_m)


def _read_sections(road: Road) -> Iterator[LaneSection]:
    elements = sorted(road.element.iterfind("lanes/laneSection"), key=_start)
    ends = [float(item.get("s", 0)) for item in elements[1:]] + [road.length_m]
    for index, (element, end_m) in enumerate(zip(elements, ends, strict=True)):
        if end_m > float(element.get("s", 0)):
            yield LaneSection(road, element, index, end_m)
