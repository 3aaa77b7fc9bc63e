"""Builds verges: gravel and bare soil of ragged width along paving, and grass behind it.

Grass on medians and weeds behind kerbs are here, too.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    Mesh,
    MeshPart,
    TriangleSurface,
    extract_polygons,
    normalize,
    xyz,
)
from advercity.geometry.polyline import polyline_stations, resample_polyline
from advercity.randomness import create_generator
from advercity.scene.site import Site
from advercity.semantics import Semantic

VERGE_M, TUFTS_PER_M, BLADES_PER_TUFT, MAX_TUFTS = 3.0, 60.0, 7, 76_000
"""Width of the strip with tufts of grass along paved edges, and how many."""
DRY_FRACTION = 0.16
"""Fraction of withered tufts."""
STEP_M = 0.3
"""Distance of the points between which the width of bare ground changes."""
ROADWAY_BARE_M, SIDEWALK_BARE_M = 0.26, 0.07
"""Mean width of bare ground along a roadway, where wheels come, and along a sidewalk."""
SPILL_M, RISE_M, SINK_M = 0.09, 0.010, 0.02
"""How far bare ground spills over the edge of paving, how far it lies above the ground there, and
how far below at its outer border, where it must not show an edge of its own."""
MAX_FALL_M = 0.5
"""Greatest difference of height within a piece of bare ground: a steeper one is a wall."""
MEDIAN_TUFTS_PER_M2, MEDIAN_MARGIN_M = 26.0, 0.14
"""Tufts on medians, and how far from their kerbs: blades may hang over these, but over no lane."""
WEEDS_PER_M, JOINT_M = 1.2, (0.12, 0.155)
"""Weeds along kerbs, and how far behind their faces is the joint with their roots."""
TUFT_SPREAD_M, WEED_SPREAD_M = 0.13, 0.05
"""Greatest distance of roots from the middle of a tuft: grass is a sward, weeds stand alone."""
_WAVES_M, _WEIGHTS = (13.0, 2.7, 0.8, 0.35), (0.4, 0.5, 0.5, 0.4)
_BLADE_WIDTH_M = 0.010


@dataclass(frozen=True, eq=False)
class _Edges:
    """Points along the edges of paving, with free ground beside them.

    Attributes:
        points: (n, 2) metres.
        steps: (n, 2) to the next point of the same edge.
        outward: (n, 2) unit vectors away from the paving.
        bare_m: (n, 2) width of the bare ground at a point and at the next.
        spill_m: (n, 2) how far it spills over the paving at both.
        is_roadway: (n,) whether wheels come here.
    """

    points: Float64Array
    steps: Float64Array
    outward: Float64Array
    bare_m: Float64Array
    spill_m: Float64Array
    is_roadway: NDArray[np.bool_]

    def select(self, rows: NDArray[np.bool_]) -> "_Edges":
        """Select some of the points."""
        return _Edges(
            self.points[rows],
            self.steps[rows],
            self.outward[rows],
            self.bare_m[rows],
            self.spill_m[rows],
            self.is_roadway[rows],
        )


def build_verges(roadway: BaseGeometry, site: Site, key: str) -> list[MeshPart]:
    """Build ground and grass along all paving; a roadway has wider bare ground."""
    edges = _sample_edges(roadway, site, key)
    if not len(edges.points):
        return []
    parts: list[MeshPart] = []
    for is_roadway, material in ((True, "roadside_soil"), (False, "soil")):
        these = edges.select(edges.is_roadway == is_roadway)
        if len(these.points):
            parts.append(MeshPart(_build_bare_ground(these, site), material, Semantic.TERRAIN))
    for tufts, material in _build_grass(edges, site, create_generator("verge grass", key)):
        parts.append(MeshPart(tufts, material, Semantic.TERRAIN))
    return parts


def build_street_plants(
    road_meshes: Iterable[Mesh], roadway: BaseGeometry, key: str
) -> list[MeshPart]:
    """Build grass on the medians and weeds behind the kerbs among the meshes of a road."""
    parts: list[MeshPart] = []
    for mesh in road_meshes:
        draw = create_generator("street plants", key, mesh.name)
        if mesh.material == "grass":
            tufts = _scatter_points(mesh, MEDIAN_TUFTS_PER_M2, draw)
            soil = shapely.union_all(shapely.polygons(mesh.vertices[mesh.triangles][..., :2]))
            grown = shapely.contains_xy(
                shapely.buffer(soil, -MEDIAN_MARGIN_M), tufts[:, 0], tufts[:, 1]
            )
        elif mesh.material == "kerb":
            tufts = _scatter_points(mesh, WEEDS_PER_M / (JOINT_M[1] - JOINT_M[0]), draw)
            away = shapely.distance(roadway, shapely.points(tufts[:, :2]))
            grown = (away > JOINT_M[0]) & (away < JOINT_M[1])
        else:
            continue
        if grown.any():
            height = draw.uniform(0.03, 0.11, int(grown.sum()))
            spread_m = WEED_SPREAD_M if mesh.material == "kerb" else TUFT_SPREAD_M
            blades = _build_tufts(tufts[grown], height, spread_m, draw)
            parts.append(MeshPart(blades, "grass_blades", Semantic.TERRAIN))
    return parts


def _scatter_points(mesh: Mesh, per_m2: float, draw: np.random.Generator) -> Float64Array:
    """Scatter points (n, 3) over the level faces of a mesh."""
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    area[np.abs(across[:, 2]) < area] = 0.0
    if not area.any():
        return np.empty((0, 3))
    count = int(area.sum() * per_m2)
    of = corners[draw.choice(len(area), count, p=area / area.sum())]
    u, v = draw.uniform(size=(2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return of[:, 0] + u * (of[:, 1] - of[:, 0]) + v * (of[:, 2] - of[:, 0])


def _sample_edges(roadway: BaseGeometry, site: Site, key: str) -> _Edges:
    found = [
        _sample_ring(ring, create_generator("verge", key, number))
        for number, ring in enumerate(_list_rings(site.paved_area))
    ]
    points, steps, outward, ratio = (np.concatenate(group) for group in zip(*found, strict=True))
    shapely.prepare(roadway)
    is_roadway = np.asarray(shapely.dwithin(shapely.points(points + steps / 2), roadway, 0.05))
    mean_m = np.where(is_roadway, ROADWAY_BARE_M, SIDEWALK_BARE_M)[:, None]
    spill_m = np.where(is_roadway, SPILL_M, SPILL_M / 3)[:, None] * np.clip(2 * ratio - 0.9, 0, 1)
    edges = _Edges(points, steps, outward, mean_m * ratio, spill_m, is_roadway)
    # Beside narrow gaps of the paving, and before buildings, nothing is bare.
    return edges.select(site.is_free(points + steps / 2 + 0.3 * outward, 0.2))


def _list_rings(area: BaseGeometry) -> Iterator[Float64Array]:
    """List the edges (n, 2) of an area, which is on their left."""
    for polygon in extract_polygons(area):
        turned = shapely.geometry.polygon.orient(polygon)
        for ring in (turned.exterior, *turned.interiors):
            yield np.asarray(ring.coords)[:, :2]


def _sample_ring(
    ring: Float64Array, draw: np.random.Generator
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Sample points, steps and outward directions of a ring, and bare width over its mean."""
    length_m = float(polyline_stations(ring)[-1])
    points = resample_polyline(ring, max(4, int(length_m / STEP_M) + 1))
    steps = np.diff(points, axis=0)
    outward = normalize(steps)[:, ::-1] * (1.0, -1.0)
    station = np.linspace(0.0, length_m, len(points))
    ratio = np.ones(len(points))
    for wave_m, weight in zip(_WAVES_M, _WEIGHTS, strict=True):
        knots = draw.uniform(-1.0, 1.0, int(length_m / wave_m) + 3)
        knots[-2:] = knots[:2]
        ratio += weight * np.interp(station / length_m * (len(knots) - 2), range(len(knots)), knots)
    ratio = np.clip(ratio, 0.08, None)
    return points[:-1], steps, outward, np.stack([ratio[:-1], ratio[1:]], axis=1)


