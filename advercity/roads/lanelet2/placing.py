"""Places of nodes in metres: local coordinates of the map, else UTM around the road's origin."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import Road
from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import get_line
from advercity.geometry.polyline import Points
from advercity.roads.georeference import (
    NOWHERE_DEG,
    choose_origin,
    find_utm_zone,
    locate_origin,
    project,
)
from advercity.roads.map_plan import check_distance
from advercity.roads.osm_map import read_tags

LOCAL_KEYS = ("local_x", "local_y")
MAX_SHIFT_M = 1.0
"""Difference between local coordinates and UTM up to which their axes are the same."""


@dataclass(frozen=True, eq=False)
class PlacedNodes:
    """Nodes around a local origin, east, north and up.

    Attributes:
        points: Place (3,) of every node by id.
        origin_m: The map's own coordinates of the world's origin.
        place: Place of the world's origin on the globe, if the map has it.
    """

    points: Mapping[str, Points]
    origin_m: Point2
    place: MapPlace | None


def place_nodes(nodes: Mapping[str, Element], road: Road, ledger: Ledger) -> PlacedNodes:
    """Place nodes by `local_x` and `local_y` where all have both, else by latitude and longitude.

    Latitudes and longitudes are projected as Lanelet2's UtmProjector does, relative to the origin
    of the road.

    Raises:
        InputError: A node has no place, or the map is far from the origin of the road.
    """
    if not nodes:
        raise InputError("has no nodes")
    tags = {name: read_tags(node) for name, node in nodes.items()}
    heights = {name: _read(nodes[name], tags[name], "ele", 0.0) for name in nodes}
    if all(key in item for item in tags.values() for key in LOCAL_KEYS):
        plan = {name: _read_point(nodes[name], tags[name], LOCAL_KEYS) for name in nodes}
        origin_m = _choose_origin(plan.values())
        place = _locate_local(nodes, plan, origin_m, ledger)
    else:
        degrees = {name: _read_point(it, it.attrib, ("lat", "lon")) for name, it in nodes.items()}
        check_distance(degrees.values(), road)
        zone = find_utm_zone(road.origin_lat_deg, road.origin_lon_deg)
        east_m, north_m = project(zone, road.origin_lat_deg, road.origin_lon_deg)
        plan = {
            name: (east - east_m, north - north_m)
            for name, (east, north) in ((n, project(zone, *at)) for n, at in degrees.items())
        }
        origin_m = _choose_origin(plan.values())
        place = locate_origin(zone, east_m + origin_m[0], north_m + origin_m[1])
    points = {
        name: np.array([x - origin_m[0], y - origin_m[1], heights[name]])
        for name, (x, y) in plan.items()
    }
    return PlacedNodes(points, origin_m, place)


def find_middle(nodes: Iterable[Element]) -> Point2 | None:
    """Find the mean latitude and longitude of nodes; None if they have local coordinates.

    Maps of recordings are often around latitude and longitude 0, where they have local ones, too.
    """
    found = list(nodes)
    if all(key in read_tags(node) for node in found for key in LOCAL_KEYS):
        return None
    degrees = [_read_point(node, node.attrib, ("lat", "lon")) for node in found]
    latitude, longitude = np.mean(degrees, axis=0).round(5).tolist()
    is_nowhere = max(abs(latitude), abs(longitude)) < NOWHERE_DEG
    return None if is_nowhere else (latitude, longitude)


def _choose_origin(places: Iterable[Point2]) -> Point2:
    found = np.array(list(places))
    (west, south), (east, north) = found.min(axis=0), found.max(axis=0)
    return choose_origin(float(west), float(south), float(east), float(north))


def _locate_local(
    nodes: Mapping[str, Element], plan: Mapping[str, Point2], origin_m: Point2, ledger: Ledger
) -> MapPlace | None:
    """Locate the origin of local coordinates by the nodes' latitudes, if their axes are UTM's."""
    try:
        degrees = {name: _read_point(it, it.attrib, ("lat", "lon")) for name, it in nodes.items()}
    except InputError:
        return None
    zone = find_utm_zone(*next(iter(degrees.values())))
    shifts = np.array([np.subtract(project(zone, *degrees[name]), plan[name]) for name in plan])
    shift = np.median(shifts, axis=0)
    if np.abs(shifts - shift).max() > MAX_SHIFT_M:
        name = "place on the globe (latitudes contradict local coordinates)"
        ledger.leave_out(name, at=next(iter(nodes.values())))
        return None
    return locate_origin(zone, *(shift + origin_m).tolist())


def _read_point(node: Element, values: Mapping[str, str], keys: tuple[str, str]) -> Point2:
    first, second = (_read(node, values, key) for key in keys)
    return first, second


def _read(
    node: Element, values: Mapping[str, str], key: str, default: float | None = None
) -> float:
    text = values.get(key)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    limit = {"lat": 84.0, "lon": 180.0}.get(key, 1e7)
    if not abs(value) <= limit:
        shown = f"{key} '{(text or '')[:20]}'"
        raise InputError(
            f"line {get_line(node)}: node {node.get('id', '')[:40]}: {shown} is no number between"
            f" -{limit:g} and {limit:g}"
        )
    return value
