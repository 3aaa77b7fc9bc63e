"""The road of a world, authored as streets and junctions or imported from a map."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Protocol

import numpy as np
import shapely
from advercity_dsl import MapFile, Road
from advercity_dsl.road import StripKind
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.mesh import GRID_M, Mesh
from advercity.geometry.polyline import Points
from advercity.roads import lane_segments
from advercity.roads.imported_road import ImportedRoadNetwork
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.layout import RoadLayout, lay_out_road
from advercity.roads.mirrored_network import MirroredRoadNetwork
from advercity.roads.pedestrian_lights import place_pedestrian_lights
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.road_meshes import KERB_HEIGHT_M, build_road_meshes, is_asphalt
from advercity.roads.signals import TrafficLight, TrafficSign
from advercity.roads.streets import StreetLayout, StripLayout, name_crossing_signal


class RoadNetwork(Protocol):
    """Facts about a road for lanes, terrain, surroundings and traffic.

    It is built once per world and passed on: laying out a road takes 40 ms, its areas longer.
    """

    @property
    def declaration(self) -> Road:
        """The declared road."""
        ...

    @property
    def streets(self) -> Mapping[str, StreetLayout]:
        """Declared streets by id, sampled; an imported road has none."""
        ...

    @cached_property
    def lanes(self) -> tuple[LaneSegment, ...]:
        """Every lane, connecting path and crossing."""
        ...

    @property
    def meshes(self) -> list[Mesh]:
        """Roadways, kerbs, sidewalks and paint, without the ground around them."""
        ...

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Edges (n, 3) of all paving, which is on their left, at the height of the ground."""
        ...

    @cached_property
    def paved_area(self) -> BaseGeometry:
        """Area of all paving, sidewalks included."""
        ...

    @property
    def street_axes(self) -> BaseGeometry:
        """Axes of the streets."""
        ...

    @property
    def roadway_level_area(self) -> BaseGeometry:
        """Area in which pedestrians walk at the height of the roadway."""
        ...

    @cached_property
    def traffic_lights(self) -> tuple[TrafficLight, ...]:
        """Signal heads of all approaches and crossings."""
        ...

    @property
    def traffic_signs(self) -> tuple[TrafficSign, ...]:
        """Stop and give-way signs."""
        ...


class AuthoredRoadNetwork:
    """A `RoadNetwork` from a layout."""

    def __init__(self, layout: RoadLayout) -> None:
        self._layout = layout

    @property
    def declaration(self) -> Road:
        """The road of this layout."""
        return self._layout.road

    @property
    def streets(self) -> Mapping[str, StreetLayout]:
        """Streets of the layout."""
        return self._layout.streets

    @cached_property
    def lanes(self) -> tuple[LaneSegment, ...]:
        """Lanes by street and number."""
        return lane_segments.build_lane_segments(self._layout)

    @property
    def meshes(self) -> list[Mesh]:
        """Roadways, kerbs, sidewalks, medians and paint."""
        return build_road_meshes(self._layout)

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Edges of streets and junctions."""
        return list(_paved_edges(self._layout))

    @cached_property
    def paved_area(self) -> BaseGeometry:
        """Area of streets and junctions."""
        return _build_paved_area(self._layout)

    @property
    def street_axes(self) -> BaseGeometry:
        """Axes of the streets."""
        streets = self._layout.streets.values()
        return shapely.MultiLineString([shapely.LineString(item.axis[:, :2]) for item in streets])

    @property
    def roadway_level_area(self) -> BaseGeometry:
        """Roadways of junctions, onto which SUMO's walking areas extend, and of streets."""
        outlines = [junction.roadway_outline[:, :2] for junction in self._layout.junctions.values()]
        for street in self._layout.streets.values():
            for strip in filter(is_asphalt, (*street.left_strips, *street.right_strips)):
                edges = [street.offset_line(t)[:, :2] for t in (strip.inner_t, strip.outer_t)]
                outlines.append(np.concatenate([edges[0], edges[1][::-1]]))
        polygons = shapely.make_valid([shapely.Polygon(outline) for outline in outlines])
        return shapely.union_all(polygons, grid_size=GRID_M)

    @cached_property
    def traffic_lights(self) -> tuple[TrafficLight, ...]:
        """Signal heads, as declared, and the heads of the crossings."""
        found: list[TrafficLight] = []
        for junction in self._layout.junctions.values():
            signals = junction.declared.signals
            for head in signals.heads if signals else ():
                x, y = junction.find_arm(head.street).outward_direction
                name = f"{junction.id}/{head.street}"
                found.append(TrafficLight(name, head.at_m, head.pole_m, (float(x), float(y))))
            if signals:
                middle = junction.roadway_outline[:, :2].mean(axis=0)
                for crossing in junction.crossings:
                    name = name_crossing_signal(junction.id, crossing.street)
                    found += place_pedestrian_lights(
                        name, crossing.centre, crossing.width_m, middle
                    )
        return tuple(found)

    @property
    def traffic_signs(self) -> tuple[TrafficSign, ...]:
        """Signs, as declared."""
        found: list[TrafficSign] = []
        for junction in self._layout.junctions.values():
            for sign in junction.declared.signs:
                x, y = junction.find_arm(sign.street).outward_direction
                found.append(TrafficSign(sign.kind, sign.at_m, (float(x), float(y))))
        return tuple(found)


