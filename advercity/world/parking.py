"""Cars that stand in the parking strips of streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import ActorClass, Blueprint, Road, StagedConflict
from advercity_dsl.catalogue import Colour
from advercity_dsl.road import StripKind, SurroundingKind

from advercity import poses
from advercity.randomness import generator
from advercity.streets import Band
from advercity.world.beside import Side, sides
from advercity.world.bodies import paint_for
from advercity.world.layout import layout
from advercity.world.materials import PAINT
from advercity.world.scene import Body, Mesh
from advercity.world.shapes import Piece, Surface, meshes

PLACE_M = 6.4
"""Length of a place to park along a street."""
GAP_M = 0.8
"""Least gap between two cars in a row."""
TAKEN = 0.7
"""Share of places with a car."""
FROM_KERB_M = 0.35
CLEAR_M = 0.4
"""Least gap between a parked car and the path of somebody staged."""
_CLASSES = ("car", "van")


@dataclass(frozen=True)
class _Car:
    actor_class: ActorClass
    body: Body
    paints: Mapping[Colour, float]


def parked_cars(
    road: Road,
    blueprints: Mapping[str, Blueprint],
    bodies: Mapping[str, Body],
    conflicts: Sequence[StagedConflict] = (),
) -> list[Mesh]:
    """Meshes of the cars that a road has parked: part of the place, they never move.

    Places that somebody staged crosses or stands in stay empty; the other cars are the same.

    Args:
        road: The declaration.
        blueprints: What there is, by id; only cars and vans park.
        bodies: What they look like, by id.
        conflicts: What is staged there.
    """
    paths = shapely.union_all(
        [
            shapely.buffer(
                shapely.LineString(actor.path_m), blueprints[actor.blueprint].width_m / 2 + CLEAR_M
            )
            for conflict in conflicts
            for actor in conflict.actors
            if actor.path_m
        ]
    )
    cars = [
        _Car(item.actor_class, bodies[name], item.paints)
        for name, item in blueprints.items()
        if item.actor_class in _CLASSES
    ]
    pieces: list[Piece] = []
    for number, item in enumerate(road.surroundings):
        if item.kind is SurroundingKind.PARKED_CARS and item.beside and cars:
            for side in sides(item.beside, layout(road).streets):
                key = f"{road.id}/{number}/{item.seed}/{side.sign}"
                pieces += _row(side, item.spacing_m or PLACE_M, cars, paths, key)
    return meshes(pieces, "parked_")


def _row(
    side: Side,
    place_m: float,
    cars: Sequence[_Car],
    paths: shapely.Geometry,
    key: str,
) -> Iterator[Piece]:
    band = next(band for band in side.bands if band.kind is StripKind.PARKING)
    draw = generator("parked cars", key)
    place = band.bay_m or place_m
    for index in range(int(side.length_m / place)):
        car, taken = cars[int(draw.integers(len(cars)))], draw.random() < TAKEN
        slip, turned = draw.uniform(-1, 1), bool(draw.random() < 0.4)
        if taken:
            paint = paint_for(car.actor_class, key, index, paints=car.paints)
            middle = side.first_m + (index + 0.5) * place
            pose = _pose(side, band, middle, place, car.body.size, slip, turned=turned)
            if not shapely.intersects(paths, _footprint(pose, car.body.size)):
                yield from (_placed(part, pose, paint) for part in car.body.parts)


def _pose(
    side: Side,
    band: Band,
    station: float,
    place_m: float,
    size: tuple[float, float, float],
    slip: float,
    *,
    turned: bool,
) -> poses.Matrix:
    """Where a car stands: in its bay, nose in or out as `turned` says, or along the kerb.

    Along the kerb it looks where traffic beside it drives. `slip`, -1 to 1, is how far it is
    from the middle of its place.
    """
    length, width, _ = size
    inner, outer = abs(band.inner_t), abs(band.outer_t)
    if band.bay_m:
        offset = (inner + outer) / 2
        station += slip * max(0.0, (place_m - width - GAP_M) / 2)
        turn = np.pi / 2 * side.sign + (np.pi if turned else 0.0)
    else:
        offset = max(outer - FROM_KERB_M - width / 2, inner + width / 2)
        station += slip * max(0.0, (place_m - GAP_M - length) / 2)
        turn = np.pi if side.sign > 0 else 0.0
    reach = np.array([-length / 2, 0.0, length / 2])
    rear, middle, front = side.street.at(station + reach, side.sign * offset)
    along = front - rear
    yaw = float(np.arctan2(along[1], along[0])) + turn
    grade = float(np.arctan2(along[2], np.linalg.norm(along[:2])))
    return poses.pose(middle, yaw=yaw, pitch=-grade * np.cos(turn), roll=-grade * np.sin(turn))


def _footprint(pose: poses.Matrix, size: tuple[float, float, float]) -> shapely.Polygon:
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) / 2 * size
    return shapely.Polygon(poses.transform(pose, corners)[:, :2])


def _placed(part: Mesh, pose: poses.Matrix, paint: str) -> Piece:
    normals = None if part.normals is None else part.normals @ pose[:3, :3].T
    surface = Surface(
        poses.transform(pose, part.vertices), part.triangles.astype(np.int64), normals
    )
    return Piece(surface, paint if part.material == PAINT else part.material, part.semantic)
