"""Street furniture that traffic rules and sensors need: signals, carriers of sensors."""

from dataclasses import replace

import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit
from advercity_dsl.base import Point2
from advercity_dsl.road import SurroundingKind

from advercity.semantics import Semantic
from advercity.world.built_road import BuiltRoad, Head
from advercity.world.roads import built
from advercity.world.scene import Mesh, SignalLamp
from advercity.world.shapes import (
    Floats,
    Piece,
    Surface,
    box,
    joined,
    loft,
    meshes,
    moved,
    prism,
    tube,
    xyz,
)
from advercity.world.signs import posted_sign
from advercity.world.site import GroundHeight

LENS_SPACING_M = 0.31
"""From the yellow lens up to the red one and down to the green one."""
LENS_RADIUS_M = 0.13
HEAD_DROP_M = 0.85
"""From the point where heads hang to their yellow lens. A roadside unit may stand at that point,
so housing and arm stay well below it."""
CARRIED_WITHIN_M = 1.5
_ARM_DROP_M = 0.55
_HEAD_FACE_M = 0.30
_CARRIER_BELOW_M = 0.3
_HEAD_MIDDLE_M = 0.2
"""Of a head, ahead of where it hangs."""
_CARRIERS = (
    SurroundingKind.TOWER,
    SurroundingKind.POLE,
    SurroundingKind.WALL,
)


def furniture(road: Road, ground_height: GroundHeight) -> tuple[list[Mesh], list[SignalLamp]]:
    """Meshes of signals, signs and carriers of roadside units, and the signals' lamps.

    Args:
        road: The declaration.
        ground_height: World positions (n, 2) to heights (n,), metres.
    """
    place = built(road)
    pieces: list[Piece] = []
    lamps: list[SignalLamp] = []
    units = [unit for unit in road.agents.values() if isinstance(unit, RoadsideUnit)]
    for declared in place.heads:
        carried = next((unit for unit in units if _carries(declared, unit)), None)
        head = declared if carried is None else _below(carried, declared)
        lamps.append(_signal_lamp(head))
        pieces += _signal(head, _height(ground_height, head.pole_m))
        if carried is not None:
            pieces.append(_stub(carried, head))
    for sign in place.signs:
        pieces += posted_sign(sign, _height(ground_height, sign.at_m))
    for unit in units:
        if not _is_carried(unit, road, place):
            pieces += _carrier(unit, ground_height)
    return meshes(pieces, "furniture_"), lamps


def _height(ground_height: GroundHeight, point: Point2) -> float:
    return float(ground_height(np.array([point], dtype=np.float64))[0])


def _carries(head: Head, unit: RoadsideUnit) -> bool:
    gap = np.subtract(head.at_m[:2], unit.position_m[:2])
    return bool(np.linalg.norm(gap) < CARRIED_WITHIN_M and head.at_m[2] < unit.position_m[2])


def _below(unit: RoadsideUnit, head: Head) -> Head:
    """The head right below a unit, where the unit's own cameras and beams do not reach."""
    x, y = np.asarray(unit.position_m[:2]) - _HEAD_MIDDLE_M * np.asarray(head.facing)
    return replace(head, at_m=(float(x), float(y), head.at_m[2]))


def _stub(unit: RoadsideUnit, head: Head) -> Piece:
    """What holds a unit over a signal's arm."""
    x, y, z = unit.position_m
    foot = np.asarray(head.at_m) - (0.0, 0.0, _ARM_DROP_M)
    bend = np.array([x, y, foot[2] + 0.15])
    stub = tube([foot, bend, np.array([x, y, z - _CARRIER_BELOW_M])], 0.04, sides=6)
    return Piece(stub, "metal", Semantic.POLE)


def _signal_lamp(head: Head) -> SignalLamp:
    forward = _HEAD_FACE_M * np.array(head.facing)
    x, y, z = np.asarray(head.at_m) + xyz(forward[0], forward[1], -HEAD_DROP_M)
    return SignalLamp(head.id, (float(x), float(y), float(z)), head.facing)


