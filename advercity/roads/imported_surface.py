"""Roadways, sidewalks and kerbs of an imported network.

Lanes are ribbons at their own height. Junctions and gaps between lanes are areas whose height is
interpolated from the lanes around: the lanes inside them, the map's areas next to these, and the
corners added by a kerb's radius. Sidewalks are a kerb higher.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from advercity.geometry.draping import DrapeBase
from advercity.geometry.mesh import (
    GRID_M,
    Mesh,
    TriangleSurface,
    build_grid_cells,
    build_ribbon,
    extract_polygons,
    join_surfaces,
    merge_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points
from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.network_file import SumoEdge, SumoLane, build_enclosed_area
from advercity.roads.road_meshes import (
    FACET_SIZE_M,
    KERB_HEIGHT_M,
    KERB_RISE,
    KERB_WIDTH_M,
    LEVEL_TOLERANCE_M,
    ROAD_SURFACES,
)

Corners = Literal["mitre", "round"]
"""How buffers meet: with round corners, a radius is left where gaps are closed."""
LANE_OVERLAP_M = 0.01
"""Overlap of neighbouring lanes, against cracks between them."""
HALF_GAP_M = 0.4
"""Half the width of the widest paved gap between lanes."""
HALF_SLIVER_M = 0.25
"""Half the width of the narrowest possible sidewalk."""
KERB_RADIUS_M = 4.0
"""Radius of kerbs where streets meet."""
ZONE_MARGIN_M = 2.0
"""Distance beyond the outline of a junction in which kerbs are still rounded."""
MAX_HOLE_M2 = 6.0
"""Smaller islands are paved over."""
EDGE_STEP_M = 4.0
"""Largest distance between points of paved edges, which take the height of the ground."""
SIMPLIFY_TOLERANCE_M = 0.02
APPROACH_LENGTH_M = 2.0
"""Length of a street's end from which the height of its junction is interpolated."""


@dataclass(frozen=True, eq=False)
class HeightInterpolator:
    """Heights between lines (k,) in space, weighted by the inverse fourth power of distance."""

    lines: NDArray[np.object_]

    def height_at(self, points: Points) -> NDArray[np.float64]:
        """Interpolate heights (n,) at points (n, 2)."""
        if not len(points) or not len(self.lines):
            return np.zeros(len(points))
        places = np.asarray(shapely.points(points))[:, None]
        # The grid size keeps the weight finite on a line.
        weight = 1.0 / (shapely.distance(places, self.lines) ** 2 + GRID_M**2) ** 2
        along = shapely.line_locate_point(self.lines, places)
        z = shapely.get_z(shapely.line_interpolate_point(self.lines, along))
        return (weight * z).sum(axis=1) / weight.sum(axis=1)


