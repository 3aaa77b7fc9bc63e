"""Builds traffic signs: stop, give way, speed limits, and signs of the Vienna convention."""

from collections.abc import Callable, Sequence

import numpy as np
from advercity_dsl.road import SignKind

from advercity.assets.lettering import WritingPlane, fit_height, write_text
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, join_surfaces, move_surface
from advercity.geometry.primitives import plate, rectangles, tube
from advercity.roads.signals import TrafficSign
from advercity.semantics import Semantic

_SIGN_HEIGHT_M = 2.2
_FACE_M = 0.072
"""Distance of the face of a sign before its mast; text is a little further."""


def build_traffic_sign(sign: TrafficSign, ground_m: float) -> list[MeshPart]:
    """Build a stop or give-way sign on its mast, facing the traffic of its street."""
    x, y = sign.facing
    face = _build_stop_face() if sign.kind == "stop" else _build_yield_face()
    return _mount_on_mast(face, np.array([*sign.position_m, ground_m]), float(np.arctan2(y, x)))


def build_speed_sign(limit_km_h: float, foot: Float64Array, yaw: float) -> list[MeshPart]:
    """Build a speed limit on a mast with its foot at (3,), facing the heading `yaw` in radians."""
    return _mount_on_mast(_build_limit_face(f"{limit_km_h:.0f}"), foot, yaw)


def _mount_on_mast(
    face: list[tuple[TriangleSurface, str]], foot: Float64Array, yaw: float
) -> list[MeshPart]:
    mast = tube([(0, 0, -0.3), (0, 0, _SIGN_HEIGHT_M + 0.2)], 0.035, sides=6)
    parts = [(mast, "metal", Semantic.POLE)]
    parts += [(part, material, Semantic.TRAFFIC_SIGN) for part, material in face]
    return [
        MeshPart(move_surface(part, foot, yaw=yaw), material, semantic)
        for part, material, semantic in parts
    ]


def _build_stop_face() -> list[tuple[TriangleSurface, str]]:
    return [
        (_build_polygon_plate(8, 0.40, 0.04, np.pi / 8), "metal"),
        (_build_polygon_plate(8, 0.40, 0.05, np.pi / 8), "sign_white"),
        (_build_polygon_plate(8, 0.37, 0.06, np.pi / 8), "sign_red"),
        (_write_on_face("STOP", 0.27, 0.62), "sign_white"),
    ]


def _build_yield_face() -> list[tuple[TriangleSurface, str]]:
    return [
        (_build_polygon_plate(3, 0.52, 0.04, -np.pi / 2), "metal"),
        (_build_polygon_plate(3, 0.52, 0.05, -np.pi / 2), "sign_red"),
        (_build_polygon_plate(3, 0.32, 0.06, -np.pi / 2), "sign_white"),
    ]


def _build_limit_face(number: str) -> list[tuple[TriangleSurface, str]]:
    return [
        (_build_polygon_plate(20, 0.36, 0.04, 0.0), "metal"),
        (_build_polygon_plate(20, 0.36, 0.05, 0.0), "sign_red"),
        (_build_polygon_plate(20, 0.285, 0.06, 0.0), "sign_white"),
        (_write_on_face(number, 0.34, 0.47), "black_plastic"),
    ]