def _signal(head: Head, ground_m: float) -> list[Piece]:
    """A mast with an arm, from which a head hangs and looks at its traffic."""
    tip = np.asarray(head.at_m) - (0.0, 0.0, _ARM_DROP_M)
    foot = np.array([*head.pole_m, ground_m])
    top = np.array([*head.pole_m, tip[2]])
    mast = tube([foot - xyz(z=0.3), top + xyz(z=0.12)], [0.13, 0.09])
    pieces = [Piece(mast, "metal", Semantic.POLE)]
    if np.linalg.norm((tip - top)[:2]) > 0.1:
        pieces.append(Piece(tube([top, tip], [0.075, 0.05]), "metal", Semantic.POLE))
    yaw = float(np.arctan2(head.facing[1], head.facing[0]))
    middle = np.asarray(head.at_m) - (0.0, 0.0, HEAD_DROP_M)
    return pieces + [
        Piece(moved(part, middle, yaw=yaw), material, Semantic.TRAFFIC_LIGHT)
        for part, material in _head()
    ]


def _head() -> list[tuple[Surface, str]]:
    """A three-lens head, x towards its traffic, z of the yellow lens 0, the arm at x = 0."""
    face = _HEAD_FACE_M
    hoods = [_hood(face - 0.02, LENS_SPACING_M * step) for step in (1, 0, -1)]
    lenses = [
        (_disc(face, LENS_SPACING_M * step), f"signal_{colour}")
        for step, colour in ((1, "red"), (0, "yellow"), (-1, "green"))
    ]
    black = [
        box((0.06, -0.17, -0.49), (face - 0.01, 0.17, 0.49)),
        box((0.05, -0.27, -0.58), (0.08, 0.27, 0.58)),
        *hoods,
    ]
    return [(joined(black), "black_plastic"), *lenses]


def _disc(x: float, z: float) -> Surface:
    angle = 2 * np.pi * np.arange(14) / 14
    ring = np.column_stack(
        [np.full(14, x), LENS_RADIUS_M * np.cos(angle), z + LENS_RADIUS_M * np.sin(angle)]
    )
    return loft(np.stack([ring - xyz(0.02), ring]))


def _hood(x: float, z: float) -> Surface:
    """A visor over a lens: half a tube that reaches a lens' width forward."""
    angle = np.radians(np.linspace(-10, 190, 8))
    arc = np.column_stack([np.zeros(8), np.cos(angle), np.sin(angle)])
    outer, inner = (LENS_RADIUS_M + 0.018) * arc, (LENS_RADIUS_M + 0.004) * arc
    reach = np.column_stack([0.10 + 0.10 * np.clip(np.sin(angle), 0, 1), np.zeros((8, 2))])
    start = np.array([x, 0.0, z])
    rings = [
        np.stack([start + o, start + o + r, start + i + r, start + i])
        for o, i, r in zip(outer, inner, reach, strict=True)
    ]
    return loft(np.stack(rings))


def _is_carried(unit: RoadsideUnit, road: Road, place: BuiltRoad) -> bool:
    """Whether a signal, tower, pole or wall is there already to carry the unit."""
    heads = [shapely.LineString([head.at_m[:2], head.pole_m]) for head in place.heads]
    masts = [
        shapely.Point(point)
        for item in road.surroundings
        if item.kind in _CARRIERS
        for point in item.at_m
    ]
    walls = [
        shapely.LineString(item.line_m)
        for item in road.surroundings
        if item.kind in _CARRIERS and len(item.line_m) > 1
    ]
    here = shapely.Point(unit.position_m[:2])
    return any(here.distance(thing) < CARRIED_WITHIN_M for thing in (*heads, *masts, *walls))


def _carrier(unit: RoadsideUnit, ground_height: GroundHeight) -> list[Piece]:
    """A mast right below a unit, so slender that no camera of it looks down so steeply."""
    x, y, z = unit.position_m
    ground = _height(ground_height, (x, y))
    top = max(z - _CARRIER_BELOW_M, ground + 0.1)
    mast = tube([(x, y, ground - 0.3), (x, y, top)], [0.08, 0.05])
    case = prism(_square(x, y, 0.16), ground, ground + min(0.5, 0.3 * (top - ground)))
    return [
        Piece(mast, "metal", Semantic.POLE),
        Piece(case, "black_plastic", Semantic.STATIC),
    ]


def _square(x: float, y: float, half: float) -> Floats:
    return np.array(
        [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
    )
