"""Builds distant towns: blocks with bands of windows, and roofs."""

from collections.abc import Iterator

import numpy as np

from advercity.geometry.mesh import MeshPart, TriangleSurface, join_surfaces, move_surface
from advercity.geometry.primitives import box, rectangles
from advercity.randomness import create_generator
from advercity.scene.buildings import (
    FLOOR_M,
    ROOFS,
    TOWN_WALLS,
    build_pitched_roof,
)
from advercity.scene.facades import COOL_FRACTION, LIT_ROOM_FRACTION, SurfaceMaterials
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.semantics import Semantic

SKYLINE_HEIGHT_M = 16.0
_CELL_M = 30.0
_BUILT_FRACTION = 0.6
_WINDOW_M = 1.8
_BAND_AT, _BAND_RISE_M = 0.55, 0.7
"""Middle of a band of windows in a floor, as a fraction of it, and half of the band's height."""


def build_skyline(
    area: Rectangle | StreetSide, height_m: float | None, site: Site, key: str
) -> Iterator[MeshPart]:
    """Build blocks over an area, up to twice as high as `height_m`."""
    draw = create_generator("skyline", key)
    lights = create_generator("skyline lights", key)
    cells = area.sample_grid(_CELL_M, _CELL_M).reshape(-1, 2)
    for cell in cells + draw.uniform(-0.3, 0.3, cells.shape) * _CELL_M:
        x, y = draw.uniform(6, 12), draw.uniform(5, 8)
        top = (height_m or SKYLINE_HEIGHT_M) * draw.uniform(0.4, 1.0) ** 2 * 2.0
        yaw, wall = draw.uniform(0, np.pi), str(draw.choice(TOWN_WALLS))
        roof = str(draw.choice(ROOFS)) if top < 15 else ""
        if draw.random() > _BUILT_FRACTION or not site.is_free(cell, 2 * x)[0]:
            continue
        foot = site.project_to_ground(cell)[0]
        for surface, material in _build_block(x, y, top, wall, roof, lights):
            yield MeshPart(move_surface(surface, foot, yaw=yaw), material, Semantic.BUILDING)


def _build_block(
    x: float, y: float, top: float, wall: str, roof: str, lights: np.random.Generator
) -> SurfaceMaterials:
    floors = max(1, int(top / FLOOR_M))
    parts = [
        (box((-x, -y, -2), (x, y, top)), wall),
        (_build_bands(x, y, floors), "glass"),
        *_build_lit_windows(x, y, floors, lights),
    ]
    if roof:
        return [*parts, *build_pitched_roof(x, y, top, 0.4, wall, roof)]
    return [*parts, (box((-2, -2, top), (2, 2, top + 2.5)), "concrete")]


def _build_lit_windows(
    x: float, y: float, floors: int, draw: np.random.Generator
) -> SurfaceMaterials:
    """Build the windows of lit rooms on the bands of all four sides."""
    found: dict[str, list[TriangleSurface]] = {"room_warm": [], "room_cool": []}
    for number, (half, away) in enumerate([(x, y), (y, x)] * 2):
        columns = int((2 * half - 1.6) / _WINDOW_M)
        row, column = np.nonzero(draw.random((floors, columns)) < LIT_ROOM_FRACTION)
        is_cool = draw.random(len(row)) < COOL_FRACTION
        along = (column - (columns - 1) / 2) * _WINDOW_M
        places = np.column_stack(
            [along, np.full(len(row), -away - 0.06), FLOOR_M * (row + _BAND_AT)]
        )
        for material, chosen in (("room_warm", ~is_cool), ("room_cool", is_cool)):
            windows = rectangles(places[chosen], (0.4 * _WINDOW_M, 0, 0), (0, 0, _BAND_RISE_M))
            found[material].append(move_surface(windows, (0, 0, 0), yaw=number * np.pi / 2))
    return [(join_surfaces(windows), material) for material, windows in found.items()]


def _build_bands(x: float, y: float, floors: int) -> TriangleSurface:
    z = FLOOR_M * (np.arange(floors) + _BAND_AT)
    bands = [
        move_surface(
            rectangles(
                np.column_stack([np.zeros(floors), np.full(floors, -away), z]),
                (half - 0.8, 0, 0),
                (0, 0, _BAND_RISE_M),
            ),
            (0, 0, 0),
            yaw=number * np.pi / 2,
        )
        for number, (half, away) in enumerate([(x, y + 0.05), (y, x + 0.05)] * 2)
    ]
    return join_surfaces(bands)
