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

from advercity.geometry.mesh import (
    Mesh,
    TriangleSurface,
    build_grid_cells,
    build_ribbon,
    extract_polygons,
    join_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points
from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.network_file import SumoEdge, SumoLane, build_enclosed_area
from advercity.roads.road_meshes import (
    KERB_HEIGHT_M,
    KERB_RISE,
    KERB_WIDTH_M,
    LEVEL_TOLERANCE_M,
    ROAD_SURFACES,
)

LANE_OVERLAP_M = 0.01
"""Neighbouring lanes reach into each other by this, so that no crack opens between them."""
HALF_GAP_M = 0.4
"""Twice as wide a gap between lanes is paved."""
HALF_SLIVER_M = 0.25
MAX_HOLE_M2 = 6.0
"""Smaller islands are paved over."""
CELL_M = 2.0
EDGE_STEP_M = 4.0
SIMPLIFY_TOLERANCE_M = 0.02
GRID_M = 0.001
APPROACH_LENGTH_M = 2.0
"""How much of a street counts for the height of the junction that it meets."""


@dataclass(frozen=True, eq=False)
class HeightInterpolator:
    """Height from lines whose height is known: the mean of all, the near ones counting most."""

    lines: NDArray[np.object_]

    def height_at(self, points: Points) -> NDArray[np.float64]:
        """Height (n,) at points (n, 2)."""
        if not len(points) or not len(self.lines):
            return np.zeros(len(points))
        places = np.asarray(shapely.points(points))[:, None]
        weight = 1.0 / (shapely.distance(places, self.lines) ** 2 + GRID_M**2) ** 2
        along = shapely.line_locate_point(self.lines, places)
        z = shapely.get_z(shapely.line_interpolate_point(self.lines, along))
        return (weight * z).sum(axis=1) / weight.sum(axis=1)


class ImportedSurface:
    """The paving of a network."""

    def __init__(self, net: ImportedNetwork) -> None:
        self._net = net

    @cached_property
    def _lanes(self) -> list[SumoLane]:
        return [lane for edge in self._net.edges.values() for lane in edge.lanes]

    @cached_property
    def _carriageways(self) -> BaseGeometry:
        """What the lanes of streets cover, sidewalks left out."""
        lanes = [lane.build_area(LANE_OVERLAP_M) for lane in self._lanes if lane.kind != "sidewalk"]
        return shapely.union_all(lanes, grid_size=GRID_M)

    @cached_property
    def _junction_path_areas(self) -> dict[str, BaseGeometry]:
        """What the ways through each junction cover."""
        areas: dict[str, list[shapely.Geometry]] = {}
        for edge in (*self._net.internal_edges, *self._net.crossings):
            for lane in edge.lanes:
                areas.setdefault(edge.junction, []).append(lane.build_area())
        return {name: shapely.union_all(found, grid_size=GRID_M) for name, found in areas.items()}

    @cached_property
    def junction_areas(self) -> dict[str, BaseGeometry]:
        """The area of each junction that no street covers."""
        areas: dict[str, BaseGeometry] = {}
        for junction in self._net.junctions.values():
            shapes = (
                [self._junction_path_areas[junction.id]]
                if junction.id in self._junction_path_areas
                else []
            )
            if len(junction.outline) > 2:
                shapes.append(build_enclosed_area(junction.outline))
            free = shapely.difference(
                shapely.union_all(shapes), self._carriageways, grid_size=GRID_M
            )
            area = shapely.union_all(extract_polygons(free))
            if not area.is_empty:
                areas[junction.id] = area
        return areas

    @cached_property
    def roadway_area(self) -> BaseGeometry:
        """All that is asphalt, gaps closed; where it lies below sidewalks too."""
        parts = [self._carriageways, *self.junction_areas.values()]
        joined = shapely.union_all(parts, grid_size=GRID_M)
        return _fill_small_holes(_close_gaps(joined, HALF_GAP_M))

    @cached_property
    def raised_area(self) -> BaseGeometry:
        """Sidewalks and the corners between them."""
        driven = shapely.union_all(
            [self._carriageways, *self._junction_path_areas.values()], grid_size=GRID_M
        )
        walks = [lane.build_area() for lane in self._lanes if lane.kind == "sidewalk"]
        corners = [
            build_enclosed_area(lane.shape)
            for edge in self._net.walking_areas
            for lane in edge.lanes
            if len(lane.shape) > 2
        ]
        area = _close_gaps(shapely.union_all([*walks, *corners], grid_size=GRID_M), HALF_SLIVER_M)
        return _remove_slivers(shapely.difference(area, driven, grid_size=GRID_M), HALF_SLIVER_M)

    @cached_property
    def footprint(self) -> BaseGeometry:
        """All that is paved."""
        area = shapely.union_all([self.roadway_area, self.raised_area], grid_size=GRID_M)
        return _fill_small_holes(shapely.simplify(area, SIMPLIFY_TOLERANCE_M))

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Edges (n, 3) of all paving, with it on their left, at the height the ground meets."""
        rings: list[Points] = []
        for polygon in extract_polygons(self.footprint):
            upright = shapely.orient_polygons(polygon)
            for ring in (upright.exterior, *upright.interiors):
                plane = shapely.get_coordinates(shapely.segmentize(ring, EDGE_STEP_M))
                on_kerb = shapely.dwithin(
                    self.raised_area, shapely.points(plane), 2 * SIMPLIFY_TOLERANCE_M
                )
                rings.append(
                    np.column_stack([plane, self.height_at(plane) + KERB_HEIGHT_M * on_kerb])
                )
        return rings

    def height_at(self, points: Points) -> NDArray[np.float64]:
        """Height (n,) of the roadway at points (n, 2), that of the nearest lane."""
        lines, tree = self._height_lines
        if not len(lines):
            return np.zeros(len(points))
        places = shapely.points(points)
        nearest = lines[tree.nearest(places)]
        along = shapely.line_locate_point(nearest, places)
        return shapely.get_z(shapely.line_interpolate_point(nearest, along))

    def junction_heights(self, junction: str) -> HeightInterpolator:
        """Heights of a junction's area."""
        return HeightInterpolator(
            np.array(list(self._junction_height_lines(junction)), dtype=np.object_)
        )

    @cached_property
    def _height_lines(self) -> tuple[NDArray[np.object_], shapely.STRtree]:
        ways = [lane for edge in self._net.internal_edges for lane in edge.lanes]
        borders = [line for lane in self._lanes for line in (lane.left_border, lane.right_border)]
        lines = np.array(
            [shapely.LineString(line) for line in (*borders, *(lane.centre for lane in ways))],
            dtype=np.object_,
        )
        return lines, shapely.STRtree(lines)

    @cached_property
    def _edges_by_junction(self) -> dict[str, list[tuple[SumoEdge, bool]]]:
        """Streets by junction, and whether they end there."""
        found: dict[str, list[tuple[SumoEdge, bool]]] = {}
        for edge in self._net.edges.values():
            found.setdefault(edge.to_junction, []).append((edge, True))
            found.setdefault(edge.from_junction, []).append((edge, False))
        return found

    def _junction_height_lines(self, junction: str) -> Iterator[shapely.Geometry]:
        for edge in self._net.internal_edges:
            if edge.junction == junction:
                for lane in edge.lanes:
                    yield shapely.LineString(lane.centre)
        for edge, at_end in self._edges_by_junction.get(junction, ()):
            for lane in edge.lanes:
                for border in (lane.left_border, lane.right_border):
                    line = shapely.LineString(border[::-1] if at_end else border)
                    yield substring(line, 0.0, APPROACH_LENGTH_M)

    def build_meshes(self) -> list[Mesh]:
        """Asphalt, sidewalks and kerbs."""
        pieces = {
            "asphalt": list(self._asphalt_patches()),
            "sidewalk": list(self._raised_patches(shapely.buffer(self.raised_area, -KERB_WIDTH_M))),
            "kerb": list(self._kerb_patches()),
        }
        return [
            join_surfaces(found).to_mesh(name, *ROAD_SURFACES[name])
            for name, found in pieces.items()
            if len(found) > 0
        ]

    def _asphalt_patches(self) -> Iterator[TriangleSurface]:
        for lane in self._lanes:
            if lane.kind != "sidewalk":
                half = lane.width_m / 2 + LANE_OVERLAP_M
                yield build_ribbon(lane.offset_line(half), lane.offset_line(-half))
        for name, area in self.junction_areas.items():
            heights = self.junction_heights(name)
            yield from _triangulate_area(
                shapely.buffer(area, LANE_OVERLAP_M, join_style="mitre"), heights.height_at
            )
        covered = [self._carriageways, *self.junction_areas.values()]
        left_over = shapely.difference(
            self.roadway_area, shapely.union_all(covered), grid_size=GRID_M
        )
        yield from _triangulate_area(
            shapely.buffer(left_over, LANE_OVERLAP_M, join_style="mitre"), self.height_at
        )

    def _raised_patches(self, area: BaseGeometry) -> Iterator[TriangleSurface]:
        for piece in _triangulate_area(area, self.height_at):
            yield TriangleSurface(piece.vertices + KERB_RISE, piece.triangles)

    def _kerb_patches(self) -> Iterator[TriangleSurface]:
        stones = shapely.difference(
            self.raised_area, shapely.buffer(self.raised_area, -KERB_WIDTH_M)
        )
        yield from self._raised_patches(stones)
        for polygon in extract_polygons(self.raised_area):
            upright = shapely.orient_polygons(polygon)
            for ring in (upright.exterior, *upright.interiors):
                plane = shapely.get_coordinates(shapely.segmentize(ring, CELL_M))
                foot = np.column_stack([plane, self.height_at(plane)])
                yield build_ribbon(foot + KERB_RISE, foot - LANE_OVERLAP_M * KERB_RISE)


def _triangulate_area(
    area: BaseGeometry, height: Callable[[Points], NDArray[np.float64]]
) -> Iterator[TriangleSurface]:
    """An area as surface; in small facets where it is not level."""
    for polygon in extract_polygons(area):
        whole = triangulate_polygon(polygon)
        z = height(whole[0])
        if np.ptp(z) <= LEVEL_TOLERANCE_M:
            yield TriangleSurface(np.column_stack([whole[0], z]), whole[1])
            continue
        cut = shapely.intersection(build_grid_cells(polygon.bounds, CELL_M), polygon)
        for cell in (part for shape in cut for part in extract_polygons(shape)):
            corners, triangles = triangulate_polygon(cell)
            yield TriangleSurface(np.column_stack([corners, height(corners)]), triangles)


def _close_gaps(area: BaseGeometry, reach_m: float) -> BaseGeometry:
    """The area with gaps narrower than twice the reach filled."""
    grown = shapely.buffer(area, reach_m, join_style="mitre")
    return shapely.buffer(grown, -reach_m, join_style="mitre")


def _remove_slivers(area: BaseGeometry, reach_m: float) -> BaseGeometry:
    """The area without strips narrower than twice the reach."""
    shrunk = shapely.buffer(area, -reach_m, join_style="mitre")
    return shapely.buffer(shrunk, reach_m, join_style="mitre")


def _fill_small_holes(area: BaseGeometry) -> BaseGeometry:
    polygons = [
        shapely.Polygon(
            polygon.exterior,
            [ring for ring in polygon.interiors if shapely.Polygon(ring).area > MAX_HOLE_M2],
        )
        for polygon in extract_polygons(area)
    ]
    return shapely.union_all(polygons)
