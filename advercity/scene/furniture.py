"""Places street furniture behind sidewalks, at declared densities."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from advercity_dsl.road import FurnitureDensity
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, move_surface
from advercity.randomness import create_generator
from advercity.scene.furniture_shapes import SHAPES, FurnitureShape, build_footing
from advercity.scene.site import Site, StreetSide

PATH_CLEARANCE_M = 0.25
"""Distance from paving: people walk on the whole width of sidewalks."""
PIECE_CLEARANCE_M = 0.4
"""Distance between pieces, and from walls, masts and buildings."""
SIGHT_CLEARANCE_M = 15.0
"""Distance from the ends of streets without furniture hiding a pedestrian."""
_STEP_M = 0.5


def build_furniture(
    sides: Sequence[StreetSide],
    density: FurnitureDensity,
    obstacles: Sequence[BaseGeometry],
    site: Site,
    key: str,
) -> list[MeshPart]:
    """Build the furniture along sides of a street; there is less where room is short.

    Args:
        sides: Sides of the street.
        density: Pieces of each kind in 100 m.
        obstacles: Walls, masts and other obstacles besides reserved ground.
        site: Ground.
        key: Key of the random draws.
    """
    taken = list(obstacles)
    return [
        part
        for side in sides
        for kind, per_100_m in density
        if per_100_m > 0
        for part in _build_kind(kind, side, per_100_m, taken, site, f"{key}/{side.sign}/{kind}")
    ]


def _build_kind(
    kind: str, side: StreetSide, per_100_m: float, taken: list[BaseGeometry], site: Site, key: str
) -> Iterator[MeshPart]:
    draw, shape = create_generator("furniture", key), SHAPES[kind]
    expected = per_100_m * side.length_m / 100
    count = int(expected) + int(draw.random() < expected % 1)
    offset = max(side.near_offset_m, PATH_CLEARANCE_M + shape.half_m[0])
    footing = build_footing(shape, offset)
    for along, place in _find_places(shape, side, offset, taken, site, draw):
        if count == 0:
            return
        count -= 1
        taken.append(_outline(shape, side, along, place))
        foot = site.project_to_ground(place)[0]
        for surface, material, semantic in (*shape.build(draw), *footing):
            # The street is to the right of a side's yaw.
            moved = move_surface(surface, foot, yaw=side.yaw(along) - np.pi / 2)
            yield MeshPart(moved, material, semantic)


def _find_places(
    shape: FurnitureShape,
    side: StreetSide,
    offset_m: float,
    taken: Sequence[BaseGeometry],
    site: Site,
    draw: np.random.Generator,
) -> Iterator[tuple[float, Float64Array]]:
    """Find free places in random order: distance along, and point (2,); `taken` may grow."""
    stations = draw.permutation(np.arange(shape.half_m[1], side.length_m, _STEP_M))
    ends = np.minimum(side.start_m + stations, side.street.stations[-1] - side.start_m - stations)
    stations = stations[ends > (SIGHT_CLEARANCE_M if shape.blocks_sight else shape.half_m[1])]
    points = side.points_at(stations, offset_m)
    for along, point in zip(stations, points, strict=True):
        outline = _outline(shape, side, float(along), point)
        paved_m, reserved_m = shapely.distance(outline, [site.paved_area, site.reserved_area])
        # Reserved ground includes the paving, which is nearer than anything else may be.
        if min(paved_m, reserved_m) < PATH_CLEARANCE_M - 0.05:
            continue
        if shapely.distance(outline, taken).min(initial=np.inf) >= PIECE_CLEARANCE_M:
            yield float(along), point


def _outline(
    shape: FurnitureShape, side: StreetSide, along_m: float, place: Float64Array
) -> shapely.Polygon:
    yaw = side.yaw(along_m)
    ahead, aside = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    deep, wide = shape.half_m
    corners = [(deep, wide), (deep, -wide), (-deep, -wide), (-deep, wide)]
    return shapely.Polygon([place + x * aside + y * ahead for x, y in corners])
