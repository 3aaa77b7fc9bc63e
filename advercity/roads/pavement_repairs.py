"""Places repairs of roadways: sealed cracks, patches and joints between passes of the paver.

Sizes follow common practice: cracks are sealed in bands of 4 to 8 cm, patches are cut with straight
edges along the lane. Their number varies from street to street, by its age.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity.geometry.polyline import Points, left_normals, unit_vectors
from advercity.randomness import create_generator
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.road_inlays import RoadInlay

AGE = (0.15, 1.6)
"""Least and greatest number of repairs of a street, over the usual one."""
TRANSVERSE_SPACING_M, LENGTHWISE_SPACING_M, PATCH_SPACING_M = 24.0, 42.0, 60.0
"""Usual distance of cracks across and along a lane, and of patches."""
IN_JUNCTION_FRACTION = 0.35
"""Repairs on a path through a junction over the repairs of a lane: several paths overlap."""
SEAL_WIDTH_M, PATCH_SEAL_M = (0.04, 0.075), 0.04
"""Width of the bands over cracks, and around patches."""
CRACK_STEP_M, CRACK_TURN_M = 0.3, 0.045
"""Distance of a crack's points, and how far each is from the direction of those before it."""
LENGTHWISE_M = (3.0, 14.0)
PATCH_LENGTH_M, PATCH_WIDTH_M, PATCH_MARGIN_M = (0.7, 4.5), (0.6, 1.7), 0.25
JOINT_FRACTION, JOINT_WIDTH_M, JOINT_OFFSET_M, JOINT_STEP_M = 0.5, 0.03, 0.13, 1.5
"""Fraction of lanes with a joint on their left, its width, distance from there, length of
pieces."""
END_MARGIN_M = 2.0
"""Ends of lanes, where stop lines are, and short lanes have no repairs."""

SEAL, JOINT, PATCHES = "bitumen", "asphalt_new", ("asphalt_new", "asphalt_aged")


def place_repairs(
    lanes: Sequence[LaneSegment], key: str, reserved: BaseGeometry | None = None
) -> list[RoadInlay]:
    """Place the repairs of all driving lanes, none over another one.

    Args:
        lanes: Lanes of a road; repairs keep clear of its crossings.
        key: Name of the road.
        reserved: More area to keep free.
    """
    crossings = [lane for lane in lanes if lane.kind == "crossing"]
    outlines = [np.vstack([lane.left, lane.right[::-1]])[:, :2] for lane in crossings]
    free_of = shapely.union_all([reserved, *(shapely.Polygon(outline) for outline in outlines)])
    driven = [lane for lane in lanes if lane.kind == "driving" and lane.length_m > 3 * END_MARGIN_M]
    found: list[RoadInlay] = []
    for lane in driven:
        for patch in _lay_patches(lane, key):
            outline = shapely.union_all([part.outline for part in patch])
            if not shapely.intersects(free_of, outline):
                free_of = shapely.union(free_of, outline)
                found += patch
    # Bands are interrupted where others have been laid.
    for lay_bands in (_seal_cracks, _lay_joint):
        shapely.prepare(free_of)
        bands = [band for lane in driven for band in lay_bands(lane, key)]
        laid = [band for band in bands if not shapely.intersects(free_of, band.outline)]
        free_of = shapely.union_all([free_of, *(band.outline for band in laid)])
        found += laid
    return found


def _draw_age(lane: LaneSegment, key: str) -> float:
    """Draw the number of repairs of a lane over the usual one."""
    # Ids of lanes are their street's id and a number.
    street = create_generator("pavement age", key, lane.id.rstrip("0123456789"))
    return street.uniform(*AGE) * (IN_JUNCTION_FRACTION if lane.in_junction else 1.0)


def _lay_patches(lane: LaneSegment, key: str) -> Iterator[list[RoadInlay]]:
    draw = create_generator("patches", key, lane.id)
    for at in _draw_stations(lane, PATCH_SPACING_M / _draw_age(lane, key), draw):
        yield list(_lay_patch(lane, at, draw))


def _seal_cracks(lane: LaneSegment, key: str) -> Iterator[RoadInlay]:
    often, draw = _draw_age(lane, key), create_generator("cracks", key, lane.id)
    for at in _draw_stations(lane, TRANSVERSE_SPACING_M / often, draw):
        yield from _seal_transverse_crack(lane, at, draw)
    for at in _draw_stations(lane, LENGTHWISE_SPACING_M / often, draw):
        yield from _seal_lengthwise_crack(lane, at, draw)


def _draw_stations(lane: LaneSegment, spacing_m: float, draw: np.random.Generator) -> Points:
    """Draw stations (n,), as many as a spacing gives on average."""
    within_m = lane.length_m - 2 * END_MARGIN_M
    return END_MARGIN_M + within_m * draw.uniform(size=draw.poisson(within_m / spacing_m))


