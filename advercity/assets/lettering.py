"""Writes capital letters and digits on surfaces, such as registrations and names of shops."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.glyphs import SPACE, build_glyph
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.mesh import MeshPart, TriangleSurface, join_surfaces, xyz
from advercity.geometry.primitives import plate
from advercity.randomness import create_generator

PLATE_SIZE_M = (0.52, 0.11)
PLATE_TEXT_HEIGHT_M = 0.075
PLATE_THICKNESS_M = 0.02
LIFT_M = 0.003
"""Distance of text from the surface behind it."""

LETTERS, DIGITS = "ABCDEFGHJKLMNPRSTUVWXYZ", "0123456789"
"""Characters of registrations, without I, O and Q, which resemble digits."""


@dataclass(frozen=True)
class WritingPlane:
    """Place of a text.

    Attributes:
        middle: Middle of the text (3,), metres.
        right: Unit vector (3,) along the line, as seen from in front.
        up: Unit vector (3,) towards the top of characters.
    """

    middle: ArrayLike
    right: ArrayLike
    up: ArrayLike = (0.0, 0.0, 1.0)


def write_text(text: str, plane: WritingPlane, height_m: float) -> TriangleSurface:
    """Write a text of `glyphs.CHARACTERS`, centred."""
    right, up = (np.asarray(axis, dtype=np.float64) for axis in (plane.right, plane.up))
    facing = np.cross(right, up)
    start = np.asarray(plane.middle) + LIFT_M * facing - height_m * up / 2
    edge_m = -measure_text(text, height_m) / 2
    written: list[TriangleSurface] = []
    for glyph in map(build_glyph, text):
        if glyph.surface is not None:
            x, y, _ = height_m * glyph.surface.vertices.T
            corners = start + np.outer(edge_m + x, right) + np.outer(y, up)
            normals = np.broadcast_to(facing, corners.shape)
            written.append(TriangleSurface(corners, glyph.surface.triangles, normals))
        edge_m += height_m * (glyph.width + SPACE)
    return replace(join_surfaces(written), is_writing=True)


def measure_text(text: str, height_m: float) -> float:
    """Measure the length of a text, metres."""
    return height_m * (sum(build_glyph(one).width + SPACE for one in text) - SPACE)


def fit_height(text: str, height_m: float, length_m: float) -> float:
    """Compute the height up to `height_m` at which a text is no longer than `length_m`."""
    return min(height_m, length_m / measure_text(text, 1.0))


def build_number_plate(blueprint_id: str, middle: ArrayLike, facing: float) -> list[MeshPart]:
    """Build a number plate whose face has its middle at (3,), towards x times `facing`.

    Its registration is fictional, and the same on all vehicles of a blueprint.
    """
    right = xyz(0, facing, 0)
    half, rise = PLATE_SIZE_M[0] / 2 * right, xyz(z=PLATE_SIZE_M[1] / 2)
    face = np.asarray(middle, dtype=np.float64)
    corners = [face - half - rise, face + half - rise, face + half + rise, face - half + rise]
    text = write_text(
        _draw_registration(blueprint_id), WritingPlane(face, right), PLATE_TEXT_HEIGHT_M
    )
    return [
        *make_vehicle_parts("licence_plate", plate(corners, PLATE_THICKNESS_M)),
        *make_vehicle_parts("car_paint_black", text),
    ]


def _draw_registration(blueprint_id: str) -> str:
    generator = create_generator("registration", blueprint_id)
    letters = generator.choice(list(LETTERS), 2)
    digits = generator.choice(list(DIGITS), 4)
    return f"{''.join(letters)} {''.join(digits)}"
