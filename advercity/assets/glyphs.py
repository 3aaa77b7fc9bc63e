"""Capital letters and digits as outlines, with strokes of one thickness as on road signs.

Proportions follow DIN 1451: strokes are a seventh of the height, a usual letter is half as wide as
high, round letters are straight sides with half circles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import shapely

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    TriangleSurface,
    extract_polygons,
    join_surfaces,
    triangulate_polygon,
)

STROKE = 1 / 7
"""Thickness of strokes; all lengths are in heights of a capital letter."""
SPACE = 0.22
"""Gap between two letters."""
_WIDTH = 0.36
_NARROW, _WIDE = 0.0, 0.56
_ARC_STEP_DEG = 22.5

_Line = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Glyph:
    """A character from its lower left corner.

    Attributes:
        surface: To the right along x and upward along y; None of a space.
        width: To its right edge.
    """

    surface: TriangleSurface | None
    width: float


def _arc(
    x: float, y: float, start_deg: float, end_deg: float, rise: float = 0.21, run: float = 0.5
) -> list[tuple[float, float]]:
    """List points of an arc of an ellipse around (x, y)."""
    count = round(abs(end_deg - start_deg) / _ARC_STEP_DEG) + 1
    angles = np.radians(np.linspace(start_deg, end_deg, count))
    return [(x + run * float(np.cos(a)), y + rise * float(np.sin(a))) for a in angles]


def _list_lines() -> dict[str, list[_Line]]:
    """List the middles of strokes in a box of one by one."""
    top, bottom = _arc(0.5, 0.79, 20, 180), _arc(0.5, 0.21, 180, 340)
    ring = [*_arc(0.5, 0.79, 0, 180), *_arc(0.5, 0.21, 180, 360)]
    half = [*_arc(0.4, 0.7, 90, 0, 0.3, 0.6), *_arc(0.4, 0.3, 0, -90, 0.3, 0.6)]
    stem = [(0.0, 0.0), (0.0, 1.0)]
    bowl = [(0.0, 1.0), *_arc(0.5, 0.745, 90, -90, 0.255), (0.0, 0.49)]
    belly = [(0.0, 0.49), *_arc(0.5, 0.245, 90, -90, 0.245), (0.0, 0.0)]
    return {
        " ": [],
        "A": [[(0, 0), (0.5, 1), (1, 0)], [(0.16, 0.3), (0.84, 0.3)]],
        "B": [stem, bowl, belly],
        "C": [[*top, *bottom]],
        "D": [[*stem, *half, (0, 0)]],
        "E": [[(1, 1), (0, 1), (0, 0), (1, 0)], [(0, 0.52), (0.66, 0.52)]],
        "F": [[(1, 1), (0, 1), (0, 0)], [(0, 0.52), (0.66, 0.52)]],
        "G": [[*top, *_arc(0.5, 0.21, 180, 360), (1, 0.46), (0.55, 0.46)]],
        "H": [stem, [(1, 0), (1, 1)], [(0, 0.52), (1, 0.52)]],
        "I": [[(0, 0), (0, 1)]],
        "J": [[(1, 1), *_arc(0.5, 0.21, 0, -160)]],
        "K": [stem, [(1, 1), (0, 0.38)], [(0.35, 0.6), (1, 0)]],
        "L": [[(0, 1), (0, 0), (1, 0)]],
        "M": [[(0, 0), (0, 1), (0.5, 0.4), (1, 1), (1, 0)]],
        "N": [[(0, 0), (0, 1), (1, 0), (1, 1)]],
        "O": [[*ring, ring[0]]],
        "P": [stem, bowl],
        "Q": [[*ring, ring[0]], [(0.55, 0.25), (1, -0.04)]],
        "R": [stem, bowl, [(0.5, 0.49), (1, 0)]],
        "S": [[*_arc(0.5, 0.755, 25, 270, 0.245), *_arc(0.5, 0.255, 90, -155, 0.255)]],
        "T": [[(0, 1), (1, 1)], [(0.5, 1), (0.5, 0)]],
        "U": [[(0, 1), *_arc(0.5, 0.21, 180, 360), (1, 1)]],
        "V": [[(0, 1), (0.5, 0), (1, 1)]],
        "W": [[(0, 1), (0.25, 0), (0.5, 0.85), (0.75, 0), (1, 1)]],
        "X": [[(0, 0), (1, 1)], [(0, 1), (1, 0)]],
        "Y": [[(0, 1), (0.5, 0.45), (1, 1)], [(0.5, 0.45), (0.5, 0)]],
        "Z": [[(0, 1), (1, 1), (0, 0), (1, 0)]],
        "0": [[*ring, ring[0]]],
        "1": [[(0, 0.72), (1, 1), (1, 0)]],
        "2": [[*_arc(0.5, 0.73, 160, -30, 0.27), (0, 0), (1, 0)]],
        "3": [[*_arc(0.5, 0.755, 155, -90, 0.245), *_arc(0.5, 0.255, 90, -155, 0.255)]],
        "4": [[(0.6, 1), (0, 0.28), (1, 0.28)], [(0.72, 0.55), (0.72, 0)]],
        "5": [[(0.9, 1), (0.12, 1), (0.08, 0.56), *_arc(0.5, 0.3, 120, -150, 0.3)]],
        "6": [[*_arc(0.5, 0.3, 0, 360, 0.3)], [(0.72, 1), (0.03, 0.4)]],
        "7": [[(0, 1), (1, 1), (0.35, 0)]],
        "8": [_arc(0.5, 0.765, 0, 360, 0.235, 0.44), _arc(0.5, 0.265, 0, 360, 0.265)],
        "9": [[*_arc(0.5, 0.7, 0, 360, 0.3)], [(0.28, 0), (0.97, 0.6)]],
    }


_LINES = _list_lines()
_WIDTHS = {"I": _NARROW, "M": _WIDE, "W": _WIDE, "A": 0.42, "V": 0.42, "1": 0.19}
CHARACTERS = frozenset(_LINES)


@cache
def build_glyph(character: str) -> Glyph:
    """Build one of `CHARACTERS`."""
    width = _WIDTHS.get(character, _WIDTH)
    size = np.array([width, 1.0 - STROKE])
    strokes = [_draw_stroke(np.asarray(line) * size + STROKE / 2) for line in _LINES[character]]
    # Oblique ends and sharp corners are cut off level.
    outline = shapely.union_all(strokes).intersection(shapely.box(-1.0, 0.0, 2.0, 1.0))
    pieces = [triangulate_polygon(part) for part in extract_polygons(outline)]
    flat = [TriangleSurface(np.pad(corners, ((0, 0), (0, 1))), found) for corners, found in pieces]
    return Glyph(join_surfaces(flat) if flat else None, width + STROKE)


def _draw_stroke(line: Float64Array) -> shapely.Geometry:
    is_closed = np.allclose(line[0], line[-1])
    middle = shapely.LinearRing(line[:-1]) if is_closed else shapely.LineString(line)
    return middle.buffer(STROKE / 2, cap_style="square", join_style="mitre", mitre_limit=3.0)
