"""Roadways, sidewalks and kerbs of an imported network.

Lanes are ribbons at their own height; junctions and what is left between lanes are areas, whose
height is that of the lanes around. Sidewalks stand a kerb higher.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from advercity.curves import Points
from advercity.world.imported.net import Net, NetEdge, NetLane, enclosed
from advercity.world.meshing import Piece, cells, filled, mesh, polygons_of, ribbon
from advercity.world.scene import Mesh
from advercity.world.surface import KERB_HEIGHT_M, KERB_WIDTH_M, LEVEL_WITHIN_M, MATERIALS, UP

OVERLAP_M = 0.01
"""Neighbouring lanes reach into each other by this, so that no crack opens between them."""
GAP_M = 0.4
"""Twice as wide a gap between lanes is paved."""
SLIVER_M = 0.25
HOLE_M2 = 6.0
"""Smaller islands are paved over."""
CELL_M = 2.0
RIM_STEP_M = 4.0
TIDY_M = 0.02
SNAP_M = 0.001
APPROACH_M = 2.0
"""How much of a street counts for the height of the junction that it meets."""


@dataclass(frozen=True, eq=False)
class Heights:
    """Height from lines whose height is known: the mean of all, the near ones counting most."""

    lines: NDArray[np.object_]

    def at(self, points: Points) -> NDArray[np.float64]:
        """Height (n,) at points (n, 2)."""
        if not len(points) or not len(self.lines):
            return np.zeros(len(points))
        places = np.asarray(shapely.points(points))[:, None]
        weight = 1.0 / (shapely.distance(places, self.lines) ** 2 + SNAP_M**2) ** 2
        along = shapely.line_locate_point(self.lines, places)
        z = shapely.get_z(shapely.line_interpolate_point(self.lines, along))
        return (weight * z).sum(axis=1) / weight.sum(axis=1)


class Surface:
    """The paving of a network."""

    def __init__(self, net: Net) -> None:
        self._net = net

    @cached_property
    def _lanes(self) -> list[NetLane]:
        return [lane for edge in self._net.streets.values() for lane in edge.lanes]

    @cached_property
    def _carriageways(self) -> BaseGeometry:
        """What the lanes of streets cover, sidewalks left out."""
        lanes = [lane.area(OVERLAP_M) for lane in self._lanes if lane.kind != "sidewalk"]
        return shapely.union_all(lanes, grid_size=SNAP_M)

    @cached_property
    def _driven(self) -> dict[str, BaseGeometry]:
        """What the ways through each junction cover."""
        areas: dict[str, list[shapely.Geometry]] = {}
        for edge in (*self._net.ways, *self._net.crossings):
            for lane in edge.lanes:
                areas.setdefault(edge.junction, []).append(lane.area())
        return {name: shapely.union_all(found, grid_size=SNAP_M) for name, found in areas.items()}

    @cached_property
    def crossings_of_streets(self) -> dict[str, BaseGeometry]:
        """The area of each junction that no street covers."""
        areas: dict[str, BaseGeometry] = {}
        for junction in self._net.junctions.values():
            shapes = [self._driven[junction.id]] if junction.id in self._driven else []
            if len(junction.outline) > 2:
                shapes.append(enclosed(junction.outline))
            free = shapely.difference(
                shapely.union_all(shapes), self._carriageways, grid_size=SNAP_M
            )
            area = shapely.union_all(polygons_of(free))
            if not area.is_empty:
                areas[junction.id] = area
        return areas

    @cached_property
    def roadway(self) -> BaseGeometry:
        """All that is asphalt, gaps closed; where it lies below sidewalks too."""
        parts = [self._carriageways, *self.crossings_of_streets.values()]
        joined = shapely.union_all(parts, grid_size=SNAP_M)
        return _without_small_holes(_closed(joined, GAP_M))

    @cached_property
    def raised(self) -> BaseGeometry:
        """Sidewalks and the corners between them."""
        driven = shapely.union_all([self._carriageways, *self._driven.values()], grid_size=SNAP_M)
        walks = [lane.area() for lane in self._lanes if lane.kind == "sidewalk"]
        corners = [
            enclosed(lane.outline)
            for edge in self._net.corners
            for lane in edge.lanes
            if lane.outline is not None and len(lane.outline) > 2
        ]
        area = _closed(shapely.union_all([*walks, *corners], grid_size=SNAP_M), SLIVER_M)
        return _opened(shapely.difference(area, driven, grid_size=SNAP_M), SLIVER_M)

    @cached_property
    def footprint(self) -> BaseGeometry:
        """All that is paved."""
        area = shapely.union_all([self.roadway, self.raised], grid_size=SNAP_M)
        return _without_small_holes(shapely.simplify(area, TIDY_M))

    @cached_property
    def rims(self) -> list[Points]:
        """Edges (n, 3) of all paving, with it on their left, at the height the ground meets."""
        rings: list[Points] = []
        for polygon in polygons_of(self.footprint):
            upright = shapely.orient_polygons(polygon)
            for ring in (upright.exterior, *upright.interiors):
                plane = shapely.get_coordinates(shapely.segmentize(ring, RIM_STEP_M))
                on_kerb = shapely.dwithin(self.raised, shapely.points(plane), 2 * TIDY_M)
                rings.append(np.column_stack([plane, self.height(plane) + KERB_HEIGHT_M * on_kerb]))
        return rings

    def height(self, points: Points) -> NDArray[np.float64]:
        """Height (n,) of the roadway at points (n, 2), that of the nearest lane."""
        lines, tree = self._lines
        if not len(lines):
            return np.zeros(len(points))
        places = shapely.points(points)
        nearest = lines[tree.nearest(places)]
        along = shapely.line_locate_point(nearest, places)
        return shapely.get_z(shapely.line_interpolate_point(nearest, along))

    def height_in(self, junction: str) -> Heights:
        """Heights of a junction's area."""
        return Heights(np.array(list(self._lines_of(junction)), dtype=np.object_))

    @cached_property
    def _lines(self) -> tuple[NDArray[np.object_], shapely.STRtree]:
        ways = [lane for edge in self._net.ways for lane in edge.lanes]
        borders = [line for lane in self._lanes for line in (lane.left, lane.right)]
        lines = np.array(
            [shapely.LineString(line) for line in (*borders, *(lane.centre for lane in ways))],
            dtype=np.object_,
        )
        return lines, shapely.STRtree(lines)

    @cached_property
    def _meeting(self) -> dict[str, list[tuple[NetEdge, bool]]]:
        """Streets by junction, and whether they end there."""
        found: dict[str, list[tuple[NetEdge, bool]]] = {}
        for edge in self._net.streets.values():
            found.setdefault(edge.ends, []).append((edge, True))
            found.setdefault(edge.begins, []).append((edge, False))
        return found

    def _lines_of(self, junction: str) -> Iterator[shapely.Geometry]:
        for edge in self._net.ways:
            if edge.junction == junction:
                for lane in edge.lanes:
                    yield shapely.LineString(lane.centre)
        for edge, at_end in self._meeting.get(junction, ()):
            for lane in edge.lanes:
                for border in (lane.left, lane.right):
                    line = shapely.LineString(border[::-1] if at_end else border)
                    yield substring(line, 0.0, APPROACH_M)

    def meshes(self) -> list[Mesh]:
        """Asphalt, sidewalks and kerbs."""
        pieces = {
            "asphalt": list(self._asphalt()),
            "sidewalk": list(self._tops(shapely.buffer(self.raised, -KERB_WIDTH_M))),
            "kerb": list(self._kerbs()),
        }
        return [
            mesh(name, found, *MATERIALS[name]) for name, found in pieces.items() if len(found) > 0
        ]

    def _asphalt(self) -> Iterator[Piece]:
        for lane in self._lanes:
            if lane.kind != "sidewalk":
                half = lane.width_m / 2 + OVERLAP_M
                yield ribbon(lane.beside(half), lane.beside(-half))
        for name, area in self.crossings_of_streets.items():
            heights = self.height_in(name)
            yield from _spread(shapely.buffer(area, OVERLAP_M, join_style="mitre"), heights.at)
        covered = [self._carriageways, *self.crossings_of_streets.values()]
        left_over = shapely.difference(self.roadway, shapely.union_all(covered), grid_size=SNAP_M)
        yield from _spread(shapely.buffer(left_over, OVERLAP_M, join_style="mitre"), self.height)

    def _tops(self, area: BaseGeometry) -> Iterator[Piece]:
        for piece in _spread(area, self.height):
            yield Piece(piece.vertices + UP, piece.triangles)

    def _kerbs(self) -> Iterator[Piece]:
        stones = shapely.difference(self.raised, shapely.buffer(self.raised, -KERB_WIDTH_M))
        yield from self._tops(stones)
        for polygon in polygons_of(self.raised):
            upright = shapely.orient_polygons(polygon)
            for ring in (upright.exterior, *upright.interiors):
                plane = shapely.get_coordinates(shapely.segmentize(ring, CELL_M))
                foot = np.column_stack([plane, self.height(plane)])
                yield ribbon(foot + UP, foot - OVERLAP_M * UP)


