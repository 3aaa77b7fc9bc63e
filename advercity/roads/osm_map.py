"""OpenStreetMap extracts: tagged points, lines and areas in the world frame."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from advercity_dsl import Road
from shapely.geometry.base import BaseGeometry

from advercity.geometry.geodesy import Geodetic, enu_from_geodetic
from advercity.geometry.mesh import extract_polygons
from advercity.geometry.polyline import Points

Tags = Mapping[str, str]
STREETS_WITH_SIDEWALKS = frozenset(
    ("primary", "secondary", "tertiary", "unclassified", "residential")
)
"""Values of `highway` of streets that have sidewalks in towns, if extracts do not say."""


@dataclass(frozen=True, eq=False)
class OsmMap:
    """An extract around an origin.

    netconvert's transverse Mercator projection differs from the tangent plane used here by
    millimetres at 5 km, and by 0.2 m at 20 km.

    Attributes:
        root: The document.
        origin: Where the world frame has its origin.
    """

    root: Element
    origin: Geodetic

    @classmethod
    def around(cls, road: Road, root: Element) -> "OsmMap":
        """Make the map around the origin of a road."""
        return cls(root, Geodetic(road.origin_lat_deg, road.origin_lon_deg))

    @cached_property
    def places(self) -> dict[str, tuple[float, float]]:
        """East and north of every node, by its id."""
        return {item.attrib["id"]: self._locate(item) for item in self.root.iter("node")}

    def _locate(self, node: Element) -> tuple[float, float]:
        latitude, longitude = (float(node.attrib[name]) for name in ("lat", "lon"))
        east, north, _ = enu_from_geodetic(Geodetic(latitude, longitude), self.origin)
        return float(east), float(north)

    def list_points(self, key: str, value: str) -> list[tuple[float, float]]:
        """List the places of nodes with a tag."""
        return [
            self.places[item.attrib["id"]]
            for item in self.root.iter("node")
            if read_tags(item).get(key) == value
        ]

    @cached_property
    def lines(self) -> list[tuple[Tags, Points]]:
        """Tagged ways (n, 2), without those that name missing nodes only."""
        found = ((read_tags(item), self._points(item)) for item in self.root.iter("way"))
        return [(tags, points) for tags, points in found if tags and len(points) > 1]

    def _points(self, way: Element) -> Points:
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
        found = {item.attrib["id"]: self._points(item) for item in self.root.iter("way")}
        return {name: points for name, points in found.items() if len(points) > 1}


def read_tags(item: Element) -> dict[str, str]:
    """Read the tags of a node, way or relation."""
    return {tag.get("k", ""): tag.get("v", "") for tag in item.iter("tag")}


def list_nodes(way: Element) -> list[str]:
    """List the ids of a way's nodes."""
    return [item.get("ref", "") for item in way.iter("nd")]


def add_sidewalks(root: Element) -> None:
    """Tag the streets of a town with sidewalks if none of its ways says whether it has any.

    Most extracts leave them out, or draw them as footways of their own.
    """
    streets = [
        (way, tags)
        for way in root.iter("way")
        if (tags := read_tags(way)).get("highway") in STREETS_WITH_SIDEWALKS
    ]
    if any(key.startswith("sidewalk") for _, tags in streets for key in tags):
        return
    for way, tags in streets:
        # The ring of a roundabout has its island at the left.
        side = "right" if "junction" in tags else "both"
        SubElement(way, "tag", k="sidewalk", v=side)
