"""Builds semi-trailers: curtain-sided and refrigerated ones, each of several hauliers.

Lengths in the catalogue are from Directive 96/53/EC, Annex I. Heights are usual ones.
"""

import numpy as np
from advercity_dsl.catalogue import SemiTrailer

from advercity.assets.cargo_boxes import (
    CargoBox,
    Haulier,
    build_cargo_doors,
    build_cargo_frame,
    draw_hauliers,
    write_haulier,
)
from advercity.assets.lorries import COUPLING_M
from advercity.assets.truck_wheels import build_truck_axle
from advercity.assets.trucks import build_rear_lamps
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.mesh import MeshPart, Size, add_mirror_image
from advercity.geometry.primitives import box, loft_rings, rectangles, tube
from advercity.materials import ACTOR_PAINT

HAULIERS_OF_A_BLUEPRINT = 3
_WHEEL_M = 0.52
_AXLE_SPACING_M = 1.31
"""Distance of a semi-trailer's axles, three of which may then carry 24 t (96/53/EC, Annex I)."""
_LEGS_BEHIND_KINGPIN_M = 2.55
"""Distance beyond the 2.1 m swing circle of a tractor unit's rear."""
_STRAP_SPACING_M = 0.62
_COOLER_M = 0.42
"""Depth of the refrigeration unit, at the front."""


def build_semitrailers(blueprint_id: str, size: Size, running: SemiTrailer) -> list[list[MeshPart]]:
    """Build the semi-trailers of a blueprint, of about `size`: one of each of its hauliers."""
    hauliers = draw_hauliers(blueprint_id, HAULIERS_OF_A_BLUEPRINT)
    return [_build_semitrailer(haulier, blueprint_id, size, running) for haulier in hauliers]


def _build_semitrailer(
    haulier: Haulier, blueprint_id: str, size: Size, running: SemiTrailer
) -> list[MeshPart]:
    length, width, height = size
    is_cooled = running.body == "refrigerated"
    front = length / 2 - (_COOLER_M if is_cooled else 0.012)
    cargo = CargoBox(-length / 2 + 0.05, front, width / 2 - 0.022, COUPLING_M, height)
    kingpin = length / 2 - running.kingpin_m
    middle = kingpin - running.wheelbase_m
    axles = [middle + step * _AXLE_SPACING_M for step in (1, 0, -1)]
    build_sides = _build_cooled_body if is_cooled else _build_curtains
    walls = box((cargo.rear, -cargo.side, cargo.low), (cargo.front, cargo.side, height))
    wheels = [
        part for x in axles for part in build_truck_axle(x, cargo.side - 0.01, _WHEEL_M, 0.385)
    ]
    return [
        *make_vehicle_parts("car_paint_white", walls),
        *build_sides(haulier.name, cargo),
        *build_cargo_frame(cargo),
        *build_cargo_doors(haulier._replace(paint=ACTOR_PAINT), cargo),
        *_build_trailer_frame(cargo, kingpin, axles),
        *_build_side_guards(cargo.side, axles[0] + 0.75, kingpin - _LEGS_BEHIND_KINGPIN_M - 0.3),
        *_build_trailer_rear(blueprint_id, cargo),
        *wheels,
    ]


def _build_cooled_body(name: str, cargo: CargoBox) -> list[MeshPart]:
    """Build the refrigeration unit, and the haulier's name on a slanted field of paint."""
    front, high = cargo.front, cargo.high - 0.25
    unit = box((front, -0.95, 1.9), (front + _COOLER_M - 0.01, 0.95, high))
    grilles = [
        box((front + 0.3, -0.8, z), (front + _COOLER_M, 0.8, z + 0.5)) for z in (2.1, high - 0.75)
    ]
    out, low = cargo.side + 0.006, cargo.low + 0.75
    begin, end, slant = cargo.rear + 1.2, front - 1.6, 0.8
    outline = [(begin, low), (end, low), (end + slant, low + 1.5), (begin + slant, low + 1.5)]
    field = loft_rings([[(x, y, z) for x, z in outline] for y in (-out, out)])
    place = ((begin + end + slant) / 2, out, low + 0.75)
    return [
        *make_vehicle_parts("car_paint_silver", unit),
        *make_vehicle_parts("black_plastic", *grilles),
        *make_vehicle_parts(ACTOR_PAINT, field),
        *_build_flank_marking(cargo, (cargo.rear + 0.3, front - 0.3)),
        *write_haulier(name, place, 0.8 * (end - begin), 0.9),
    ]