def _build_bare_ground(edges: _Edges, site: Site) -> TriangleSurface:
    """Build a quadrangle beside each piece of an edge, level with it and falling outwards."""
    ends = np.stack([edges.points, edges.points + edges.steps], axis=1)
    outward = edges.outward[:, None]
    offsets = (-edges.spill_m, 0.7 * edges.bare_m, edges.bare_m + 0.05)
    rises = (RISE_M, RISE_M, -SINK_M)
    lines = [
        site.project_to_ground((ends + offset[..., None] * outward).reshape(-1, 2)) + xyz(z=rise)
        for offset, rise in zip(offsets, rises, strict=True)
    ]
    vertices = np.concatenate(lines)
    first = 2 * np.arange(len(edges.points))
    row = len(lines[0])
    quads = [
        np.stack([a, a + row, a + 1, a + 1, a + row, a + row + 1], axis=1).reshape(-1, 3)
        for a in (first, first + row)
    ]
    triangles = np.concatenate(quads)
    # At the end of a deck, ground begins some metres lower.
    is_level = np.ptp(vertices[triangles][..., 2], axis=1) < MAX_FALL_M
    triangles = triangles[is_level]
    return TriangleSurface(vertices, triangles, np.tile([0.0, 0.0, 1.0], (len(vertices), 1)))


