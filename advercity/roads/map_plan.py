"""Plans of maps: all facts of a format for an import, in metres, with traffic on the right."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from advercity_dsl import MapFile, Road
from advercity_dsl.road import MapPlace, RoadMark
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.geometry.polyline import Points, polyline_stations
from advercity.roads.imported_crossings import Marks
from advercity.roads.map_conversion import Conversion
from advercity.roads.sumo_xml import BORDER_ATTRIBUTES, format_metres, format_shape

Side = Literal["left", "right"]
EARTH_RADIUS_M = 6_371_000.0
MAX_MAP_DISTANCE_M = 20_000.0
"""Longest distance from the road's origin to its map; a plane fits the globe to centimetres."""


LaneLink = tuple[str, int, str, int]
"""Edge and index of the lane a path leaves, then of the lane it enters."""


@dataclass(frozen=True, eq=False)
class LaneLines:
    """The lines of a lane.

    Attributes:
        centre: Its middle (n, 3).
        width_m: Its usual width.
        borders: Left and right border, a point for each of the middle, where middle and width do
            not give them; else none.
    """

    centre: Points
    width_m: float
    borders: tuple[Points, ...]

    def cut(self, first: float, last: float) -> "LaneLines":
        """Cut out the part between two fractions of the length."""
        stations = polyline_stations(self.centre)
        ends = np.array([first, last]) * stations[-1]
        inner = stations[(stations > ends[0]) & (stations < ends[1])]
        at = np.concatenate([ends[:1], inner, ends[1:]])

        def pick(line: Points) -> Points:
            return np.stack([np.interp(at, stations, column) for column in line.T], axis=1)

        return LaneLines(pick(self.centre), self.width_m, tuple(map(pick, self.borders)))

    def write(self, lane: Element) -> None:
        """Set them at a lane of a network."""
        lane.set("shape", format_shape(self.centre))
        lane.set("width", format_metres(self.width_m))
        for name, border in zip(BORDER_ATTRIBUTES, self.borders, strict=False):
            lane.set(name, format_shape(border))


@dataclass(frozen=True, eq=False)
class MapPlan:
    """A map in the plan frame: east and north, or east and south if traffic is on the left.

    Attributes:
        conversion: Documents and options for netconvert.
        driving_side: Side on which traffic drives in the world.
        origin_m: The map's own coordinates, east and north, of the plan's origin.
        place: Place of the plan's origin on the globe, if the map has it.
        crossings: Middles of the map's pedestrian crossings.
        confirm: Builds the second conversion, which leaves only these in the network of the first.
        names: Names of streets by edge; None if netconvert copies them.
        lanes: Lines of lanes by SUMO's id, where netconvert would simplify them.
        paths: Lines of ways through junctions.
        outlines: Kind and ring (n, 3) of paving inside junctions.
        stripes: Mark and line (n, 3) of all painted lines; none if the map has none.
    """

    conversion: Conversion
    driving_side: Side = "right"
    origin_m: Point2 = (0.0, 0.0)
    place: MapPlace | None = None
    crossings: Marks = ()
    confirm: Callable[[Marks, Element], Conversion | None] | None = None
    names: Mapping[str, str] | None = None
    lanes: Mapping[str, LaneLines] = field(default_factory=dict[str, LaneLines])
    paths: Mapping[LaneLink, LaneLines] = field(default_factory=dict[LaneLink, LaneLines])
    outlines: Sequence[tuple[str, Points]] = ()
    stripes: Sequence[tuple[RoadMark, Points]] = ()

    def complete(self, net: Element) -> None:
        """Add the lines and outlines that netconvert lacks to a converted network, in place."""
        elements = {item.attrib["id"]: item for item in net.iter("lane")}
        # netconvert drops points close to each other, and has one width for a lane.
        for name, lines in self.lanes.items():
            if name in elements:
                lines.write(elements[name])
        for link, chain in _list_internal_chains(net):
            if link in self.paths:
                lanes = [elements[name] for name in chain]
                ends = np.cumsum([0.0, *(float(lane.attrib["length"]) for lane in lanes)])
                for lane, part in zip(lanes, pairwise((ends / ends[-1]).tolist()), strict=True):
                    self.paths[link].cut(*part).write(lane)
        for number, (kind, line) in enumerate((*self.outlines, *self.stripes)):
            shape = format_shape(line)
            SubElement(net, "poly", {"id": f"{kind}_{number}", "type": kind, "shape": shape})


def _list_internal_chains(net: Element) -> Iterator[tuple[LaneLink, list[str]]]:
    """List the connections through junctions, each with the row of its lanes.

    netconvert cuts a lane where vehicles wait inside a junction.
    """
    following: dict[str, str] = {}
    begins: dict[LaneLink, str] = {}
    for item in net.iter("connection"):
        via = item.get("via")
        if via is not None:
            origin, lane = item.attrib["from"], item.attrib["fromLane"]
            if origin.startswith(":"):
                following[f"{origin}_{lane}"] = via
            else:
                link = (origin, int(lane), item.attrib["to"], int(item.attrib["toLane"]))
                begins[link] = via
    for link, via in begins.items():
        chain = [via]
        while chain[-1] in following:
            chain.append(following[chain[-1]])
        yield link, chain


def place_extent(
    declared: MapFile, origin_m: Point2, side: Side
) -> tuple[float, float, float, float] | None:
    """Place the declared part of a map in the plan frame: least x and y, largest x and y."""
    if declared.extent_m is None:
        return None
    corners = (np.array(declared.extent_m) - origin_m) * (1, -1 if side == "left" else 1)
    west, south, east, north = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    return west, south, east, north


def build_extent_options(
    declared: MapFile, origin_m: Point2 = (0.0, 0.0), side: Side = "right"
) -> dict[str, str]:
    """Build netconvert's option for the declared part of a map; none for a whole map."""
    box = place_extent(declared, origin_m, side)
    if box is None:
        return {}
    return {"keep-edges.in-boundary": ",".join(f"{value:.3f}" for value in box)}


def check_distance(degrees: Iterable[Point2], road: Road) -> None:
    """Check that the middle of a map, by latitudes and longitudes, is near the road's origin.

    Raises:
        InputError: It is too far away.
    """
    latitude, longitude = np.mean(list(degrees), axis=0)
    north, east = np.radians([latitude - road.origin_lat_deg, longitude - road.origin_lon_deg])
    away = EARTH_RADIUS_M * float(np.hypot(north, east * np.cos(np.radians(latitude))))
    if not away < MAX_MAP_DISTANCE_M:
        raise InputError(
            f"is {away / 1000:.0f} km from the road's origin; declare"
            f" `origin_lat_deg: {latitude:.5f}` and `origin_lon_deg: {longitude:.5f}`, its middle"
        )