def _build_flank_marking(cargo: CargoBox, ends: tuple[float, float]) -> list[MeshPart]:
    """Build the line of UN Regulation 104, white or yellow, along at least 80 % of a flank."""
    begin, end = ends
    places = [(x, cargo.side + 0.021, cargo.low + 0.06) for x in np.arange(begin + 0.4, end, 0.8)]
    line = rectangles(places, (-0.36, 0, 0), (0, 0, 0.025))
    return make_vehicle_parts("sign_white", add_mirror_image(line))


def _build_curtains(name: str, cargo: CargoBox) -> list[MeshPart]:
    """Build the curtains with straps and the haulier's name, and the markings along the flanks."""
    begin, end, out = cargo.rear + 0.12, cargo.front - 0.12, cargo.side + 0.006
    low, high = cargo.low + 0.13, cargo.high - 0.07
    curtains = box((begin, -out, low), (end, out, high))
    stations = np.arange(begin + 0.3, end, _STRAP_SPACING_M)
    straps = [(x, out + 0.014, (low + high) / 2) for x in stations]
    ends = [(x, out + 0.015, low - 0.05) for x in stations]
    strap = rectangles(straps, (-0.02, 0, 0), (0, 0, (high - low) / 2))
    buckles = rectangles(ends, (-0.025, 0, 0), (0, 0, 0.09))
    return [
        *make_vehicle_parts(ACTOR_PAINT, curtains),
        *make_vehicle_parts("black_plastic", *map(add_mirror_image, (strap, buckles))),
        *_build_flank_marking(cargo, (begin, end - 0.36)),
        *write_haulier(
            name,
            ((begin + end) / 2, out + 0.005, cargo.low + 1.5),
            0.7 * (end - begin),
            0.9,
        ),
    ]


def _build_trailer_frame(cargo: CargoBox, kingpin: float, axles: list[float]) -> list[MeshPart]:
    """Build beams, kingpin, landing legs, axle beams and mudguards."""
    legs = kingpin - _LEGS_BEHIND_KINGPIN_M
    low, outer = COUPLING_M, cargo.side - 0.02
    beam = box((cargo.rear + 0.1, 0.42, low - 0.34), (legs + 0.3, 0.56, low))
    neck = box((legs + 0.3, 0.42, low - 0.03), (kingpin + 0.7, 0.56, low))
    leg = box((legs - 0.07, 0.72, 0.46), (legs + 0.07, 0.86, low))
    foot = box((legs - 0.14, 0.66, 0.42), (legs + 0.14, 0.92, 0.46))
    brace = tube([(legs, -0.8, 0.8), (legs, 0.8, 0.8)], 0.035, sides=6)
    pin = tube([(kingpin, 0, low - 0.08), (kingpin, 0, low)], 0.045, sides=8)
    beams = [
        tube([(x, -outer + 0.3, _WHEEL_M), (x, outer - 0.3, _WHEEL_M)], 0.07, sides=8)
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
        box((x, out - 0.07, 0.5), (x + 0.05, out - 0.03, COUPLING_M))
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
    holder = box((rear + 0.06, 0.42, 0.5), (rear + 0.12, 0.56, COUPLING_M))
    return [
        *make_vehicle_parts("black_plastic", carrier, bar, add_mirror_image(holder)),
        *build_rear_lamps(blueprint_id, rear, half, 0.82),
    ]
