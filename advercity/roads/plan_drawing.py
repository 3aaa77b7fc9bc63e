"""Plans of a road: lanes, crossings, signals, agents with headings, routes and fields of view."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from advercity_dsl import Mount, RoadsideUnit, Spec, Vehicle
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Uint8Array
from advercity.geometry.mesh import extract_polygons, triangulate_polygon
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.markings import place_zebra_bars
from advercity.roads.road_network import RoadNetwork
from advercity.roads.streets import StreetLayout

SIZE_PX, MAX_SIZE_PX = 1600, 6000
BARE_PX_PER_M = 6.0
"""Scale of plans without agents, larger to make ids of lanes readable."""
MARGIN_M = 15.0
MAP_PX_PER_M = 4.0
"""Scale of plans of whole maps."""
MAP_MARGIN_M = 100.0
"""Distance from a map's junctions, or a scenario's agents, to which it is drawn."""
VIEW_DISTANCE_M = 40.0
"""Length of the wedges for fields of view."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_SCALE = 0.45
FRACTIONAL_BITS = 4
"""Fractional bits of OpenCV's drawing coordinates."""
BACKGROUND_COLOUR = (214, 232, 222)
INK_COLOUR = (40, 40, 40)
LANE_COLOURS = {
    "driving": (120, 120, 120),
    "parking": (140, 135, 130),
    "shoulder": (150, 148, 145),
    "sidewalk": (205, 195, 205),
}
"""BGR by kind of lane, in drawing order."""
PAINT_COLOUR = (255, 255, 255)
AGENT_COLOURS = {"ego": (40, 40, 220), "other": (200, 90, 20), "unit": (20, 140, 20)}
CONFLICT_COLOUR = (30, 30, 200)
JUNCTION_COLOUR = (160, 40, 160)
GRID_COLOUR = (200, 215, 206)
GRID_STEPS_M = (10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 50_000)
MAX_GRID_LINES = 16
STATION_STEP_M, STATION_COLOUR = 50.0, (170, 90, 20)
ARROW_M, ARROW_COLOUR = 4.0, (30, 110, 30)
LANE_ID_FRACTIONS = (0.25, 0.33, 0.41)
"""Where along neighbouring lanes their ids are; streets have their names in the middle."""
MIN_LABELLED_PX = 90
"""Shorter lanes have no id in the drawing."""


@dataclass(frozen=True)
class PlanLabel:
    """A text with its lower left corner at a pixel; not `needed` if others may take its place."""

    text: str
    left: int
    bottom: int
    colour: tuple[int, int, int]
    needed: bool

    @property
    def box(self) -> tuple[int, int, int, int]:
        """The label's area: left, top, right, bottom."""
        (width, height), below = cv2.getTextSize(self.text, FONT, FONT_SCALE, 1)
        left, bottom = self.left, self.bottom
        return left - 3, bottom - height - 3, left + width + 3, bottom + below

    def overlaps(self, other: "PlanLabel") -> bool:
        """Return whether two labels cover each other."""
        left, top, right, bottom = self.box
        other_left, other_top, other_right, other_bottom = other.box
        is_apart = right < other_left or other_right < left
        return not (is_apart or bottom < other_top or other_bottom < top)

    def leaves(self, width: int, height: int) -> bool:
        """Return whether the label is partly outside an image."""
        left, top, right, bottom = self.box
        return left < 0 or top < 0 or right >= width or bottom >= height

    def move_below(self, other: "PlanLabel") -> "PlanLabel":
        """Return the label where it is just below another."""
        return replace(self, bottom=self.bottom + other.box[3] + 1 - self.box[1])

    def draw(self, image: Uint8Array) -> None:
        """Draw the label onto an image."""
        low, high, at = self.box[:2], self.box[2:], (self.left, self.bottom)
        cv2.rectangle(image, low, high, (250, 250, 250), cv2.FILLED)
        cv2.putText(image, self.text, at, FONT, FONT_SCALE, self.colour, 1, cv2.LINE_AA)