def _build_grass(
    edges: _Edges, site: Site, draw: np.random.Generator
) -> Iterator[tuple[TriangleSurface, str]]:
    """Build tufts of grass, densest where bare ground ends."""
    length = np.linalg.norm(edges.steps, axis=1)
    count = min(int(length.sum() * TUFTS_PER_M), MAX_TUFTS)
    row = draw.choice(len(length), count, p=length / length.sum())
    at = draw.uniform(size=count)
    bare = edges.bare_m[row, 0] * (1.0 - at) + edges.bare_m[row, 1] * at
    away = 0.75 * bare + (VERGE_M - 0.75 * bare) * draw.uniform(size=count) ** draw.choice(
        [1.3, 3.0], count
    )
    foot = edges.points[row] + at[:, None] * edges.steps[row] + away[:, None] * edges.outward[row]
    # Longest at the border, missed by mowers; further off so short it ends unseen.
    height = draw.uniform(0.05, 0.13, count) * np.interp(away - bare, (0.3, VERGE_M), (1.5, 0.45))
    height *= np.where(draw.uniform(size=count) < 0.06, 1.6, 1.0)
    free = site.is_free(foot, 0.03)
    is_dry = draw.uniform(size=count) < DRY_FRACTION * np.where(away < bare + 0.3, 2.0, 0.6)
    for dry, material in ((False, "grass_blades"), (True, "straw")):
        these = free & (is_dry == dry)
        if these.any():
            feet = site.project_to_ground(foot[these])
            yield _build_tufts(feet, height[these], TUFT_SPREAD_M, draw), material


def _build_tufts(
    feet: Float64Array, height_m: Float64Array, spread_m: float, draw: np.random.Generator
) -> TriangleSurface:
    """Build blades with upward normals up to a distance around points (n, 3), bending away."""
    count = len(feet) * BLADES_PER_TUFT
    # Blade by blade over all tufts: every fourth or sixteenth is then of as many tufts.
    foot, height = np.tile(feet, (BLADES_PER_TUFT, 1)), np.tile(height_m, BLADES_PER_TUFT)
    yaw, turn = draw.uniform(0.0, 2.0 * np.pi, (2, count))
    away = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(count)])
    height = height * draw.uniform(0.6, 1.15, count)
    spread = draw.uniform(0.0, 1.0, (count, 1))
    root = foot + spread_m * spread * away
    tip = root + height[:, None] * (xyz(z=1.0) + (0.15 + 0.6 * spread) * away)
    side = 0.5 * _BLADE_WIDTH_M * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    corners = np.stack([root - side, root + side, tip], axis=1).reshape(-1, 3)
    corners[:, 2] -= np.tile([0.02, 0.02, 0.0], count)
    normals = normalize(xyz(z=1.0) + draw.normal(scale=0.3, size=foot.shape))
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.repeat(normals, 3, axis=0))