def _spread(area: BaseGeometry, height: Callable[[Points], NDArray[np.float64]]) -> Iterator[Piece]:
    """An area as surface; in small facets where it is not level."""
    for polygon in polygons_of(area):
        whole = filled(polygon)
        z = height(whole[0])
        if np.ptp(z) <= LEVEL_WITHIN_M:
            yield Piece(np.column_stack([whole[0], z]), whole[1])
            continue
        cut = shapely.intersection(cells(polygon.bounds, CELL_M), polygon)
        for cell in (part for shape in cut for part in polygons_of(shape)):
            corners, triangles = filled(cell)
            yield Piece(np.column_stack([corners, height(corners)]), triangles)


def _closed(area: BaseGeometry, reach_m: float) -> BaseGeometry:
    """The area with gaps narrower than twice the reach filled."""
    grown = shapely.buffer(area, reach_m, join_style="mitre")
    return shapely.buffer(grown, -reach_m, join_style="mitre")


def _opened(area: BaseGeometry, reach_m: float) -> BaseGeometry:
    """The area without strips narrower than twice the reach."""
    shrunk = shapely.buffer(area, -reach_m, join_style="mitre")
    return shapely.buffer(shrunk, reach_m, join_style="mitre")


def _without_small_holes(area: BaseGeometry) -> BaseGeometry:
    polygons = [
        shapely.Polygon(
            polygon.exterior,
            [ring for ring in polygon.interiors if shapely.Polygon(ring).area > HOLE_M2],
        )
        for polygon in polygons_of(area)
    ]
    return shapely.union_all(polygons)
