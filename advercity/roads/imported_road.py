"""Roads imported from a map, built from its compiled SUMO network.

Maps seldom hold paint, signal heads or signs, so they are derived from lanes and right of way.
Heads hang over the far side of the junction, from a mast at the right of the road beyond it; signs
are at the right of the approach.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
import shapely
from advercity_dsl import MapNetwork, Road
from shapely.geometry.base import BaseGeometry

from advercity.geometry import polyline
from advercity.geometry.mesh import (
    Mesh,
    TriangleSurface,
    merge_surfaces,
    move_surface,
)
from advercity.geometry.polyline import Points, StationedPolyline, offset_polyline
from advercity.roads import markings
from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.imported_streets import read_imported_streets
from advercity.roads.imported_surface import ImportedSurface, build_surface_meshes
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.levels import split_levels
from advercity.roads.markings import PAINT_KINDS, WHITE, YELLOW
from advercity.roads.network_file import PaintedStripe, SumoEdge, SumoLane, parse_packed_network
from advercity.roads.pedestrian_lights import place_pedestrian_lights
from advercity.roads.signals import TrafficLight, TrafficSign
from advercity.roads.streets import StreetLayout, approach_name

EDGE_LINE_INSET_M = 0.1
MIN_EDGE_LENGTH_M = 1.0
"""Shorter edges, which joined junctions leave, get no lines."""
CUT_MARGIN_M = 0.1
"""Points of a line nearer than this to the end of a painted piece are left out of it."""


def build_imported_markings(net: ImportedNetwork, surface: ImportedSurface) -> list[Mesh]:
    """Build all paint, a mesh per colour."""
    pieces: dict[str, list[TriangleSurface]] = {WHITE: [], YELLOW: []}
    own = (_map_lines(item) for item in net.stripes)
    derived = (_edge_lines(edge, net) for edge in net.edges.values())
    for colour, piece in chain.from_iterable(own if net.stripes else derived):
        pieces[colour].append(piece)
    for edge in _edges_with_stop_line(net):
        pieces[WHITE] += _stop_line(edge)
    pieces[WHITE].append(_build_crossings(net, surface))
    return merge_surfaces(pieces, PAINT_KINDS)


def _build_crossings(net: ImportedNetwork, surface: ImportedSurface) -> TriangleSurface:
    """Build bars across the roadway, without the sidewalks at its sides."""
    bars: list[shapely.Polygon] = []
    heights: list[float] = []
    for lane in (lane for edge in net.crossings for lane in edge.lanes):
        line = shapely.LineString(lane.centre[:, :2])
        for part in shapely.get_parts(shapely.intersection(line, surface.roadway_area)):
            for start, end in pairwise(shapely.get_coordinates(part)):
                for left, right in markings.place_zebra_bars(start, end, width_m=lane.width_m):
                    bars.append(shapely.Polygon(np.vstack([left, right[::-1]])))
                    heights.append(float(lane.centre[:, 2].mean()))
    return move_surface(surface.drape(bars, heights), markings.MARKING_LIFT)


def _map_lines(stripe: PaintedStripe) -> Iterator[tuple[str, TriangleSurface]]:
    line = StationedPolyline.from_points(stripe.line)
    is_broken = stripe.mark in markings.BROKEN_PAINTS
    pieces = markings.dash_intervals(line.length_m) if is_broken else [(0.0, line.length_m)]
    for first, last in pieces:
        paint = _stripe(line.cut(first, last, margin_m=CUT_MARGIN_M).points)
        yield markings.MARKING_MATERIALS[stripe.mark], paint


def _edge_lines(edge: SumoEdge, net: ImportedNetwork) -> Iterator[tuple[str, TriangleSurface]]:
    lanes = edge.driving_lanes
    if not lanes or polyline.polyline_length(lanes[-1].centre) < MIN_EDGE_LENGTH_M:
        return
    for lane in lanes[:-1]:
        border = StationedPolyline.from_points(lane.left_border)
        for first, last in markings.dash_intervals(border.length_m):
            yield WHITE, _stripe(border.cut(first, last, margin_m=CUT_MARGIN_M).points)
    yield WHITE, _stripe(_border_inset(lanes[0], on_left=False))
    opposite = net.find_opposite_edge(edge)
    if opposite is None or not opposite.driving_lanes:
        yield YELLOW, _stripe(_border_inset(lanes[-1], on_left=True))
    # Both edges have the line between them as border; one of them paints it.
    elif edge.id < opposite.id or net.find_opposite_edge(opposite) is not edge:
        yield YELLOW, _stripe(lanes[-1].left_border)


def _border_inset(lane: SumoLane, *, on_left: bool) -> Points:
    return lane.compute_border(on_left=on_left, outward_m=-EDGE_LINE_INSET_M)


def _stripe(line: Points, width_m: float = markings.LINE_WIDTH_M) -> TriangleSurface:
    half = width_m / 2
    return markings.build_paint(offset_polyline(line, half), offset_polyline(line, -half))


def _edges_with_stop_line(net: ImportedNetwork) -> Iterator[SumoEdge]:
    """Yield streets with a signal or a stop sign at their end."""
    stopped = {
        link.from_edge for link in net.lane_links if link.traffic_light or link.state in ("s", "w")
    }
    yield from (edge for edge in net.edges.values() if edge.id in stopped and edge.driving_lanes)


def _stop_line(edge: SumoEdge) -> Iterator[TriangleSurface]:
    near, far = markings.STOP_LINE_SETBACK_M, markings.STOP_LINE_M + markings.STOP_LINE_SETBACK_M
    for lane in edge.driving_lanes:
        line = StationedPolyline.from_points(lane.centre)
        if line.length_m > 2 * far:
            end = line.cut(line.length_m - far, line.length_m - near, margin_m=CUT_MARGIN_M)
            yield _stripe(end.points, lane.width_m)


SIGNAL_HEIGHT_M = 5.8
MAST_CLEARANCE_M = 0.8
"""Distance from the edge of the roadway to a mast or sign."""
MAX_MAST_OFFSET_M = 24.0
MAX_FAR_SIDE_M = 60.0
"""Longest junction searched for its far side."""
MAST_SEARCH_STEP_M = 0.4
MAX_MAST_ARM_M = 7.0


def place_traffic_lights(net: ImportedNetwork, surface: ImportedSurface) -> Iterator[TrafficLight]:
    """Place a head for every approach with a light."""
    governed = {
        (link.traffic_light, link.from_edge) for link in net.lane_links if link.traffic_light
    }
    for light, name in sorted(governed):
        edge = net.edges[name]
        if edge.driving_lanes:
            yield _place_traffic_light(f"{light}/{approach_name(name)}", edge, surface)


def _place_crossing_lights(
    net: ImportedNetwork, surface: ImportedSurface
) -> Iterator[TrafficLight]:
    """Place heads for pedestrians, but none in the middle of a roadway."""
    for name, crossing in net.governed_crossings.items():
        middle = net.junctions[crossing.junction].outline[:, :2].mean(axis=0)
        for lane in crossing.lanes:
            for head in place_pedestrian_lights(name, lane.centre, lane.width_m, middle):
                if not surface.roadway_area.contains(shapely.Point(head.mast_foot_m)):
                    yield head


def _place_traffic_light(name: str, edge: SumoEdge, surface: ImportedSurface) -> TrafficLight:
    end, heading = _edge_end(edge)
    far = _find_far_side(end, heading, edge, surface)
    pole = _find_mast_position(far, heading, surface, ahead=True)
    arm = far - pole
    length_m = float(np.linalg.norm(arm))
    if length_m > MAX_MAST_ARM_M:
        far = pole + arm * MAX_MAST_ARM_M / length_m
    z = float(surface.height_at(far[None])[0]) + SIGNAL_HEIGHT_M
    return TrafficLight(
        id=name,
        position_m=(float(far[0]), float(far[1]), z),
        mast_foot_m=(float(pole[0]), float(pole[1])),
        facing=(-float(heading[0]), -float(heading[1])),
    )


def _edge_end(edge: SumoEdge) -> tuple[Points, Points]:
    """Compute the mean end (2,) of a street's driving lanes and their direction (2,) at it."""
    lines = [lane.centre[:, :2] for lane in edge.driving_lanes]
    end = np.mean([line[-1] for line in lines], axis=0)
    direction = np.mean([line[-1] - line[-2] for line in lines], axis=0)
    return end, direction / np.linalg.norm(direction)


