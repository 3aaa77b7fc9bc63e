"""Builds the trim of cargo boxes: frames, doors with seals and markings, hauliers' names."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from advercity.assets.lettering import WritingPlane, fit_height, write_text
from advercity.assets.vehicle_parts import make_vehicle_parts, set_layer
from advercity.geometry.mesh import MeshLayer, MeshPart, TriangleSurface, add_mirror_image
from advercity.geometry.primitives import box, rectangles, tube
from advercity.randomness import create_generator


class Haulier(NamedTuple):
    """A fictional haulier: its name, and the paint behind it on white boxes."""

    name: str
    paint: str


_HAULIERS = (
    Haulier("BREAD DAILY", "car_paint_orange"),
    Haulier("FJELL GLASS", "car_paint_navy"),
    Haulier("MOVING HOME", "car_paint_red"),
    Haulier("QUICK PARCELS", "car_paint_blue"),
    Haulier("RIVER PAPER", "car_paint_green"),
    Haulier("SOFA HAUL", "car_paint_wine"),
)
_MIN_CARGO_M3 = 8.0
"""Volume above which a white box of a truck's model is its cargo box."""
_BOX_TRIANGLES = 12


class CargoBox(NamedTuple):
    """Place of a cargo box: x of its ends, half of its width, heights of floor and roof."""

    rear: float
    front: float
    side: float
    low: float
    high: float


