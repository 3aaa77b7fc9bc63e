"""Builds parked cars in the parking strips of streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import ActorClass, Blueprint, StagedConflict
from advercity_dsl.catalogue import PaintColour
from advercity_dsl.road import StripKind, SurroundingKind

from advercity.geometry import poses
from advercity.geometry.mesh import Mesh, MeshPart, TriangleSurface, build_meshes
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator
from advercity.roads.road_network import RoadNetwork
from advercity.roads.streets import StripLayout
from advercity.scene.site import StreetSide, resolve_street_sides
from advercity.traffic.paints import draw_paint
from advercity.world import Body

PARKING_SPACE_M = 6.4
"""Length of a parking space along a street."""
MIN_CAR_GAP_M = 0.8
"""Smallest gap between two cars in a row."""
OCCUPANCY = 0.7
"""Fraction of spaces with a car."""
KERB_DISTANCE_M = 0.35
PATH_CLEARANCE_M = 0.4
"""Smallest gap between a parked car and the path of a staged actor."""
_CLASSES = ("car", "van")


@dataclass(frozen=True)
class _ParkableCar:
    actor_class: ActorClass
    body: Body
    paints: Mapping[PaintColour, float]


def build_parked_cars(
    network: RoadNetwork,
    blueprints: Mapping[str, Blueprint],
    bodies: Mapping[str, Body],
    conflicts: Sequence[StagedConflict] = (),
) -> list[Mesh]:
    """Build the cars that are parked on a road; they are static, like buildings.

    Spaces on the path of a staged actor stay empty; all other cars are the same as without it.

    Args:
        network: The road, whose declaration places the cars.
        blueprints: Blueprints by id; only cars and vans park.
        bodies: Their bodies by id.
        conflicts: Staged conflicts with the paths of their actors.
    """
    paths = shapely.union_all(
        [
            shapely.buffer(
                shapely.LineString(actor.path_m),
                blueprints[actor.blueprint].width_m / 2 + PATH_CLEARANCE_M,
            )
            for conflict in conflicts
            for actor in conflict.actors
            if actor.path_m
        ]
    )
    cars = [
        _ParkableCar(item.actor_class, bodies[name], item.paints)
        for name, item in blueprints.items()
        if item.actor_class in _CLASSES
    ]
    pieces: list[MeshPart] = []
    for number, item in enumerate(network.declaration.surroundings):
        if item.kind is SurroundingKind.PARKED_CARS and item.beside and cars:
            for side in resolve_street_sides(item.beside, network.streets):
                key = f"{network.declaration.id}/{number}/{item.seed}/{side.sign}"
                pieces += _park_row(side, item.spacing_m or PARKING_SPACE_M, cars, paths, key)
    return build_meshes(pieces, "parked_")


def _park_row(
    side: StreetSide,
    place_m: float,
    cars: Sequence[_ParkableCar],
    paths: shapely.Geometry,
    key: str,
) -> Iterator[MeshPart]:
    band = next(band for band in side.strips if band.kind is StripKind.PARKING)
    # All draws of a space come before it is tested, so that a path empties only its own spaces.
    draw = create_generator("parked cars", key)
    place = band.bay_width_m or place_m
    for index in range(int(side.length_m / place)):
        car, taken = cars[int(draw.integers(len(cars)))], draw.random() < OCCUPANCY
        slip, turned = draw.uniform(-1, 1), bool(draw.random() < 0.4)
        if taken:
            paint = draw_paint(car.actor_class, key, index, paints=car.paints)
            middle = side.start_m + (index + 0.5) * place
            pose = _compute_parking_pose(
                side, band, middle, place, car.body.size, slip, turned=turned
            )
            if not shapely.intersects(paths, _compute_footprint(pose, car.body.size)):
                yield from (_place_mesh(part, pose, paint) for part in car.body.parts)


def _compute_parking_pose(
    side: StreetSide,
    band: StripLayout,
    station: float,
    place_m: float,
    size: tuple[float, float, float],
    slip: float,
    *,
    turned: bool,
) -> poses.Matrix:
    """Compute the pose of a car: across its bay, or along the kerb in the direction of traffic.

    Args:
        side: Side of the street.
        band: Parking strip.
        station: Station of the centre of the space, from the start of the street.
        place_m: Width of the bay, or length of the space along the kerb.
        size: Size of the car.
        slip: Displacement within the space, -1 to 1.
        turned: Whether a car in a bay has its nose towards the street.
    """
    length, width, _ = size
    inner, outer = abs(band.inner_t), abs(band.outer_t)
    if band.bay_width_m:
        offset = (inner + outer) / 2
        station += slip * max(0.0, (place_m - width - MIN_CAR_GAP_M) / 2)
        turn = np.pi / 2 * side.sign + (np.pi if turned else 0.0)
    else:
        offset = max(outer - KERB_DISTANCE_M - width / 2, inner + width / 2)
        station += slip * max(0.0, (place_m - MIN_CAR_GAP_M - length) / 2)
        turn = np.pi if side.sign > 0 else 0.0
    ends = np.array([-length / 2, 0.0, length / 2])
    rear, middle, front = side.street.points_at(station + ends, side.sign * offset)
    along = front - rear
    yaw = float(np.arctan2(along[1], along[0])) + turn
    grade = float(np.arctan2(along[2], np.linalg.norm(along[:2])))
    return poses.pose_matrix(
        middle, yaw=yaw, pitch=-grade * np.cos(turn), roll=-grade * np.sin(turn)
    )


def _compute_footprint(pose: poses.Matrix, size: tuple[float, float, float]) -> shapely.Polygon:
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) / 2 * size
    return shapely.Polygon(poses.transform_points(pose, corners)[:, :2])


def _place_mesh(part: Mesh, pose: poses.Matrix, paint: str) -> MeshPart:
    normals = None if part.normals is None else part.normals @ pose[:3, :3].T
    surface = TriangleSurface(
        poses.transform_points(pose, part.vertices), part.triangles.astype(np.int64), normals
    )
    return MeshPart(
        surface, paint if part.material == ACTOR_PAINT else part.material, part.semantic
    )