def _find_far_side(
    end: Points, heading: Points, edge: SumoEdge, surface: ImportedSurface
) -> Points:
    """Find the point (2,) where a vehicle straight ahead leaves the junction."""
    area = surface.junction_areas.get(edge.to_junction)
    ahead = shapely.LineString([end, end + MAX_FAR_SIDE_M * heading])
    if area is None or not ahead.intersects(area):
        return end
    crossed = shapely.get_coordinates(ahead.intersection(area))
    return crossed[((crossed - end) @ heading).argmax()]


def _find_mast_position(
    point: Points, heading: Points, surface: ImportedSurface, *, ahead: bool
) -> Points:
    """Find the nearest point (2,) off all roadways: on the right, and ahead or behind.

    Where there is none, the other direction is searched, and then the left.
    """
    shapely.prepare(surface.roadway_area)
    along = heading if ahead else -heading
    right = -polyline.left_normals(heading)
    steps = np.arange(0.0, MAX_MAST_OFFSET_M, MAST_SEARCH_STEP_M)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[np.argsort(np.linalg.norm(offsets, axis=1), kind="stable")]
    for sides in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        candidates = point + offsets @ (np.array(sides)[:, None] * np.stack([along, right]))
        places = shapely.points(candidates)
        free = ~shapely.dwithin(surface.roadway_area, places, MAST_CLEARANCE_M)
        if free.any():
            return candidates[free.argmax()]
    return point


