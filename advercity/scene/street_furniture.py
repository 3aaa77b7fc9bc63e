"""Builds traffic lights and signs, and masts of roadside units."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from advercity_dsl import RoadsideUnit
from advercity_dsl.road import SurroundingKind
from advercity_dsl.units import Point2

from advercity.geometry.mesh import (
    Mesh,
    MeshPart,
    TriangleSurface,
    build_meshes,
    join_surfaces,
    move_surface,
    xyz,
)
from advercity.geometry.primitives import box, loft_rings, tube
from advercity.roads.road_network import RoadNetwork
from advercity.roads.signals import TrafficLight
from advercity.scene.site import GroundHeight
from advercity.scene.traffic_signs import build_traffic_sign
from advercity.semantics import Semantic
from advercity.signal_heads import SIGNAL_HEADS, SignalHead
from advercity.world import SignalLamp

MAX_CARRIER_DISTANCE_M = 1.5
"""Distance within which a signal, mast or wall carries a roadside unit."""
_ARM_DROP_M = 0.55
_MAST_TOP_DROP_M = 0.3
_HEAD_CENTRE_M = 0.2
"""Distance of a head's centre ahead of its declared point."""
_CARRIERS = (SurroundingKind.TOWER, SurroundingKind.POLE, SurroundingKind.WALL)


def build_street_furniture(
    network: RoadNetwork, ground_height: GroundHeight
) -> tuple[list[Mesh], list[SignalLamp]]:
    """Build meshes of signals, signs and masts of roadside units, and the signals' lamps."""
    road = network.declaration
    pieces: list[MeshPart] = []
    lamps: list[SignalLamp] = []
    units = [unit for unit in road.agents.values() if isinstance(unit, RoadsideUnit)]
    for declared in network.traffic_lights:
        carried = next((unit for unit in units if _can_carry(declared, unit)), None)
        head = declared if carried is None else _lower_head(carried, declared)
        lamps.append(_locate_signal_lamp(head))
        build = _build_mast_light if head.governs == "vehicles" else _build_pedestrian_light
        pieces += build(head, _ground_height_at(ground_height, head.mast_foot_m))
        if carried is not None:
            pieces.append(_build_stub(carried, head))
    for sign in network.traffic_signs:
        pieces += build_traffic_sign(sign, _ground_height_at(ground_height, sign.position_m))
    for unit in units:
        if not _is_carried(unit, network):
            pieces += _build_mast(unit, ground_height)
    return build_meshes(pieces, "furniture_"), lamps


def _ground_height_at(ground_height: GroundHeight, point: Point2) -> float:
    return float(ground_height(np.array([point], dtype=np.float64))[0])


def _can_carry(head: TrafficLight, unit: RoadsideUnit) -> bool:
    gap = np.subtract(head.position_m[:2], unit.position_m[:2])
    near = np.linalg.norm(gap) < MAX_CARRIER_DISTANCE_M
    over_road = head.governs == "vehicles"
    return bool(near and over_road and head.position_m[2] < unit.position_m[2])


def _lower_head(unit: RoadsideUnit, head: TrafficLight) -> TrafficLight:
    """Move a head right below a unit, where the unit's own cameras and beams cannot see it."""
    x, y = np.asarray(unit.position_m[:2]) - _HEAD_CENTRE_M * np.asarray(head.facing)
    return replace(head, position_m=(float(x), float(y), head.position_m[2]))


def _build_stub(unit: RoadsideUnit, head: TrafficLight) -> MeshPart:
    """Build the tube holding a unit above a signal's arm."""
    x, y, z = unit.position_m
    foot = np.asarray(head.position_m) - (0.0, 0.0, _ARM_DROP_M)
    bend = np.array([x, y, foot[2] + 0.15])
    stub = tube([foot, bend, np.array([x, y, z - _MAST_TOP_DROP_M])], 0.04, sides=6)
    return MeshPart(stub, "metal", Semantic.POLE)


def _locate_signal_lamp(head: TrafficLight) -> SignalLamp:
    shape = SIGNAL_HEADS[head.governs]
    ahead = shape.face_m * np.array(head.facing)
    x, y, z = np.asarray(head.position_m) + xyz(ahead[0], ahead[1], -shape.drop_m)
    return SignalLamp(head.id, (float(x), float(y), float(z)), head.facing, head.governs)


def _build_mast_light(head: TrafficLight, ground_m: float) -> list[MeshPart]:
    """Build a mast with an arm, and a head on it facing its traffic."""
    tip = np.asarray(head.position_m) - (0.0, 0.0, _ARM_DROP_M)
    foot = np.array([*head.mast_foot_m, ground_m])
    top = np.array([*head.mast_foot_m, tip[2]])
    mast = tube([foot - xyz(z=0.3), top + xyz(z=0.12)], [0.13, 0.09])
    pieces = [MeshPart(mast, "metal", Semantic.POLE)]
    if np.linalg.norm((tip - top)[:2]) > 0.1:
        pieces.append(MeshPart(tube([top, tip], [0.075, 0.05]), "metal", Semantic.POLE))
    return pieces + _place_head(head, _build_vehicle_head())


