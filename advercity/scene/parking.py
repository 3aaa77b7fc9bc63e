"""Places parked cars in the parking strips of streets."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import count

import numpy as np
import shapely
from advercity_dsl import Blueprint, Spec, StagedConflict
from advercity_dsl.road import StripKind, SurroundingKind

from advercity.frames import Actor, ActorState, Lamp
from advercity.geometry import poses
from advercity.geometry.boxes import BOX_BASE
from advercity.randomness import create_generator
from advercity.roads.mirrored_traffic import mirror_at_rest
from advercity.roads.plan_frame import to_plan_spec
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.roads.streets import StripLayout
from advercity.scene.site import StreetSide, resolve_street_sides
from advercity.traffic.paints import draw_paint

PARKING_SPACE_M = 6.4
"""Length of a parking space along a street."""
MIN_CAR_GAP_M = 0.8
"""Smallest gap between two cars in a row."""
OCCUPANCY = 0.85
"""Fraction of spaces with a car."""
KERB_DISTANCE_M = 0.35
PATH_CLEARANCE_M = 0.4
"""Smallest gap between a parked car and the path of a staged actor."""
_CLASSES = ("car", "van")


FIRST_PARKED_CAR = 1_000_001
"""Id of the car in the first parking space; ids of traffic are lower."""


def find_parked_cars(spec: Spec) -> tuple[ActorState, ...]:
    """Find the cars and vans parked on the road of a spec, in its world."""
    plan = to_plan_spec(spec)
    parked = place_parked_cars(build_road(plan.road), plan.blueprints, plan.conflicts)
    return tuple(map(mirror_at_rest, parked)) if spec.road.is_left_hand else parked


def place_parked_cars(
    network: RoadNetwork,
    blueprints: Mapping[str, Blueprint],
    conflicts: Sequence[StagedConflict] = (),
) -> tuple[ActorState, ...]:
    """Place the cars and vans parked on a road, at rest and with all lamps off.

    Spaces on the path of a staged actor stay empty; all other cars are the same as without it.
    """
    staged = [
        (shapely.LineString(actor.path_m), blueprints[actor.blueprint].width_m / 2)
        for conflict in conflicts
        for actor in conflict.actors
        if actor.path_m
    ]
    swept = [shapely.buffer(path, half_m + PATH_CLEARANCE_M) for path, half_m in staged]
    paths = shapely.union_all(swept)
    cars = [(name, item) for name, item in blueprints.items() if item.actor_class in _CLASSES]
    ids = count(FIRST_PARKED_CAR)
    placed = (
        state
        for number, item in enumerate(network.declaration.surroundings)
        if item.kind is SurroundingKind.PARKED_CARS and item.beside and cars
        for side in resolve_street_sides(item.beside, network.streets)
        for state in _park_row(
            side,
            item.spacing_m or PARKING_SPACE_M,
            cars,
            ids,
            f"{network.declaration.id}/{number}/{item.seed}/{side.sign}",
        )
    )
    return tuple(state for state in placed if not shapely.intersects(paths, _footprint(state)))


def _park_row(
    side: StreetSide,
    place_m: float,
    cars: Sequence[tuple[str, Blueprint]],
    ids: Iterator[int],
    key: str,
) -> Iterator[ActorState]:
    """Park cars along a side of a street; every space takes an id, whether it is empty or not."""
    band = next(band for band in side.strips if band.kind is StripKind.PARKING)
    draw = create_generator("parked cars", key)
    place = band.bay_width_m or place_m
    for index in range(int(side.length_m / place)):
        (name, blueprint), taken = cars[int(draw.integers(len(cars)))], draw.random() < OCCUPANCY
        slip, turned, number = draw.uniform(-1, 1), bool(draw.random() < 0.4), next(ids)
        if taken:
            paint = draw_paint(blueprint.actor_class, key, index, paints=blueprint.paints)
            actor = Actor.from_blueprint(number, name, blueprint, paint)
            middle = side.start_m + (index + 0.5) * place
            pose = _compute_parking_pose(side, band, middle, place, actor.size, slip, turned=turned)
            yield ActorState(actor, pose, 0.0, 0.0, Lamp(0), is_parked=True)


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


def _footprint(state: ActorState) -> shapely.Polygon:
    corners = state.box.corners[BOX_BASE]
    return shapely.Polygon(poses.transform_points(state.world_from_body, corners)[:, :2])