class ImportedSurface:
    """The paving of a network; areas are computed when they are first needed."""

    def __init__(self, net: ImportedNetwork) -> None:
        self._net = net

    @cached_property
    def _lanes(self) -> list[SumoLane]:
        return [lane for edge in self._net.edges.values() for lane in edge.lanes]

    @cached_property
    def _paths(self) -> list[SumoLane]:
        return [lane for edge in self._net.internal_edges for lane in edge.lanes]

    @cached_property
    def _carriageways(self) -> BaseGeometry:
        """Area of all lanes of streets but sidewalks."""
        lanes = [lane.build_area(LANE_OVERLAP_M) for lane in self._lanes if lane.kind != "sidewalk"]
        return shapely.union_all(lanes, grid_size=GRID_M)

    @cached_property
    def _driven_area(self) -> BaseGeometry:
        """Area of all driven lanes, and of the outlines next to them in junctions."""
        paths = [lane.build_area() for lane in self._paths if lane.kind != "sidewalk"]
        parts = [self._carriageways, *paths, *self._select_outlines("roadway")]
        return shapely.union_all(parts, grid_size=GRID_M)

    def _select_outlines(self, kind: str) -> list[BaseGeometry]:
        return [build_enclosed_area(item.ring) for item in self._net.outlines if item.kind == kind]

    @cached_property
    def _junction_zones(self) -> dict[str, BaseGeometry]:
        """Area in which paving belongs to a junction rather than to streets, by id."""
        zones = {
            item.id: [build_enclosed_area(item.outline)]
            for item in self._net.junctions.values()
            if len(item.outline) > 2
        }
        for edge in (*self._net.internal_edges, *self._net.crossings):
            areas = zones.setdefault(edge.junction, [])
            areas += [lane.build_area() for lane in edge.lanes]
        return {name: shapely.union_all(found, grid_size=GRID_M) for name, found in zones.items()}

    @cached_property
    def roadway_area(self) -> BaseGeometry:
        """Area of all asphalt: lanes, rounded where they meet, without sidewalks of the map."""
        rounded = _close_gaps(self._driven_area, KERB_RADIUS_M, "round")
        zones = shapely.buffer(
            shapely.union_all(list(self._junction_zones.values())), ZONE_MARGIN_M
        )
        parts = [self._driven_area, shapely.intersection(rounded, zones)]
        joined = _close_gaps(shapely.union_all(parts, grid_size=GRID_M), HALF_GAP_M, "round")
        walks = shapely.union_all([self._walks, *self._select_outlines("sidewalk")])
        spared = shapely.difference(walks, self._driven_area)
        paved = shapely.difference(_fill_small_holes(joined), spared, grid_size=GRID_M)
        return _close_gaps(paved, -HALF_SLIVER_M)

    @cached_property
    def _walks(self) -> BaseGeometry:
        lanes = [*self._lanes, *self._paths]
        walks = [lane.build_area() for lane in lanes if lane.kind == "sidewalk"]
        return shapely.union_all(walks, grid_size=GRID_M)

    @cached_property
    def junction_areas(self) -> dict[str, BaseGeometry]:
        """Area of each junction's asphalt without streets, by id."""
        free = _drop_lines(
            shapely.difference(self.roadway_area, self._carriageways, grid_size=GRID_M)
        )
        areas = {
            name: _drop_lines(shapely.intersection(free, zone, grid_size=GRID_M))
            for name, zone in self._junction_zones.items()
        }
        return {name: area for name, area in areas.items() if not area.is_empty}

    @cached_property
    def raised_area(self) -> BaseGeometry:
        """Area of sidewalks and of the corners between them."""
        # Outlines of walking areas and junctions overlap roadways, which are subtracted below.
        corners = [
            build_enclosed_area(lane.shape)
            for edge in self._net.walking_areas
            for lane in edge.lanes
            if len(lane.shape) > 2
        ]
        outlines = self._select_outlines("sidewalk") or list(self._walked_zones())
        parts = [self._walks, *corners, *outlines]
        area = _close_gaps(shapely.union_all(parts, grid_size=GRID_M), HALF_SLIVER_M)
        raised = shapely.difference(area, self.roadway_area, grid_size=GRID_M)
        return _close_gaps(raised, -HALF_SLIVER_M)

    def _walked_zones(self) -> Iterator[BaseGeometry]:
        """Yield the areas of the junctions with a sidewalk at them."""
        for name, zone in self._junction_zones.items():
            streets = self._edges_by_junction.get(name, ())
            if any(lane.kind == "sidewalk" for edge, _ in streets for lane in edge.lanes):
                yield zone

    @cached_property
    def footprint(self) -> BaseGeometry:
        """Area of roadways and sidewalks."""
        area = shapely.union_all([self.roadway_area, self.raised_area], grid_size=GRID_M)
        return _fill_small_holes(shapely.simplify(area, SIMPLIFY_TOLERANCE_M))

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Outlines (n, 3) of all paving, which is on their left, at the height of the ground."""
        rings: list[Points] = []
        for polygon in extract_polygons(self.footprint):
            upright = shapely.orient_polygons(polygon)
            for ring in (upright.exterior, *upright.interiors):
                plane = shapely.get_coordinates(shapely.segmentize(ring, EDGE_STEP_M))
                points = shapely.points(plane)
                on_kerb = shapely.dwithin(self.raised_area, points, 2 * SIMPLIFY_TOLERANCE_M)
                z = self.height_at(plane) + KERB_HEIGHT_M * on_kerb
                rings.append(np.column_stack([plane, z]))
        return rings

    def height_at(self, points: Points) -> NDArray[np.float64]:
        """Compute heights (n,) at points (n, 2), from the nearest lane border."""
        lines, tree = self._height_lines
        if not len(lines):
            return np.zeros(len(points))
        places = shapely.points(points)
        nearest = lines[tree.nearest(places)]
        along = shapely.line_locate_point(nearest, places)
        return shapely.get_z(shapely.line_interpolate_point(nearest, along))

    def junction_heights(self, junction: str) -> HeightInterpolator:
        """Build the heights of a junction's area from its paths and the ends of its streets."""
        lines = list(self._junction_height_lines(junction))
        return HeightInterpolator(np.array(lines, dtype=np.object_))

    @cached_property
    def _height_lines(self) -> tuple[NDArray[np.object_], shapely.STRtree]:
        paths = [line for lane in self._lanes for line in (lane.left_border, lane.right_border)]
        paths += [lane.centre for lane in self._paths]
        lines = np.array([shapely.LineString(path) for path in paths], dtype=np.object_)
        lines = np.concatenate([lines, self._outline_lines])
        return lines, shapely.STRtree(lines)

    @cached_property
    def _edges_by_junction(self) -> dict[str, list[tuple[SumoEdge, bool]]]:
        """Streets by junction, and whether they end rather than begin at it."""
        found: dict[str, list[tuple[SumoEdge, bool]]] = {}
        for edge in self._net.edges.values():
            found.setdefault(edge.to_junction, []).append((edge, True))
            found.setdefault(edge.from_junction, []).append((edge, False))
        return found

    @cached_property
    def _outline_lines(self) -> NDArray[np.object_]:
        """Outlines as lines in space; those without heights, which older specs have, are none."""
        rings = [item.ring for item in self._net.outlines if item.ring[:, 2].any()]
        return np.array([shapely.LinearRing(ring) for ring in rings], dtype=np.object_)

    def _junction_height_lines(self, junction: str) -> Iterator[shapely.Geometry]:
        zone = self._junction_zones.get(junction, shapely.Point())
        yield from self._outline_lines[shapely.intersects(self._outline_lines, zone)]
        for edge in self._net.internal_edges:
            if edge.junction == junction:
                for lane in edge.lanes:
                    yield shapely.LineString(lane.centre)
        for edge, at_end in self._edges_by_junction.get(junction, ()):
            for lane in edge.lanes:
                for border in (lane.left_border, lane.right_border):
                    line = shapely.LineString(border[::-1] if at_end else border)
                    yield substring(line, 0.0, APPROACH_LENGTH_M)

    def build_pieces(self) -> dict[str, list[TriangleSurface]]:
        """Build the pieces of asphalt, sidewalks and kerbs."""
        return {
            "asphalt": self._asphalt,
            "sidewalk": list(self._raised_patches(shapely.buffer(self.raised_area, -KERB_WIDTH_M))),
            "kerb": list(self._kerb_patches()),
        }

    def drape(self, areas: Sequence[shapely.Polygon], z_m: Sequence[float]) -> TriangleSurface:
        """Lay convex areas on the asphalt nearest to their heights."""
        asphalt = join_surfaces(self._asphalt)
        return DrapeBase(asphalt.vertices[asphalt.triangles]).drape(areas, z_m)

    @cached_property
    def _asphalt(self) -> list[TriangleSurface]:
        return list(self._asphalt_patches())

    def _asphalt_patches(self) -> Iterator[TriangleSurface]:
        for lane in self._lanes:
            if lane.kind != "sidewalk":
                yield build_ribbon(
                    lane.compute_border(on_left=True, outward_m=LANE_OVERLAP_M),
                    lane.compute_border(on_left=False, outward_m=LANE_OVERLAP_M),
                )
        for name, area in self.junction_areas.items():
            heights = self.junction_heights(name)
            yield from _triangulate_area(_grow(area, LANE_OVERLAP_M), heights.height_at)
        covered = shapely.union_all([self._carriageways, *self.junction_areas.values()])
        left_over = shapely.difference(self.roadway_area, covered, grid_size=GRID_M)
        yield from _triangulate_area(_grow(left_over, LANE_OVERLAP_M), self.height_at)

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
                plane = shapely.get_coordinates(shapely.segmentize(ring, FACET_SIZE_M))
                foot = np.column_stack([plane, self.height_at(plane)])
                yield build_ribbon(foot + KERB_RISE, foot - LANE_OVERLAP_M * KERB_RISE)


