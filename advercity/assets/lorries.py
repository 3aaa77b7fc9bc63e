"""Builds articulated lorries: the tractor unit, and the semi-trailer that it tows.

Lengths of the catalogue's are those of Directive 96/53/EC, Annex I. Heights are usual ones.
"""

import numpy as np
from advercity_dsl.catalogue import FifthWheel, SemiTrailer

from advercity.assets.cargo_boxes import (
    CargoBox,
    build_cargo_doors,
    build_cargo_frame,
    write_haulier,
)
from advercity.assets.lettering import build_number_plate
from advercity.assets.trucks import CabPlace, build_cab, build_rear_lamps
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
from advercity.frames import WHEELBASE_FRACTION
from advercity.geometry.mesh import (
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
)
from advercity.geometry.primitives import box, loft_rings, prism, rectangles, tube
from advercity.materials import ACTOR_PAINT

_COUPLING_M = 1.17
"""Height of the upper side of a fifth wheel, and of the lower one of the semi-trailer over it."""
_CAB_LENGTH_M, _CAB_ROOF_RATIO = 2.3, 0.955
_MIRROR_M = 0.14
"""What a mirror adds to half of the width."""
_TRACTOR_WHEEL_M, _TRAILER_WHEEL_M = 0.50, 0.52
_AXLE_SPACING_M = 1.31
"""Distance of a semi-trailer's axles, three of which may then carry 24 t (96/53/EC, Annex I)."""
_LEGS_BEHIND_KINGPIN_M = 2.55
"""Beyond the circle in which the rear of a tractor unit swings, of 2.1 m."""
_STRAP_SPACING_M = 0.62


def build_tractor(blueprint_id: str, size: Size, coupling: FifthWheel) -> list[MeshPart]:
    """Build a tractor unit of about `size`; its rear lamps are those of the semi-trailer."""
    length, width, height = size
    front, half = length / 2, width / 2 - _MIRROR_M
    axle = WHEELBASE_FRACTION * length / 2
    behind, roof = front - _CAB_LENGTH_M, _CAB_ROOF_RATIO * height
    cab = CabPlace(front, behind, half, roof, width, axle, _TRACTOR_WHEEL_M)
    return [
        *build_cab(blueprint_id, cab, ACTOR_PAINT),
        *make_vehicle_parts(ACTOR_PAINT, _build_deflector(cab, height)),
        *_build_tractor_frame(blueprint_id, size, cab),
        *_build_fifth_wheel(front - coupling.behind_front_m),
        *build_axle(axle, half - 0.01, _TRACTOR_WHEEL_M, 0.32, is_steered=True),
        *build_axle(-axle, half - 0.02, _TRACTOR_WHEEL_M, 0.58),
    ]


def _build_deflector(cab: CabPlace, height: float) -> TriangleSurface:
    """Build the shield on a cab's roof that leads air over the semi-trailer."""
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
    half_plate = prism(outline, _COUPLING_M - 0.06, _COUPLING_M - 0.005)
    supports = box((x - 0.15, 0.28, 0.98), (x + 0.15, 0.44, _COUPLING_M - 0.05))
    return make_vehicle_parts("metal", *map(add_mirror_image, (half_plate, supports)))


def build_semitrailer(blueprint_id: str, size: Size, running: SemiTrailer) -> list[MeshPart]:
    """Build a curtain-sided semi-trailer of about `size` with three axles."""
    length, width, height = size
    cargo = CargoBox(-length / 2 + 0.05, length / 2 - 0.012, width / 2 - 0.022, _COUPLING_M, height)
    kingpin = length / 2 - running.kingpin_m
    middle = kingpin - running.wheelbase_m
    axles = [middle + step * _AXLE_SPACING_M for step in (1, 0, -1)]
    walls = box((cargo.rear, -cargo.side, cargo.low), (cargo.front, cargo.side, height))
    wheels = [
        part for x in axles for part in build_axle(x, cargo.side - 0.01, _TRAILER_WHEEL_M, 0.385)
    ]
    return [
        *make_vehicle_parts("car_paint_white", walls),
        *_build_curtains(blueprint_id, cargo),
        *build_cargo_frame(cargo),
        *build_cargo_doors(cargo),
        *_build_trailer_frame(cargo, kingpin, axles),
        *_build_side_guards(cargo.side, axles[0] + 0.75, kingpin - _LEGS_BEHIND_KINGPIN_M - 0.3),
        *_build_trailer_rear(blueprint_id, cargo),
        *wheels,
    ]


