"""OpenStreetMap extracts: tagged points, lines and areas in the world frame."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from advercity_dsl import Road
from shapely.geometry.base import BaseGeometry

from advercity.geometry.geodesy import Geodetic, enu_from_geodetic
from advercity.geometry.mesh import extract_polygons
from advercity.geometry.polyline import Points, StationedPolyline

Tags = Mapping[str, str]
STREETS_WITH_SIDEWALKS = frozenset(
    ("primary", "secondary", "tertiary", "unclassified", "residential")
)
"""Values of `highway` of streets with sidewalks in towns, if extracts do not say."""
REMOVED_TYPE = "highway.steps"
"""Type of netconvert's edges of `mark_paths`."""
ONE_WAY = frozenset(("yes", "true", "1"))
CARRIAGEWAY_PROBES = (0.25, 0.5, 0.75)
"""Fractions of a one-way street's length at which the other half of a road is looked for."""
MIN_CARRIAGEWAY_GAP_M, MAX_CARRIAGEWAY_GAP_M = 2.0, 20.0
"""Between the centre lines of the halves; streets with houses between them are farther apart."""
MAX_CARRIAGEWAY_COSINE = -0.9
"""Largest cosine between the directions of the halves, which are nearly opposite."""
ELEMENT_ORDER = {"node": 1, "way": 2, "relation": 3}
"""Order of elements in an extract, as required by netconvert."""


@dataclass(frozen=True, eq=False)
class OsmMap:
    """An extract around an origin.

    Attributes:
        root: The document.
        origin: Origin of the world frame.
        is_mirrored: Whether places are east and south of it instead of east and north.
    """

    root: Element
    origin: Geodetic
    is_mirrored: bool = False

    @classmethod
    def around(cls, road: Road, root: Element, *, is_mirrored: bool = False) -> "OsmMap":
        """Make the map around the origin of a road."""
        return cls(root, Geodetic(road.origin_lat_deg, road.origin_lon_deg), is_mirrored)

    def build_plan(self) -> Element:
        """Build a document with metres for `lon` and `lat`, which shares all but its nodes.

        Nodes precede ways, and ways relations: netconvert ignores references to later elements.
        """
        plan = Element(self.root.tag, self.root.attrib)
        for item in sorted(self.root, key=lambda item: ELEMENT_ORDER.get(item.tag, 0)):
            if item.tag != "node":
                plan.append(item)
                continue
            east, north = self.places[item.attrib["id"]]
            place = {"lon": f"{east:.4f}", "lat": f"{north:.4f}"}
            node = SubElement(plan, "node", item.attrib | place)
            node.extend(tag for tag in item if tag.get("k") != "ele")
        return plan

    @cached_property
    def places(self) -> dict[str, tuple[float, float]]:
        """East and north of every node, by its id."""
        return {item.attrib["id"]: self._locate(item) for item in self.root.iter("node")}

    def _locate(self, node: Element) -> tuple[float, float]:
        latitude, longitude = (float(node.attrib[name]) for name in ("lat", "lon"))
        east, north, _ = enu_from_geodetic(Geodetic(latitude, longitude), self.origin)
        return float(east), float(-north if self.is_mirrored else north)

    def list_points(self, key: str, value: str) -> list[tuple[float, float]]:
        """List the places of nodes with a tag."""
        return [
            self.places[item.attrib["id"]]
            for item in self.root.iter("node")
            if read_tags(item).get(key) == value
        ]

    @cached_property
    def lines(self) -> list[tuple[Tags, Points]]:
        """Tagged ways (n, 2), without ways of missing nodes only."""
        found = ((read_tags(item), self.locate_way(item)) for item in self.root.iter("way"))
        return [(tags, points) for tags, points in found if tags and len(points) > 1]

    def locate_way(self, way: Element) -> Points:
        """Compute the points (n, 2) of a way, without missing nodes."""
        places = (self.places.get(name) for name in list_nodes(way))
        return np.array([place for place in places if place is not None]).reshape(-1, 2)

    @cached_property
    def areas(self) -> list[tuple[Tags, shapely.Polygon]]:
        """Tagged closed ways and multipolygons."""
        found = [
            (tags, shapely.Polygon(points))
            for tags, points in self.lines
            if len(points) > 3 and (points[0] == points[-1]).all()
        ]
        found += [pair for item in self.root.iter("relation") for pair in self._polygons(item)]
        return [
            (tags, polygon)
            for tags, shape in found
            for polygon in extract_polygons(shapely.make_valid(shape))
        ]

    def _polygons(self, relation: Element) -> Iterator[tuple[Tags, BaseGeometry]]:
        tags = read_tags(relation)
        if tags.get("type") != "multipolygon":
            return
        outer, inner = (
            shapely.union_all(self._rings(relation, role)) for role in ("outer", "inner")
        )
        yield tags, shapely.difference(outer, inner)

    def _rings(self, relation: Element, role: str) -> Sequence[BaseGeometry]:
        ways = (
            self._ways.get(item.get("ref", ""))
            for item in relation.iter("member")
            if item.get("type") == "way" and item.get("role") == role
        )
        lines = [shapely.LineString(points) for points in ways if points is not None]
        return list(shapely.get_parts(shapely.polygonize(lines)))

    @cached_property
    def _ways(self) -> dict[str, Points]:
        found = {item.attrib["id"]: self.locate_way(item) for item in self.root.iter("way")}
        return {name: points for name, points in found.items() if len(points) > 1}