def build_surface_meshes(levels: Sequence[ImportedSurface]) -> list[Mesh]:
    """Build meshes of asphalt, sidewalks and kerbs of all levels."""
    pieces: dict[str, list[TriangleSurface]] = {}
    for level in levels:
        for name, own in level.build_pieces().items():
            pieces.setdefault(name, []).extend(own)
    return merge_surfaces(pieces, ROAD_SURFACES)


def _triangulate_area(
    area: BaseGeometry, height: Callable[[Points], NDArray[np.float64]]
) -> Iterator[TriangleSurface]:
    """Triangulate an area, in small facets where it is not level."""
    for polygon in extract_polygons(area):
        # Between corners at one height, a street may still rise and fall.
        outline = shapely.get_coordinates(shapely.segmentize(polygon, EDGE_STEP_M))
        if np.ptp(height(outline)) <= LEVEL_TOLERANCE_M:
            corners, triangles = triangulate_polygon(polygon)
            yield TriangleSurface(np.column_stack([corners, height(corners)]), triangles)
            continue
        cut = shapely.intersection(build_grid_cells(polygon.bounds, FACET_SIZE_M), polygon)
        for cell in (part for shape in cut for part in extract_polygons(shape)):
            corners, triangles = triangulate_polygon(cell)
            yield TriangleSurface(np.column_stack([corners, height(corners)]), triangles)


def _drop_lines(shape: shapely.Geometry) -> BaseGeometry:
    return shapely.union_all(extract_polygons(shape))


def _grow(area: BaseGeometry, by_m: float, corners: Corners = "mitre") -> BaseGeometry:
    return shapely.buffer(area, by_m, join_style=corners)


def _close_gaps(area: BaseGeometry, half_m: float, corners: Corners = "mitre") -> BaseGeometry:
    """Close gaps narrower than twice `half_m`; if it is negative, remove such parts."""
    return _grow(_grow(area, half_m, corners), -half_m, corners)


def _fill_small_holes(area: BaseGeometry) -> BaseGeometry:
    polygons = [
        shapely.Polygon(
            polygon.exterior,
            [ring for ring in polygon.interiors if shapely.Polygon(ring).area > MAX_HOLE_M2],
        )
        for polygon in extract_polygons(area)
    ]
    return shapely.union_all(polygons)