def build_model_cargo_trim(blueprint_id: str, parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Build doors, frame and lettering of a truck's model whose cargo box is a plain box."""
    trim: list[MeshPart] = []
    for part in parts:
        vertices = part.surface.vertices
        low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
        is_plain = len(part.surface.triangles) <= _BOX_TRIANGLES
        is_large = np.prod(np.subtract(high, low)) > _MIN_CARGO_M3
        if part.material == "car_paint_white" and is_plain and is_large:
            cargo = CargoBox(low[0], high[0], high[1], low[2], high[2])
            trim += build_cargo_trim(blueprint_id, cargo)
    return trim


def build_cargo_trim(blueprint_id: str, cargo: CargoBox) -> list[MeshPart]:
    """Build the trim of a cargo box: frame, doors, and the haulier's name on a stripe."""
    rear, front, side, low, _ = cargo
    out = side + 0.01
    (haulier,) = draw_hauliers(blueprint_id, 1)
    stripe = box((rear + 0.3, -out, low + 0.5), (front - 0.34, out, low + 0.95))
    return [
        *make_vehicle_parts(haulier.paint, stripe),
        *write_haulier(
            haulier.name,
            ((rear + front - 0.04) / 2, out, low + 0.725),
            0.85 * (front - rear - 0.64),
            0.26,
        ),
        *build_cargo_frame(cargo),
        *build_cargo_doors(haulier, cargo),
    ]


def build_cargo_frame(cargo: CargoBox) -> list[MeshPart]:
    """Build the metal edges of a cargo box, and the rails along its flanks."""
    rear, front, side, low, high = cargo
    out, thick = 0.012, 0.07
    posts = [
        box((x, side - thick, low), (x + thick, side + out, high))
        for x in (rear - out, front - thick + out)
    ]
    rails = [
        box((rear, side - thick, z), (front, side + out, z + depth))
        for z, depth in ((low, 0.12), (high - 0.06, 0.06))
    ]
    lintels = [
        box((x, -side, z), (x + thick, side, z + 0.07))
        for x in (rear - out, front - thick + out)
        for z in (low, high - 0.07)
    ]
    return make_vehicle_parts("metal", *map(add_mirror_image, (*posts, *rails)), *lintels)


def build_cargo_doors(haulier: Haulier, cargo: CargoBox) -> list[MeshPart]:
    """Build two rear doors: seal, locking bars, handles, hinges, markings and a haulier's name."""
    rear, _, side, low, high = cargo
    seals = [
        *_build_outline(rear - 0.006, (side - 0.1, low + 0.12, high - 0.1), 0.05),
        box((rear - 0.006, -0.03, low + 0.1), (rear + 0.02, 0.03, high - 0.1)),
    ]
    # Contour markings of UN Regulation 104.
    markings = _build_outline(rear - 0.016, (side - 0.03, low + 0.04, high - 0.03), 0.05)
    bars = [
        tube([(rear - 0.022, y, low + 0.05), (rear - 0.022, y, high - 0.05)], 0.02, sides=6)
        for y in (0.18, 0.62 * side)
    ]
    handles = [
        box((rear - 0.045, y - 0.02, low + 0.42), (rear - 0.02, y + 0.26, low + 0.46))
        for y in (0.18, 0.62 * side)
    ]
    hinges = [
        box((rear - 0.02, side - 0.16, z), (rear + 0.01, side, z + 0.08))
        for z in np.linspace(low + 0.25, high - 0.35, 4)
    ]
    return [
        *make_vehicle_parts("black_plastic", *seals),
        *make_vehicle_parts("sign_red", *markings),
        *make_vehicle_parts("metal", *map(add_mirror_image, (*bars, *handles, *hinges))),
        *set_layer(MeshLayer.DETAIL, _build_rear_name(haulier, cargo)),
        *set_layer(MeshLayer.DETAIL, _build_marking_plates(cargo)),
    ]


def _build_rear_name(haulier: Haulier, cargo: CargoBox) -> list[MeshPart]:
    """Build a haulier's name on a stripe of paint across the doors, above the cars behind."""
    rear, side, height = cargo.rear - 0.003, cargo.side - 0.16, 0.16 * (cargo.high - cargo.low)
    z = cargo.high - 0.24 - height / 2
    stripe = rectangles([(rear, 0, z)], (0, -side, 0), (0, 0, height / 2))
    text_m = fit_height(haulier.name, 0.6 * height, 1.8 * side)
    text = write_text(haulier.name, WritingPlane((rear, 0, z), (0, -1, 0)), text_m)
    return [
        *make_vehicle_parts(haulier.paint, stripe),
        *make_vehicle_parts("car_paint_white", text),
    ]


def _build_marking_plates(cargo: CargoBox) -> list[MeshPart]:
    """Build the plates of UN Regulation 70 for heavy or long vehicles: yellow in a red frame."""
    places = [(cargo.rear - 0.004, y, cargo.low + 0.26) for y in (-0.68, 0.68)]
    frames = rectangles(places, (0, -0.2825, 0), (0, 0, 0.0975))
    fields = rectangles(np.subtract(places, (0.002, 0, 0)), (0, -0.2425, 0), (0, 0, 0.0575))
    return [
        *make_vehicle_parts("sign_red", frames),
        *make_vehicle_parts("sign_yellow", fields),
    ]


def _build_outline(
    x: float, edges: tuple[float, float, float], wide: float
) -> list[TriangleSurface]:
    """Build a band facing behind, along edges: half its width, its lower and upper height."""
    half, low, high = edges
    uprights = [(x, y, (low + high) / 2) for y in (-half, half)]
    levels = [(x, 0, z) for z in (low, high)]
    return [
        rectangles(uprights, (0, -wide / 2, 0), (0, 0, (high - low) / 2)),
        rectangles(levels, (0, -half, 0), (0, 0, wide / 2)),
    ]


def draw_hauliers(blueprint_id: str, count: int) -> list[Haulier]:
    """Draw different hauliers."""
    order = create_generator("haulier", blueprint_id).permutation(len(_HAULIERS))
    return [_HAULIERS[number] for number in order[:count]]


def write_haulier(
    name: str, place: tuple[float, float, float], length_m: float, height_m: float
) -> list[MeshPart]:
    """Write the name of a haulier on both flanks, no longer or higher than a size.

    Args:
        name: The text.
        place: Middle of the name on the left flank (3,).
        length_m: Maximum length.
        height_m: Maximum height.
    """
    x, side, z = place
    height_m = fit_height(name, height_m, length_m)
    texts = [
        write_text(name, WritingPlane((x, sign * side, z), (-sign, 0, 0)), height_m)
        for sign in (1.0, -1.0)
    ]
    return make_vehicle_parts("car_paint_white", *texts)