def read_tags(item: Element) -> dict[str, str]:
    """Read the tags of a node, way or relation."""
    return {tag.get("k", ""): tag.get("v", "") for tag in item.iter("tag")}


def list_nodes(way: Element) -> list[str]:
    """List the ids of a way's nodes."""
    return [item.get("ref", "") for item in way.iter("nd")]


def mark_paths(root: Element, streets: Collection[str]) -> None:
    """Tag every `highway` but the ways with these ids as `steps`, which `REMOVED_TYPE` removes.

    To remove the ways would also change where netconvert splits streets and joins junctions.
    """
    for way in root.iter("way"):
        if way.get("id") not in streets and "highway" in read_tags(way):
            for tag in list(way.iter("tag")):
                way.remove(tag)
            SubElement(way, "tag", k="highway", v="steps")


def add_sidewalks(osm: OsmMap) -> None:
    """Tag the streets of a town with sidewalks where they do not say whether they have any.

    Most extracts leave them out, or draw them as footways of their own. Streets have them at both
    sides, but roundabouts and halves of dual carriageways at their right only.
    """
    streets = [
        (way, tags)
        for way in osm.root.iter("way")
        if (tags := read_tags(way)).get("highway") in STREETS_WITH_SIDEWALKS
    ]
    lines = [osm.locate_way(way) for way, tags in streets if tags.get("oneway") in ONE_WAY]
    one_way = shapely.STRtree([shapely.LineString(line) for line in lines if len(line) > 1])
    for way, tags in streets:
        said = {value for key, value in tags.items() if key in ("sidewalk", "sidewalk:both")}
        if said != {"separate"} and any(key.startswith("sidewalk") for key in tags):
            continue
        is_half = tags.get("oneway") in ONE_WAY and _is_carriageway(osm.locate_way(way), one_way)
        # The ring of a roundabout has its island at the left.
        side = "right" if is_half or "junction" in tags else "both"
        _set_tag(way, "sidewalk", side)


def _set_tag(way: Element, key: str, value: str) -> None:
    for tag in way.findall("tag"):
        if tag.get("k", "").startswith(key):
            way.remove(tag)
    SubElement(way, "tag", k=key, v=value)


def _is_carriageway(points: Points, one_way: shapely.STRtree) -> bool:
    """Return whether another one-way street leads back at the left of a one-way street."""
    if len(points) < 2:
        return False
    line = StationedPolyline.from_points(points)
    for station_m in np.array(CARRIAGEWAY_PROBES) * line.length_m:
        heading = line.headings_at(station_m)
        start = line.points_at(station_m)
        left = np.array([-np.sin(heading), np.cos(heading)])
        probe = shapely.LineString(
            [start + MIN_CARRIAGEWAY_GAP_M * left, start + MAX_CARRIAGEWAY_GAP_M * left]
        )
        for index in one_way.query(probe, predicate="intersects"):
            other = StationedPolyline.from_points(
                shapely.get_coordinates(one_way.geometries[index])
            )
            station, _ = other.project_point(start)
            if np.cos(other.headings_at(station) - heading) < MAX_CARRIAGEWAY_COSINE:
                return True
    return False