def _build_polygon_plate(
    sides: int, radius: float, x: float, turn: float, *, rise: float = 0.0
) -> TriangleSurface:
    """Build a regular polygon with its face at `x`, 1 cm thick, so plates can be stacked."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    z = _SIGN_HEIGHT_M + rise + radius * np.sin(angle)
    return plate(np.column_stack([np.full(sides, x), radius * np.cos(angle), z]), 0.01)


def _write_on_face(text: str, height_m: float, length_m: float) -> TriangleSurface:
    plane = WritingPlane((_FACE_M, 0.0, _SIGN_HEIGHT_M), (0.0, 1.0, 0.0))
    return write_text(text, plane, fit_height(text, height_m, length_m))


def build_sign(kind: SignKind, foot: Float64Array, yaw: float) -> list[MeshPart]:
    """Build a sign on a mast with its foot at (3,), facing the heading `yaw` in radians."""
    return _mount_on_mast(_FACES[kind](), foot, yaw)


def _build_crossing_face() -> list[tuple[TriangleSurface, str]]:
    """Build a blue square with a person on bars in a white triangle."""
    person = [
        ((0.0, 0.14), (0.0, -0.02)),  # trunk, from the neck to the hip
        ((0.0, 0.12), (-0.09, 0.02)),
        ((0.0, 0.12), (0.08, 0.03)),
        ((0.0, -0.02), (-0.08, -0.15)),
        ((0.0, -0.02), (0.07, -0.15)),
    ]
    bars = [((at, -0.16), (1.35 * at, -0.2)) for at in (-0.16, -0.08, 0.0, 0.08, 0.16)]
    head = _build_polygon_plate(8, 0.04, 0.071, 0.0, rise=0.13)
    return [
        (_build_polygon_plate(4, 0.46, 0.04, np.pi / 4), "metal"),
        (_build_polygon_plate(4, 0.45, 0.05, np.pi / 4), "sign_blue"),
        (_build_polygon_plate(3, 0.36, 0.06, np.pi / 2, rise=-0.05), "sign_white"),
        (
            join_surfaces([_build_strokes(person, 0.045, -0.05), head]),
            "black_plastic",
        ),
        (_build_strokes(bars, 0.035, -0.02), "black_plastic"),
    ]


def _build_priority_face() -> list[tuple[TriangleSurface, str]]:
    return [
        (_build_polygon_plate(4, 0.46, 0.04, 0.0), "metal"),
        (_build_polygon_plate(4, 0.46, 0.05, 0.0), "sign_white"),
        (_build_polygon_plate(4, 0.34, 0.06, 0.0), "sign_yellow"),
    ]


def _build_curve_face(towards: int) -> list[tuple[TriangleSurface, str]]:
    """Build a warning of a curve; `towards` is 1 if it turns right, -1 if left."""
    arrow = [
        ((-0.05, -0.12), (-0.05, 0.0)),
        ((-0.05, 0.0), (0.05, 0.1)),
        ((0.05, 0.14), (0.06, 0.04)),
        ((0.06, 0.12), (-0.02, 0.13)),
    ]
    turned = [((towards * y0, z0), (towards * y1, z1)) for (y0, z0), (y1, z1) in arrow]
    return [
        (_build_polygon_plate(3, 0.54, 0.04, np.pi / 2), "metal"),
        (_build_polygon_plate(3, 0.54, 0.05, np.pi / 2), "sign_red"),
        (_build_polygon_plate(3, 0.38, 0.06, np.pi / 2), "sign_white"),
        (_build_strokes(turned, 0.05, -0.02), "black_plastic"),
    ]


_FACES: dict[SignKind, Callable[[], list[tuple[TriangleSurface, str]]]] = {
    SignKind.PEDESTRIAN_CROSSING: _build_crossing_face,
    SignKind.PRIORITY_ROAD: _build_priority_face,
    SignKind.CURVE_LEFT: lambda: _build_curve_face(-1),
    SignKind.CURVE_RIGHT: lambda: _build_curve_face(1),
}


def _build_strokes(
    lines: Sequence[tuple[tuple[float, float], tuple[float, float]]], width_m: float, rise: float
) -> TriangleSurface:
    """Build strokes from y, z to y, z of a face, `rise` above its middle."""
    ends = np.array(lines)
    middle, run = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(run, axis=1, keepdims=True)
    zero = np.zeros(len(run))
    y, z = run.T / 2
    across, upward = np.column_stack([zero, y, z]), np.column_stack([zero, -z, y])
    return rectangles(
        np.column_stack([zero + 0.075, middle[:, 0], middle[:, 1] + _SIGN_HEIGHT_M + rise]),
        across,
        upward / length * width_m,
    )