def _build_curtains(blueprint_id: str, cargo: CargoBox) -> list[MeshPart]:
    """Build the curtains with straps and the haulier's name, and the markings along the flanks."""
    begin, end, out = cargo.rear + 0.12, cargo.front - 0.12, cargo.side + 0.006
    low, high = cargo.low + 0.13, cargo.high - 0.07
    curtains = box((begin, -out, low), (end, out, high))
    stations = np.arange(begin + 0.3, end, _STRAP_SPACING_M)
    straps = [(x, out + 0.014, (low + high) / 2) for x in stations]
    ends = [(x, out + 0.015, low - 0.05) for x in stations]
    strap = rectangles(straps, (-0.02, 0, 0), (0, 0, (high - low) / 2))
    buckles = rectangles(ends, (-0.025, 0, 0), (0, 0, 0.09))
    # UN Regulation 104 has a white or yellow line along at least 80 % of a flank.
    dashes = [(x, out + 0.015, cargo.low + 0.06) for x in np.arange(begin + 0.4, end - 0.36, 0.8)]
    line = rectangles(dashes, (-0.36, 0, 0), (0, 0, 0.025))
    return [
        *make_vehicle_parts(ACTOR_PAINT, curtains),
        *make_vehicle_parts("black_plastic", *map(add_mirror_image, (strap, buckles))),
        *make_vehicle_parts("sign_white", add_mirror_image(line)),
        *write_haulier(
            blueprint_id,
            ((begin + end) / 2, out + 0.005, cargo.low + 1.5),
            0.7 * (end - begin),
            0.9,
        ),
    ]


def _build_trailer_frame(cargo: CargoBox, kingpin: float, axles: list[float]) -> list[MeshPart]:
    """Build beams, kingpin, landing legs, axle beams and mudguards."""
    legs = kingpin - _LEGS_BEHIND_KINGPIN_M
    low, outer = _COUPLING_M, cargo.side - 0.02
    beam = box((cargo.rear + 0.1, 0.42, low - 0.34), (legs + 0.3, 0.56, low))
    neck = box((legs + 0.3, 0.42, low - 0.03), (kingpin + 0.7, 0.56, low))
    leg = box((legs - 0.07, 0.72, 0.46), (legs + 0.07, 0.86, low))
    foot = box((legs - 0.14, 0.66, 0.42), (legs + 0.14, 0.92, 0.46))
    brace = tube([(legs, -0.8, 0.8), (legs, 0.8, 0.8)], 0.035, sides=6)
    pin = tube([(kingpin, 0, low - 0.08), (kingpin, 0, low)], 0.045, sides=8)
    beams = [
        tube(
            [(x, -outer + 0.3, _TRAILER_WHEEL_M), (x, outer - 0.3, _TRAILER_WHEEL_M)], 0.07, sides=8
        )
        for x in axles
    ]
    first, last = axles[0] + 0.62, axles[-1] - 0.62
    guard = box((last, outer - 0.40, 1.08), (first, outer, 1.11))
    flap = box((last - 0.03, outer - 0.40, 0.30), (last, outer, 1.10))
    mirrored = map(add_mirror_image, (beam, neck, leg, foot, guard, flap))
    return make_vehicle_parts("black_plastic", *mirrored, brace, pin, *beams)


def _build_side_guards(side: float, rear: float, front: float) -> list[MeshPart]:
    """Build the rails of UN Regulation 73 before the wheels, with reflectors at the side."""
    out = side - 0.02
    rails = [box((rear, out - 0.03, z), (front, out, z + 0.1)) for z in (0.5, 0.86)]
    posts = [
        box((x, out - 0.07, 0.5), (x + 0.05, out - 0.03, _COUPLING_M))
        for x in np.linspace(rear + 0.1, front - 0.15, 4)
    ]
    places = [(x, out + 0.004, 0.91) for x in np.linspace(rear + 0.2, front - 0.2, 3)]
    reflectors = rectangles(places, (-0.05, 0, 0), (0, 0, 0.025))
    return [
        *make_vehicle_parts("car_paint_silver", *map(add_mirror_image, (*rails, *posts))),
        *make_vehicle_parts("sign_yellow", add_mirror_image(reflectors)),
    ]


def _build_trailer_rear(blueprint_id: str, cargo: CargoBox) -> list[MeshPart]:
    """Build the lamps on their carrier, and the bar of UN Regulation 58 against running under."""
    rear, half = cargo.rear, cargo.side
    carrier = box((rear + 0.01, -half + 0.03, 0.78), (rear + 0.08, half - 0.03, 1.02))
    bar = box((rear + 0.02, -half + 0.06, 0.44), (rear + 0.12, half - 0.06, 0.56))
    holder = box((rear + 0.06, 0.42, 0.5), (rear + 0.12, 0.56, _COUPLING_M))
    return [
        *make_vehicle_parts("black_plastic", carrier, bar, add_mirror_image(holder)),
        *build_rear_lamps(blueprint_id, rear, half, 0.82),
    ]