def _paved_edges(layout: RoadLayout) -> Iterator[Points]:
    def lift(line: Points, raised: bool) -> Points:
        return line + np.array([0.0, 0.0, KERB_HEIGHT_M * raised])

    for street in layout.streets.values():
        left, right = (street.offset_line(t) for t in _outer_offsets(street))
        yield lift(left[::-1], _is_raised(street.left_strips))
        yield lift(right, _is_raised(street.right_strips))
        if street.begins not in layout.junctions:
            yield np.stack([left[0], right[0]])
        if street.ends not in layout.junctions:
            yield np.stack([right[-1], left[-1]])
    for junction in layout.junctions.values():
        following = (*junction.arms[1:], junction.arms[0])
        for corner, arm, other in zip(junction.corners, junction.arms, following, strict=True):
            rim = lift(corner.outer_edge, corner.sidewalk_outer_edge is not None)
            if corner.sidewalk_outer_edge is None:
                rim[0, 2] += KERB_HEIGHT_M * _is_raised(arm.strips_on_side(leftwards=True))
                rim[-1, 2] += KERB_HEIGHT_M * _is_raised(other.strips_on_side(leftwards=False))
            yield rim


def _is_raised(strips: tuple[StripLayout, ...]) -> bool:
    return bool(strips) and strips[-1].kind is StripKind.SIDEWALK


def _outer_offsets(street: StreetLayout) -> tuple[float, float]:
    """Compute the offsets of a street's outer edges, left and right."""
    return (
        street.left_strips[-1].outer_t if street.left_strips else 0.0,
        street.right_strips[-1].outer_t if street.right_strips else 0.0,
    )


def _build_paved_area(layout: RoadLayout) -> BaseGeometry:
    shapes: list[shapely.Geometry] = []
    for street in layout.streets.values():
        left, right = (street.offset_line(t)[:, :2] for t in _outer_offsets(street))
        shapes.append(shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]]))))
    for junction in layout.junctions.values():
        rim = np.concatenate([corner.outer_edge[:, :2] for corner in junction.corners])
        shapes.append(shapely.make_valid(shapely.Polygon(rim)))
    return shapely.union_all(shapes, grid_size=GRID_M)


def build_road(road: Road) -> RoadNetwork:
    """Build a declared road in its world; InputError where its parts do not fit together."""
    if road.is_left_hand:
        return MirroredRoadNetwork(road, build_road(to_plan_frame(road)))
    match road.imported:
        case None:
            return AuthoredRoadNetwork(lay_out_road(road))
        case MapFile() as file:
            raise InputError(f"road '{road.id}': the map '{file.file}' has not been compiled")
        case network:
            return ImportedRoadNetwork(road, network)