def _build_pedestrian_light(head: TrafficLight, ground_m: float) -> list[MeshPart]:
    """Build a post with a head on it, and a box with the button for requesting green."""
    x, y, top_m = head.position_m
    post = tube([(x, y, ground_m - 0.3), (x, y, top_m)], 0.05)
    shape = SIGNAL_HEADS["pedestrians"]
    behind = box((0.0, -0.13, -0.26), (shape.face_m - 0.01, 0.13, 0.26))
    button_m = ground_m + 1.1 - (top_m - shape.drop_m)
    button = box((0.03, -0.05, button_m - 0.08), (0.12, 0.05, button_m + 0.08))
    black = join_surfaces([behind, *_build_visors(shape)])
    return [
        MeshPart(post, "metal", Semantic.POLE),
        *_place_head(head, [(black, "black_plastic"), (button, "car_paint_yellow")]),
    ]


def _place_head(head: TrafficLight, parts: Sequence[tuple[TriangleSurface, str]]) -> list[MeshPart]:
    """Turn the parts of a head, x towards its traffic, to where it is attached."""
    yaw = float(np.arctan2(head.facing[1], head.facing[0]))
    middle = np.asarray(head.position_m) - (0.0, 0.0, SIGNAL_HEADS[head.governs].drop_m)
    return [
        MeshPart(move_surface(part, middle, yaw=yaw), material, Semantic.TRAFFIC_LIGHT)
        for part, material in parts
    ]


def _build_vehicle_head() -> list[tuple[TriangleSurface, str]]:
    shape = SIGNAL_HEADS["vehicles"]
    face = shape.face_m
    lenses = [
        (_build_lens(face, height_m, shape.lens_radius_m), f"signal_{signal.name.lower()}")
        for signal, height_m in shape.lens_heights_m.items()
    ]
    black = [
        box((0.06, -0.17, -0.49), (face - 0.01, 0.17, 0.49)),
        box((0.05, -0.27, -0.58), (0.08, 0.27, 0.58)),
        *_build_visors(shape),
    ]
    return [(join_surfaces(black), "black_plastic"), *lenses]


def _build_lens(x: float, z: float, radius_m: float) -> TriangleSurface:
    angle = 2 * np.pi * np.arange(14) / 14
    ring = np.column_stack([np.full(14, x), radius_m * np.cos(angle), z + radius_m * np.sin(angle)])
    return loft_rings(np.stack([ring - xyz(0.02), ring]))


def _build_visors(shape: SignalHead) -> list[TriangleSurface]:
    heights_m = shape.lens_heights_m.values()
    return [_build_visor(shape.face_m - 0.02, z, shape.lens_radius_m) for z in heights_m]


def _build_visor(x: float, z: float, lens_radius_m: float) -> TriangleSurface:
    """Build the visor of a lens: half a tube, a lens long."""
    angle = np.radians(np.linspace(-10, 190, 8))
    arc = np.column_stack([np.zeros(8), np.cos(angle), np.sin(angle)])
    outer, inner = (lens_radius_m + 0.018) * arc, (lens_radius_m + 0.004) * arc
    depth = np.column_stack([0.10 + 0.10 * np.clip(np.sin(angle), 0, 1), np.zeros((8, 2))])
    start = np.array([x, 0.0, z])
    rings = [
        np.stack([start + o, start + o + d, start + i + d, start + i])
        for o, i, d in zip(outer, inner, depth, strict=True)
    ]
    return loft_rings(np.stack(rings))


def _is_carried(unit: RoadsideUnit, network: RoadNetwork) -> bool:
    """Return whether a signal, tower, pole or wall carries the unit already."""
    heads = [
        (head.position_m[:2], head.mast_foot_m)
        for head in network.traffic_lights
        if head.governs == "vehicles"
    ]
    items = [item for item in network.declaration.surroundings if item.kind in _CARRIERS]
    walls = [item.line_m for item in items if len(item.line_m) > 1]
    lines = [shapely.LineString(line) for line in (*heads, *walls)]
    masts = [shapely.Point(point) for item in items for point in item.at_m]
    here = shapely.Point(unit.position_m[:2])
    return any(here.distance(thing) < MAX_CARRIER_DISTANCE_M for thing in (*lines, *masts))


def _build_mast(unit: RoadsideUnit, ground_height: GroundHeight) -> list[MeshPart]:
    """Build a mast right below a unit, too slender for its cameras to see."""
    x, y, z = unit.position_m
    ground = _ground_height_at(ground_height, (x, y))
    top = max(z - _MAST_TOP_DROP_M, ground + 0.1)
    mast = tube([(x, y, ground - 0.3), (x, y, top)], [0.08, 0.05])
    height_m = min(0.5, 0.3 * (top - ground))
    case = box((x - 0.16, y - 0.16, ground), (x + 0.16, y + 0.16, ground + height_m))
    return [
        MeshPart(mast, "metal", Semantic.POLE),
        MeshPart(case, "black_plastic", Semantic.STATIC),
    ]
