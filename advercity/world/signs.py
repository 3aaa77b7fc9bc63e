"""Traffic signs: stop, give way, speed limits."""

import numpy as np

from advercity.semantics import Semantic
from advercity.world.built_road import PostedSign
from advercity.world.shapes import Floats, Piece, Surface, moved, panels, plate, tube

_SIGN_HEIGHT_M = 2.2


def posted_sign(sign: PostedSign, ground_m: float) -> list[Piece]:
    """A stop or give-way sign on its mast, facing the traffic that comes along its street."""
    x, y = sign.facing
    face = _stop_face() if sign.kind == "stop" else _yield_face()
    return _on_mast(face, np.array([*sign.at_m, ground_m]), float(np.arctan2(y, x)))


def speed_sign(limit_km_h: float, foot: Floats, yaw: float) -> list[Piece]:
    """A speed limit on its mast, whose foot is at (3,), facing the heading `yaw` in radians."""
    return _on_mast(_limit_face(f"{limit_km_h:.0f}"), foot, yaw)


def _on_mast(face: list[tuple[Surface, str]], foot: Floats, yaw: float) -> list[Piece]:
    mast = tube([(0, 0, -0.3), (0, 0, _SIGN_HEIGHT_M + 0.2)], 0.035, sides=6)
    parts = [(mast, "metal", Semantic.POLE)]
    parts += [(part, material, Semantic.TRAFFIC_SIGN) for part, material in face]
    return [
        Piece(moved(part, foot, yaw=yaw), material, semantic) for part, material, semantic in parts
    ]


def _stop_face() -> list[tuple[Surface, str]]:
    letters = _letters("STOP", np.array([0.075, 0.0, _SIGN_HEIGHT_M]), width_m=0.115, height_m=0.24)
    return [
        (_polygon(8, 0.40, 0.04, np.pi / 8), "metal"),
        (_polygon(8, 0.40, 0.05, np.pi / 8), "paint_white"),
        (_polygon(8, 0.37, 0.06, np.pi / 8), "sign_red"),
        (letters, "paint_white"),
    ]


def _yield_face() -> list[tuple[Surface, str]]:
    return [
        (_polygon(3, 0.52, 0.04, -np.pi / 2), "metal"),
        (_polygon(3, 0.52, 0.05, -np.pi / 2), "sign_red"),
        (_polygon(3, 0.32, 0.06, -np.pi / 2), "paint_white"),
    ]


def _limit_face(number: str) -> list[tuple[Surface, str]]:
    size = {"width_m": 0.17 if len(number) < 3 else 0.12, "height_m": 0.34}
    return [
        (_polygon(20, 0.36, 0.04, 0.0), "metal"),
        (_polygon(20, 0.36, 0.05, 0.0), "sign_red"),
        (_polygon(20, 0.285, 0.06, 0.0), "paint_white"),
        (_letters(number, np.array([0.075, 0.0, _SIGN_HEIGHT_M]), **size), "black_plastic"),
    ]


def _polygon(sides: int, radius: float, x: float, turn: float) -> Surface:
    """A plate with its face at `x`; 1 cm of it shows behind the next."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    corners = [
        np.full(sides, x),
        radius * np.cos(angle),
        _SIGN_HEIGHT_M + radius * np.sin(angle),
    ]
    return plate(np.column_stack(corners), 0.01)


_SEGMENTS = {
    "a": (0, 2, 1, 2),
    "b": (1, 1, 1, 2),
    "c": (1, 0, 1, 1),
    "d": (0, 0, 1, 0),
    "e": (0, 0, 0, 1),
    "f": (0, 1, 0, 2),
    "g": (0, 1, 1, 1),
}
_DIGITS = (
    "abcdef",
    "bc",
    "abged",
    "abgcd",
    "fgbc",
    "afgcd",
    "afgedc",
    "abc",
    "abcdefg",
    "abcfgd",
)
"""Which of seven segments are lit, from 0 to 9."""
_STROKES = {
    "S": ((0, 2, 1, 2), (0, 1, 0, 2), (0, 1, 1, 1), (1, 0, 1, 1), (0, 0, 1, 0)),
    "T": ((0, 2, 1, 2), (0.5, 0, 0.5, 2)),
    "O": ((0, 0, 0, 2), (1, 0, 1, 2), (0, 0, 1, 0), (0, 2, 1, 2)),
    **{str(digit): tuple(_SEGMENTS[name] for name in lit) for digit, lit in enumerate(_DIGITS)},
    "P": ((0, 0, 0, 2), (0, 2, 1, 2), (0, 1, 1, 1), (1, 1, 1, 2)),
}
"""Strokes of letters on a grid one wide and two high: from x, z to x, z."""


def _letters(text: str, middle: Floats, *, width_m: float, height_m: float) -> Surface:
    """Flat letters that look along x and so read from -y to +y."""
    half_stroke = 0.02
    strokes = [
        (*stroke, index - (len(text) - 1) / 2)
        for index, letter in enumerate(text)
        for stroke in _STROKES[letter]
    ]
    x0, z0, x1, z1, column = np.array(strokes).T
    y = 1.42 * width_m * column + width_m * ((x0 + x1) / 2 - 0.5)
    z = height_m * ((z0 + z1) / 4 - 0.5)
    across = width_m * np.abs(x1 - x0) / 2 + half_stroke
    upward = height_m * np.abs(z1 - z0) / 4 + half_stroke
    zero = np.zeros(len(y))
    return panels(
        middle + np.column_stack([zero, y, z]),
        np.column_stack([zero, across, zero]),
        np.column_stack([zero, zero, upward]),
    )
