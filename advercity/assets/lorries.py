"""Builds the tractor units of articulated lorries.

Lengths in the catalogue are from Directive 96/53/EC, Annex I. Heights are usual ones.
"""

import numpy as np
from advercity_dsl.catalogue import FifthWheel

from advercity.assets.lettering import build_number_plate
from advercity.assets.truck_wheels import build_truck_axle
from advercity.assets.trucks import CabPlace, build_cab
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.frames import WHEELBASE_FRACTION
from advercity.geometry.mesh import (
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
)
from advercity.geometry.primitives import box, loft_rings, prism, tube
from advercity.materials import ACTOR_PAINT

COUPLING_M = 1.17
"""Height of the upper side of a fifth wheel, and of the lower one of the semi-trailer over it."""
_CAB_LENGTH_M, _CAB_ROOF_RATIO = 2.3, 0.955
_MIRROR_M = 0.14
"""Length added by a mirror to half of the width."""
_WHEEL_M = 0.50


def build_tractor(blueprint_id: str, size: Size, coupling: FifthWheel) -> list[MeshPart]:
    """Build a tractor unit of about `size`; the semi-trailer has its rear lamps."""
    length, width, height = size
    front, half = length / 2, width / 2 - _MIRROR_M
    axle = WHEELBASE_FRACTION * length / 2
    behind, roof = front - _CAB_LENGTH_M, _CAB_ROOF_RATIO * height
    cab = CabPlace(front, behind, half, roof, width, axle, _WHEEL_M)
    return [
        *build_cab(blueprint_id, cab, ACTOR_PAINT),
        *make_vehicle_parts(ACTOR_PAINT, _build_deflector(cab, height)),
        *_build_tractor_frame(blueprint_id, size, cab),
        *_build_fifth_wheel(front - coupling.behind_front_m),
        *build_truck_axle(axle, half - 0.01, _WHEEL_M, 0.32, is_steered=True),
        *build_truck_axle(-axle, half - 0.02, _WHEEL_M, 0.58),
    ]


def _build_deflector(cab: CabPlace, height: float) -> TriangleSurface:
    """Build the shield on a cab's roof leading air over the semi-trailer."""
    low, rows = cab.height - 0.12, ((cab.behind + 1.35, 0.03), (cab.behind + 0.5, 0.85))
    rows = (*rows, (cab.behind + 0.02, 1.0))
    rings = []
    for x, part in rows:
        wide, top = (0.64 + 0.10 * part) * cab.half, low + part * (height - low)
        rings.append([(x, -wide, low), (x, wide, low), (x, 0.8 * wide, top), (x, -0.8 * wide, top)])
    return loft_rings(np.array(rings))


def _build_tractor_frame(blueprint_id: str, size: Size, cab: CabPlace) -> list[MeshPart]:
    """Build beams, tanks, steps and mudguards behind the cab, and the number plate."""
    rear, axle = -size[0] / 2, -cab.axle_x
    outer = cab.half - 0.02
    beam = box((rear + 0.02, 0.30, 0.74), (cab.front - 0.5, 0.42, 1.0))
    walkway = box((axle + 0.75, -0.42, 1.0), (cab.behind - 0.02, 0.42, 1.03))
    end = box((rear + 0.01, -0.95, 0.78), (rear + 0.06, 0.95, 0.9))
    guards = [
        box((axle - 0.56, outer - 0.6, 1.06), (axle + 0.56, outer, 1.09)),
        box((axle - 0.60, outer - 0.6, 0.42), (axle - 0.56, outer, 1.09)),
        box((axle + 0.56, outer - 0.6, 0.72), (axle + 0.60, outer, 1.09)),
    ]
    tanks = [
        tube([(x, outer - 0.31, 0.70), (x + 1.15, outer - 0.31, 0.70)], 0.29, sides=14)
        for x in (cab.behind - 1.45,)
    ]
    case = box((cab.behind - 0.2, outer - 0.5, 0.42), (cab.behind + 0.1, outer, 0.98))
    lines = [
        tube([(cab.behind - 0.06, y, 1.2), (cab.behind - 0.09, y, 1.9)], 0.02, sides=6)
        for y in (0.2, 0.3, 0.4)
    ]
    mirrored = map(add_mirror_image, (beam, *guards, case))
    return [
        *make_vehicle_parts("black_plastic", *mirrored, walkway, end, *lines),
        *make_vehicle_parts("car_paint_silver", *map(add_mirror_image, tanks)),
        *build_number_plate(blueprint_id, (rear + 0.005, 0.0, 0.84), -1.0),
    ]


def _build_fifth_wheel(x: float) -> list[MeshPart]:
    """Build the plate on which a semi-trailer rests, open behind, and its supports."""
    outline = [(0.42, 0.0), (0.3, 0.38), (-0.1, 0.46), (-0.55, 0.3), (-0.2, 0.0)]
    outline = [(x + along, side) for along, side in outline]
    half_plate = prism(outline, COUPLING_M - 0.06, COUPLING_M - 0.005)
    supports = box((x - 0.15, 0.28, 0.98), (x + 0.15, 0.44, COUPLING_M - 0.05))
    return make_vehicle_parts("metal", *map(add_mirror_image, (half_plate, supports)))