class PlanCanvas:
    """An image to draw on in world metres, north up, BGR."""

    def __init__(
        self, low: NDArray[np.float64], high: NDArray[np.float64], size_px: float = SIZE_PX
    ) -> None:
        self.low, self.high = low, high
        self.px_per_m = size_px / float(max(high - low))
        width, height = np.ceil((high - low) * self.px_per_m).astype(int)
        self._corner = np.array([low[0], high[1]])
        self.image: Uint8Array = np.full((height, width, 3), BACKGROUND_COLOUR, np.uint8)
        self._labels: list[PlanLabel] = []

    def _pixels(self, points: ArrayLike) -> NDArray[np.int32]:
        plane = np.asarray(points, dtype=np.float64)[..., :2] - self._corner
        scaled = plane * [self.px_per_m, -self.px_per_m] * 2**FRACTIONAL_BITS
        return np.rint(scaled).astype(np.int32)

    def fill(self, outline: ArrayLike, colour: tuple[int, int, int], *, opacity: float = 1) -> None:
        """Fill a polygon (n, 2 or 3)."""
        # OpenCV draws without transparency; the layer is blended with the image afterwards.
        layer = self.image if opacity >= 1 else self.image.copy()
        cv2.fillPoly(layer, [self._pixels(outline)], colour, cv2.LINE_AA, FRACTIONAL_BITS)
        if opacity < 1:
            blended = cv2.addWeighted(layer, opacity, self.image, 1 - opacity, 0)
            self.image = blended.astype(np.uint8)

    def line(self, points: ArrayLike, colour: tuple[int, int, int], width_px: int = 1) -> None:
        """Draw a line (n, 2 or 3)."""
        pixels = [self._pixels(points)]
        cv2.polylines(self.image, pixels, False, colour, width_px, cv2.LINE_AA, FRACTIONAL_BITS)

    def text(
        self,
        at: ArrayLike,
        text: str,
        colour: tuple[int, int, int] = INK_COLOUR,
        *,
        needed: bool = False,
    ) -> None:
        """Add a label next to a point (2,), which `draw_labels` draws."""
        x, y = (self._pixels(at) >> FRACTIONAL_BITS).tolist()
        self._labels.append(PlanLabel(text, x + 8, y - 8, colour, needed=needed))

    def draw_labels(self) -> None:
        """Draw all needed labels, and of the others, in order, as many as find room."""
        height, width = self.image.shape[:2]
        drawn: list[PlanLabel] = []
        for label in sorted(self._labels, key=lambda item: not item.needed):
            covered = [other for other in drawn if label.overlaps(other)]
            while covered and label.needed:
                label = label.move_below(covered[0])
                covered = [other for other in drawn if label.overlaps(other)]
            if label.needed or not (covered or label.leaves(width, height)):
                label.draw(self.image)
                drawn.append(label)
        self._labels.clear()


def draw_plan(network: RoadNetwork, spec: Spec | None = None) -> Uint8Array:
    """Draw the plan of a road, BGR; with a spec, also fields of view and staged conflicts.

    North is up; the bar is 50 m long. Without agents there are coordinates, ids of lanes and
    stations of streets, by which they and surroundings are placed.
    """
    return draw_plan_canvas(network, spec, around_agents=spec is not None).image


def draw_plan_canvas(
    network: RoadNetwork, spec: Spec | None = None, *, around_agents: bool = False
) -> PlanCanvas:
    """Draw the plan on a canvas for more drawing; of a map around its agents alone."""
    road, found = network.declaration, network.lanes
    canvas = _create_canvas(network, around_agents=around_agents)
    if road.imported is not None:
        _fill_area(canvas, network.paved_area, LANE_COLOURS["sidewalk"])
    _fill_area(canvas, network.roadway_level_area, LANE_COLOURS["driving"])
    for kind, colour in LANE_COLOURS.items():
        for lane in found:
            if lane.kind == kind:
                canvas.fill(np.concatenate([lane.left, lane.right[::-1]]), colour)
    for lane in found:
        if lane.kind == "crossing":
            _draw_crossing(canvas, lane)
    for lane in found:
        if lane.kind == "driving" and not lane.in_junction:
            canvas.line(lane.left, PAINT_COLOUR)
            canvas.line(lane.right, PAINT_COLOUR)
    for name, point in _find_junctions(network).items():
        canvas.text(point, name, JUNCTION_COLOUR)
    for name, street in network.streets.items():
        canvas.text(street.points_at(float(street.stations[-1]) / 2, 0.0), name)
    if not road.agents:
        _draw_grid(canvas)
        for lane in found:
            if lane.kind == "driving" and not lane.in_junction:
                _draw_lane_id(canvas, lane, network.streets)
        for street in network.streets.values():
            _draw_stations(canvas, street)
    for head in network.traffic_lights:
        canvas.line([head.mast_foot_m, head.position_m[:2]], INK_COLOUR)
        canvas.fill(_circle(head.position_m[:2], 0.8), (0, 160, 240))
    if spec is not None:
        for agent in spec.agents:
            for camera, mount, _ in agent.sensors.cameras:
                _draw_view(canvas, agent.place, mount, camera.side_angles_rad)
    for place in road.agents.values():
        if isinstance(place, Vehicle):
            for lane in _route_lanes(place, found):
                canvas.line((lane.left + lane.right) / 2, _agent_colour(place), 2)
    for name, place in road.agents.items():
        _draw_agent(canvas, name, place)
    for conflict in spec.conflicts if spec is not None else ():
        canvas.fill(_circle(conflict.point_m, 1.5), CONFLICT_COLOUR, opacity=0.7)
        canvas.text(conflict.point_m, conflict.conflict, CONFLICT_COLOUR, needed=True)
        for actor in conflict.actors:
            if len(actor.path_m) > 1:
                canvas.line(actor.path_m, CONFLICT_COLOUR, 2)
    canvas.draw_labels()
    _draw_scale_bar(canvas)
    return canvas