def place_traffic_signs(net: ImportedNetwork, surface: ImportedSurface) -> Iterator[TrafficSign]:
    """Place stop signs where every link must stop, and give-way signs where every link yields."""
    states: dict[str, set[str]] = {}
    for link in net.lane_links:
        states.setdefault(link.from_edge, set()).add(link.state)
    # SUMO's states: `s` and `w` are stop (all-way stop), `m` a minor link, which yields.
    for name, found in states.items():
        edge = net.edges[name]
        kind = "stop" if found <= {"s", "w"} else "yield" if found == {"m"} else None
        if kind is None or not edge.driving_lanes:
            continue
        end, heading = _edge_end(edge)
        at = _find_mast_position(end, heading, surface, ahead=False)
        yield TrafficSign(
            kind, (float(at[0]), float(at[1])), (-float(heading[0]), -float(heading[1]))
        )


class ImportedRoadNetwork:
    """A `RoadNetwork` from a map."""

    def __init__(self, road: Road, imported: MapNetwork) -> None:
        """Read the network; InputError if it is none."""
        self.declaration = road
        self.streets: Mapping[str, StreetLayout] = read_imported_streets(imported.network).streets
        self._net = ImportedNetwork.from_network(parse_packed_network(imported.network))
        self._surface = ImportedSurface(self._net)
        levels = split_levels(self._net)
        self._levels = (
            [ImportedSurface(level) for level in levels] if len(levels) > 1 else [self._surface]
        )

    @cached_property
    def lanes(self) -> tuple[LaneSegment, ...]:
        """Lanes under SUMO's ids."""
        inside = (*self._net.internal_edges, *self._net.crossings)
        found = [
            _lane_segment(lane, in_junction=False)
            for edge in self._net.edges.values()
            for lane in edge.lanes
        ]
        found += [
            _lane_segment(lane, in_junction=True)
            for edge in inside
            for lane in edge.lanes
            if lane.kind in ("driving", "crossing")
        ]
        return tuple(found)

    @property
    def meshes(self) -> list[Mesh]:
        """Roadway, sidewalks, kerbs and paint."""
        return [
            *build_surface_meshes(self._levels),
            *build_imported_markings(self._net, self._surface),
        ]

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Outlines of the paving of all levels."""
        return [edge for level in self._levels for edge in level.paved_edges]

    @cached_property
    def paved_area(self) -> BaseGeometry:
        """Area of roadways and sidewalks."""
        return self._surface.footprint

    @property
    def street_axes(self) -> BaseGeometry:
        """Left borders of the streets."""
        return shapely.MultiLineString(
            [
                shapely.LineString(edge.driving_lanes[-1].left_border[:, :2])
                for edge in self._net.edges.values()
                if edge.driving_lanes
            ]
        )

    @property
    def roadway_level_area(self) -> BaseGeometry:
        """The roadway without sidewalks and the corners between them."""
        surface = self._surface
        return shapely.difference(surface.roadway_area, shapely.buffer(surface.raised_area, 0.01))

    @cached_property
    def traffic_lights(self) -> tuple[TrafficLight, ...]:
        """Heads of all governed approaches and crossings."""
        return (
            *place_traffic_lights(self._net, self._surface),
            *_place_crossing_lights(self._net, self._surface),
        )

    @property
    def traffic_signs(self) -> tuple[TrafficSign, ...]:
        """Signs of all approaches with a duty to stop or yield."""
        return tuple(place_traffic_signs(self._net, self._surface))


def _lane_segment(lane: SumoLane, *, in_junction: bool) -> LaneSegment:
    return LaneSegment(
        lane.id, lane.kind, lane.left_border, lane.right_border, in_junction=in_junction
    )