def _seal_transverse_crack(
    lane: LaneSegment, at_m: float, draw: np.random.Generator
) -> Iterator[RoadInlay]:
    """Seal a crack from one border of a lane over most of it or all."""
    reach = draw.uniform(0.35, 1.0)
    count = max(3, int(reach * lane.width_m / CRACK_STEP_M))
    fraction = np.linspace(0.0, reach, count)
    if draw.uniform() < 0.5:
        fraction = 1.0 - fraction
    along = at_m + _wander(count, draw) + draw.normal(scale=0.12) * np.arange(count) * CRACK_STEP_M
    yield from _lay_band(lane.points_at(along.clip(0.0, lane.length_m), fraction), SEAL, draw)


def _seal_lengthwise_crack(
    lane: LaneSegment, at_m: float, draw: np.random.Generator
) -> Iterator[RoadInlay]:
    length_m = min(draw.uniform(*LENGTHWISE_M), lane.length_m - at_m - 0.5 * END_MARGIN_M)
    if length_m < LENGTHWISE_M[0] / 2:
        return
    along = at_m + np.arange(0.0, length_m, 2 * CRACK_STEP_M)
    aside = draw.uniform(0.15, 0.85) + _wander(len(along), draw) / lane.width_m
    yield from _lay_band(lane.points_at(along, aside.clip(0.03, 0.97)), SEAL, draw)


def _wander(count: int, draw: np.random.Generator) -> Points:
    """Draw how far points (n,) of a crack are from a straight line, metres."""
    turns = draw.normal(scale=CRACK_TURN_M, size=count)
    return np.cumsum(turns) + draw.normal(scale=0.5 * CRACK_TURN_M, size=count)


def _lay_band(line: Points, material: str, draw: np.random.Generator) -> Iterator[RoadInlay]:
    """Lay a band of uneven width along a line (n, 3)."""
    if len(line) < 2:
        return
    half = 0.5 * draw.uniform(*SEAL_WIDTH_M) * draw.uniform(0.75, 1.25, len(line))
    half[[0, -1]] *= 0.3
    yield from _lay_ribbon(line, half, material)


def _lay_ribbon(line: Points, half_width_m: Points, material: str) -> Iterator[RoadInlay]:
    steps = np.gradient(line[:, :2], axis=0)
    aside = left_normals(unit_vectors(np.arctan2(steps[:, 1], steps[:, 0])))
    left, right = (line[:, :2] + side * half_width_m[:, None] * aside for side in (1, -1))
    rings = np.stack([left[:-1], right[:-1], right[1:], left[1:]], axis=1)
    for ring, z in zip(rings, line[:-1, 2], strict=True):
        yield RoadInlay(material, shapely.convex_hull(shapely.Polygon(ring)), float(z))


def _lay_patch(lane: LaneSegment, at_m: float, draw: np.random.Generator) -> Iterator[RoadInlay]:
    """Lay a rectangle of other asphalt, sealed all around."""
    free_m = lane.width_m - 2 * PATCH_MARGIN_M
    length_m, width_m = draw.uniform(*PATCH_LENGTH_M), min(draw.uniform(*PATCH_WIDTH_M), free_m)
    if draw.uniform() < 0.15:
        # A trench for a pipe or a cable, across the lane.
        length_m, width_m = 0.6, free_m
    material = PATCHES[int(draw.uniform() < 0.45)]
    last_m = min(at_m + length_m, lane.length_m)
    near = PATCH_MARGIN_M + draw.uniform() * (free_m - width_m)
    inner, outer = (at_m, last_m), (at_m - PATCH_SEAL_M, last_m + PATCH_SEAL_M)
    beside = near - PATCH_SEAL_M, near + width_m + PATCH_SEAL_M
    yield _lay_rectangle(lane, inner, (near, near + width_m), material)
    for along, across in (
        (outer, (beside[0], near)),
        (outer, (near + width_m, beside[1])),
        ((outer[0], inner[0]), (near, near + width_m)),
        ((inner[1], outer[1]), (near, near + width_m)),
    ):
        yield _lay_rectangle(lane, along, across, SEAL)


def _lay_rectangle(
    lane: LaneSegment,
    along_m: tuple[float, float],
    across_m: tuple[float, float],
    material: str,
) -> RoadInlay:
    """Lay a rectangle between stations and distances from the left border of a lane."""
    stations = np.array([along_m[0], along_m[0], along_m[1], along_m[1]])
    across = np.array([across_m[0], across_m[1], across_m[1], across_m[0]])
    corners = lane.points_at(stations, across / lane.width_m)
    outline = shapely.convex_hull(shapely.Polygon(corners[:, :2]))
    return RoadInlay(material, outline, float(corners[:, 2].mean()))


def _lay_joint(lane: LaneSegment, key: str) -> Iterator[RoadInlay]:
    """Lay the joint of two passes of the paver along the left border of some lanes."""
    is_seen = create_generator("joints", key, lane.id).uniform() < JOINT_FRACTION
    if lane.in_junction or not is_seen:
        return
    along = np.append(np.arange(0.0, lane.length_m, JOINT_STEP_M), lane.length_m)
    line = lane.points_at(along, JOINT_OFFSET_M / lane.width_m)
    yield from _lay_ribbon(line, np.full(len(line), JOINT_WIDTH_M / 2), JOINT)
