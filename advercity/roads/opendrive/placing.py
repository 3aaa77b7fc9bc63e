"""Maps moved to a local origin, and left-hand maps mirrored into right-hand ones."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.roads.georeference import choose_origin, locate_origin
from advercity.roads.opendrive.document import (
    Connection,
    Header,
    Junction,
    Lane,
    LaneSection,
    OpenDriveMap,
    PlanGeometry,
    Road,
)
from advercity.roads.opendrive.profiles import Profile

MIRRORED_VALUES = {"arc": 1, "spiral": 2, "poly3": 4, "paramPoly3": 4}
"""Number of the last values of a geometry whose sign changes in a mirror."""


@dataclass(frozen=True)
class PlacedMap:
    """A map with traffic on the right, around a local origin.

    Attributes:
        document: The map, mirrored at the x axis if its traffic is on the left.
        origin_m: Its own coordinates of the world's origin.
        place: Place of the world's origin on the globe, if the map has it.
        driving_side: Side on which traffic drives in the world.
    """

    document: OpenDriveMap
    origin_m: Point2
    place: MapPlace | None
    driving_side: Literal["left", "right"]


def place_map(document: OpenDriveMap) -> PlacedMap:
    """Move a map to a local origin, and mirror it if its traffic is on the left.

    Raises:
        InputError: Traffic drives on the left on some roads only.
    """
    origin_m = _choose_origin(document)
    is_left = _is_left_handed(document)
    moved = _move_map(document, origin_m)
    return PlacedMap(
        document=_mirror_map(moved) if is_left else moved,
        origin_m=origin_m,
        place=_locate_origin(document.header, origin_m),
        driving_side="left" if is_left else "right",
    )


def _locate_origin(header: Header, origin_m: Point2) -> MapPlace | None:
    cosine, sine = math.cos(header.heading), math.sin(header.heading)
    x, y = origin_m
    return locate_origin(
        header.projection,
        header.offset_m[0] + cosine * x - sine * y,
        header.offset_m[1] + sine * x + cosine * y,
        altitude_m=header.offset_m[2],
        turn_deg=math.degrees(header.heading),
    )


def _choose_origin(document: OpenDriveMap) -> Point2:
    """Choose the map coordinates of the world's origin."""
    starts = [piece.start for road in document.roads.values() for piece in road.geometries]
    if not starts:
        return 0.0, 0.0
    (west, south), (east, north) = np.min(starts, axis=0), np.max(starts, axis=0)
    return choose_origin(float(west), float(south), float(east), float(north))


def _is_left_handed(document: OpenDriveMap) -> bool:
    """Whether traffic drives on the left.

    Raises:
        InputError: It does so on some roads only.
    """
    first = next(iter(document.roads.values()), None)
    for road in document.roads.values():
        if first is not None and road.is_left_handed != first.is_left_handed:
            raise InputError(
                f"line {road.line}: <road>: rule differs from that of road '{first.id[:40]}';"
                " traffic of a map drives on one side"
            )
    return first is not None and first.is_left_handed


def _move_map(document: OpenDriveMap, origin_m: Point2) -> OpenDriveMap:

    def move(piece: PlanGeometry) -> PlanGeometry:
        x, y = piece.start
        return replace(piece, start=(x - origin_m[0], y - origin_m[1]))

    roads = {
        name: replace(road, geometries=tuple(map(move, road.geometries)))
        for name, road in document.roads.items()
    }
    return replace(document, roads=roads)


def _mirror_map(document: OpenDriveMap) -> OpenDriveMap:
    """Mirror a map at the x axis, which makes a left-hand map a right-hand one."""
    roads = {name: _mirror_road(road) for name, road in document.roads.items()}
    junctions = {
        name: Junction(name, tuple(_mirror_connection(item) for item in junction.connections))
        for name, junction in document.junctions.items()
    }
    return replace(document, roads=roads, junctions=junctions)


def _mirror_road(road: Road) -> Road:
    return replace(
        road,
        is_left_handed=not road.is_left_handed,
        geometries=tuple(_mirror_geometry(piece) for piece in road.geometries),
        superelevation=_negate(road.superelevation),
        lane_offset=_negate(road.lane_offset),
        shape_sign=-road.shape_sign,
        sections=tuple(
            LaneSection(
                section.begins_m,
                {-name: _mirror_lane(lane) for name, lane in section.lanes.items()},
            )
            for section in road.sections
        ),
        crosswalks=tuple(replace(item, left_m=-item.left_m) for item in road.crosswalks),
    )


def _mirror_geometry(piece: PlanGeometry) -> PlanGeometry:
    kept = len(piece.values) - MIRRORED_VALUES.get(piece.shape, 0)
    values = (*piece.values[:kept], *(-value for value in piece.values[kept:]))
    x, y = piece.start
    return replace(piece, start=(x, -y), heading=-piece.heading, values=values)


def _mirror_lane(lane: Lane) -> Lane:
    return replace(
        lane,
        id=-lane.id,
        predecessors=tuple(-name for name in lane.predecessors),
        successors=tuple(-name for name in lane.successors),
    )


def _mirror_connection(item: Connection) -> Connection:
    return replace(item, lane_links=tuple((-one, -other) for one, other in item.lane_links))


def _negate(profile: Profile) -> Profile:
    return tuple(cubic.negated for cubic in profile)