def _draw_grid(canvas: PlanCanvas) -> None:
    """Draw lines at round coordinates in metres, with which agents are placed."""
    low, high = canvas.low, canvas.high
    step_m = next(step for step in GRID_STEPS_M if max(high - low) / step <= MAX_GRID_LINES)
    for axis in (0, 1):
        for value in np.arange(np.ceil(low[axis] / step_m), high[axis] / step_m) * step_m:
            ends = np.array([low, high])
            ends[:, axis] = value
            canvas.line(ends, GRID_COLOUR)
            canvas.text(ends[0] + 2 * (1 - axis), f"{value + 0.0:g}", needed=True)


def _fill_area(canvas: PlanCanvas, area: BaseGeometry, colour: tuple[int, int, int]) -> None:
    for polygon in extract_polygons(area):
        corners, triangles = triangulate_polygon(polygon)
        for triangle in triangles:
            canvas.fill(corners[triangle], colour)


def _draw_crossing(canvas: PlanCanvas, lane: LaneSegment) -> None:
    start, end = (lane.left[[0, -1], :2] + lane.right[[0, -1], :2]) / 2
    width_m = float(np.linalg.norm(lane.left[0, :2] - lane.right[0, :2]))
    for left, right in place_zebra_bars(start, end, width_m=width_m):
        canvas.fill(np.concatenate([left, right[::-1]]), PAINT_COLOUR)


def _draw_lane_id(
    canvas: PlanCanvas, lane: LaneSegment, streets: Mapping[str, StreetLayout]
) -> None:
    """Draw an arrow along a lane with its id without the street's name."""
    line = StationedPolyline.from_points((lane.left + lane.right) / 2)
    if line.length_m * canvas.px_per_m < MIN_LABELLED_PX:
        return
    at_m = line.length_m * LANE_ID_FRACTIONS[int(lane.id[-1]) % len(LANE_ID_FRACTIONS)]
    tip, tail = line.points_at(np.array([at_m, at_m - ARROW_M]))
    canvas.line([tail, tip], ARROW_COLOUR, 2)
    canvas.fill(_circle(tip, ARROW_M / 6), ARROW_COLOUR)
    street = max((name for name in streets if lane.id.startswith(name)), key=len, default="")
    canvas.text(tip, lane.id.removeprefix(street), ARROW_COLOUR)


def _draw_stations(canvas: PlanCanvas, street: StreetLayout) -> None:
    """Draw distances along an axis, by which surroundings are placed along a street."""
    for station in np.arange(STATION_STEP_M, float(street.stations[-1]), STATION_STEP_M):
        point = street.points_at(station, 0.0)
        canvas.fill(_circle(point, 0.6), STATION_COLOUR)
        canvas.text(point, f"{station:g} m", STATION_COLOUR)


def _find_junctions(network: RoadNetwork) -> dict[str, NDArray[np.float64]]:
    """Find the middles of the places where three streets or more meet."""
    ends: dict[str, list[NDArray[np.float64]]] = {}
    for street in network.streets.values():
        ends.setdefault(street.begins, []).append(street.axis[0])
        ends.setdefault(street.ends, []).append(street.axis[-1])
    return {name: np.mean(found, axis=0) for name, found in ends.items() if len(found) > 2}


