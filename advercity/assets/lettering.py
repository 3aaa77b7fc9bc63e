"""Writes letters and digits on bodies, such as registrations, as strokes of flat rectangles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.mesh import MeshPart, TriangleSurface, xyz
from advercity.geometry.primitives import plate, rectangles
from advercity.randomness import create_generator

WIDTH_FRACTION, PITCH_FRACTION, STROKE_FRACTION = 0.5, 0.72, 0.14
"""Width of a character, distance to the next and thickness of strokes, in heights."""
PLATE_SIZE_M = (0.52, 0.11)
PLATE_TEXT_HEIGHT_M = 0.075
PLATE_THICKNESS_M = 0.02
STROKE_LIFT_M = 0.003
"""Distance of strokes from what they are on."""

# Strokes of a display of seven segments: centre and half size in half widths and half heights.
_STROKES: dict[str, tuple[float, float, bool]] = {
    "a": (0, 1, True),
    "b": (1, 0.5, False),
    "c": (1, -0.5, False),
    "d": (0, -1, True),
    "e": (-1, -0.5, False),
    "f": (-1, 0.5, False),
    "g": (0, 0, True),
}
_CHARACTERS = {
    "0": "abcdef", "1": "bc", "2": "abged", "3": "abgcd", "4": "fgbc",
    "5": "afgcd", "6": "afgedc", "7": "abc", "8": "abcdefg", "9": "abcdfg",
    "A": "abcefg", "C": "adef", "E": "adefg", "F": "aefg", "H": "bcefg",
    "J": "bcde", "L": "def", "P": "abefg", "U": "bcdef", "Y": "bcdfg",
    "B": "abcdefg", "G": "acdef", "I": "ef", "O": "abcdef", "S": "acdfg",
}  # fmt: skip
LETTERS, DIGITS = "ACEFHJLPUY", "0123456789"


@dataclass(frozen=True)
class WritingPlane:
    """Where text is written.

    Attributes:
        middle: Middle of the text (3,), metres.
        right: Unit vector (3,) along the line, as seen from in front.
        up: Unit vector (3,) towards the top of characters.
    """

    middle: ArrayLike
    right: ArrayLike
    up: ArrayLike = (0.0, 0.0, 1.0)


def write_text(text: str, plane: WritingPlane, height_m: float) -> TriangleSurface:
    """Write text, centred; of `LETTERS`, B, G, I, O, S, `DIGITS` and spaces."""
    right, up = (np.asarray(axis, dtype=np.float64) for axis in (plane.right, plane.up))
    half = height_m * np.array([WIDTH_FRACTION, 1.0]) / 2
    thick = STROKE_FRACTION * height_m / 2
    first = -(len(text) - 1) / 2
    places: list[tuple[float, float]] = []
    sizes: list[tuple[float, float]] = []
    for number, character in enumerate(text):
        column = (first + number) * PITCH_FRACTION * height_m
        for stroke in _CHARACTERS.get(character, ""):
            x, y, is_level = _STROKES[stroke]
            places.append((column + x * (half[0] - thick), y * (half[1] - thick)))
            sizes.append((half[0], thick) if is_level else (thick, half[1] / 2))
    origin = np.asarray(plane.middle) + STROKE_LIFT_M * np.cross(right, up)
    across, upward = np.array(places).T
    return rectangles(
        origin + np.outer(across, right) + np.outer(upward, up),
        np.outer([width for width, _ in sizes], right),
        np.outer([rise for _, rise in sizes], up),
    )


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