def _create_canvas(network: RoadNetwork, *, around_agents: bool) -> PlanCanvas:
    road = network.declaration
    agents = [_agent_position(place)[0] for place in road.agents.values()]
    agents += [it.destination_m for it in road.agents.values() if isinstance(it, Vehicle)]
    sides = [side[:, :2] for lane in network.lanes for side in (lane.left, lane.right)]
    points = np.concatenate([*sides, np.array(agents).reshape(-1, 2)])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    if not road.agents:
        scale_px_m = BARE_PX_PER_M
    elif road.imported is None:
        scale_px_m = 0.0
    else:
        # Streets lead far out of extracts of maps, where there is nothing else.
        middles = [] if around_agents else [it[:2] for it in _find_junctions(network).values()]
        shown = np.array([*agents, *middles])
        low = np.maximum(low, shown.min(axis=0) - MAP_MARGIN_M)
        high = np.minimum(high, shown.max(axis=0) + MAP_MARGIN_M)
        scale_px_m = MAP_PX_PER_M
    size_px = np.clip(scale_px_m * float(max(high - low)), SIZE_PX, MAX_SIZE_PX)
    return PlanCanvas(low, high, float(size_px))


def _draw_view(
    canvas: PlanCanvas,
    place: Vehicle | RoadsideUnit,
    mount: Mount,
    side_angles_rad: tuple[float, float],
) -> None:
    at, heading_deg = _agent_position(place)
    middle = math.radians(heading_deg + mount.yaw_deg)
    left, right = side_angles_rad
    turn = middle + np.linspace(-right, left, 24)
    outline = np.add(at, VIEW_DISTANCE_M * np.column_stack([np.cos(turn), np.sin(turn)]))
    canvas.fill(np.vstack([at, outline]), _agent_colour(place), opacity=0.06)


def _route_lanes(vehicle: Vehicle, found: tuple[LaneSegment, ...]) -> Iterator[LaneSegment]:
    """Yield the connecting paths along a route and the lanes to them."""
    by_id = {lane.id: lane for lane in found}
    for street, following in pairwise(vehicle.route):
        turns = (lane for lane in found if _is_movement_between(lane.id, street, following))
        path = next(turns, None)
        if path is not None:
            yield path
            number = path.id.rpartition(" > ")[0].rpartition(".")[2]
            ends = [by_id.get(f"{street}{sign}.{number}") for sign in "+-"]
            yield from (
                lane for lane in ends if lane and np.allclose(lane.left[-1], path.left[0], atol=1)
            )


def _is_movement_between(lane_id: str, street: str, following: str) -> bool:
    origin, _, target = lane_id.partition(": ")[2].partition(" > ")
    return origin.rpartition(".")[0] == street and target.rpartition(".")[0] == following


def _draw_agent(canvas: PlanCanvas, name: str, place: Vehicle | RoadsideUnit) -> None:
    colour = _agent_colour(place)
    at, heading_deg = _agent_position(place)
    if isinstance(place, Vehicle):
        canvas.fill(_circle(place.destination_m, 1.2), colour, opacity=0.5)
        canvas.text(place.destination_m, f"{name} ends", colour, needed=True)
    ahead = math.radians(heading_deg)
    turn = ahead + np.radians([0, 140, 220])
    radius_m = np.array([4.0, 2.5, 2.5])[:, None]
    canvas.fill(np.add(at, radius_m * np.column_stack([np.cos(turn), np.sin(turn)])), colour)
    canvas.text(at, name, colour, needed=True)


def _draw_scale_bar(canvas: PlanCanvas) -> None:
    height = canvas.image.shape[0]
    right = 20 + round(50 * canvas.px_per_m)
    cv2.line(canvas.image, (20, height - 20), (right, height - 20), INK_COLOUR, 3)
    label = (20, height - 28)
    cv2.putText(canvas.image, "50 m", label, FONT, FONT_SCALE, INK_COLOUR, 1, cv2.LINE_AA)


def _agent_position(place: Vehicle | RoadsideUnit) -> tuple[tuple[float, float], float]:
    if isinstance(place, RoadsideUnit):
        return place.position_m[:2], place.yaw_deg
    return place.spawn_m, place.heading_deg


def _agent_colour(place: Vehicle | RoadsideUnit) -> tuple[int, int, int]:
    return AGENT_COLOURS["unit" if isinstance(place, RoadsideUnit) else place.role]


def _circle(at: ArrayLike, radius_m: float) -> NDArray[np.float64]:
    turn = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    return np.asarray(at)[:2] + radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
