"""Façades: their walls, openings and what is in these."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.geometry.mesh import TriangleSurface, join_surfaces
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.scene.facades import (
    CURTAINED_FRACTION,
    LIT_ROOM_FRACTION,
    LIT_SHOP_FRACTION,
    REVEAL_M,
    FacadeStyle,
    Storey,
    build_facade,
)
from advercity.scene.rooms import NO_COVER, ROOM_NUMBERS
from advercity.semantics import Semantic
from advercity.testing import build_flat_world

STOREY = Storey(
    bottom_m=0.0, height_m=3.0, openings=4, width_m=1.2, sill_m=0.9, opening_m=1.5, door_at=1
)
STYLE = FacadeStyle("brick", "enamel_white", "cloth_blue", blind_fraction=0.0)
WIDTH_M = 12.0
PANES = ("room_dark", "shop_dark", "room_warm", "room_cool", "room_shop")


def build(*storeys: Storey, style: FacadeStyle = STYLE) -> list[tuple[TriangleSurface, str]]:
    return build_facade(WIDTH_M, storeys, style, create_generator("test"))


def of(parts: list[tuple[TriangleSurface, str]], *materials: str) -> TriangleSurface:
    return join_surfaces([surface for surface, name in parts if name in materials])


def corners(surface: TriangleSurface) -> NDArray[np.float64]:
    return surface.vertices[surface.triangles]


def front_area(surface: TriangleSurface) -> float:
    """Area of the triangles in the plane of the façade."""
    a, b, c = np.moveaxis(corners(surface), 1, 0)
    flat = np.abs(corners(surface)[..., 1]).max(axis=1) < 1e-9
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1)[flat].sum() / 2.0)


def test_a_wall_has_the_area_that_its_openings_leave() -> None:
    """36 m², less three windows of 1.2 m by 1.5 m and a door of 1.2 m by 2.35 m."""
    wall = of(build(STOREY), "brick")
    assert front_area(wall) == pytest.approx(36.0 - 3 * 1.2 * 1.5 - 1.2 * 2.35)


def test_panes_are_set_back_and_as_wide_as_their_openings() -> None:
    glass = of(build(replace(STOREY, door_at=None)), *PANES)
    assert glass.vertices[:, 1] == pytest.approx(REVEAL_M)
    assert len(glass.triangles) == 4 * 2
    middles = np.unique(corners(glass)[..., 0].mean(axis=1).round(1))
    assert np.ptp(glass.vertices[:, 0]) == pytest.approx(3 * 3.0 + 1.2)
    assert middles.min() < -4.0 and middles.max() > 4.0


def test_nothing_is_seen_through_a_facade_but_its_panes() -> None:
    storeys = (STOREY, replace(STOREY, bottom_m=3.0, door_at=None, has_balconies=True))
    meshes = [
        surface.to_mesh(f"part {number}", material, Semantic.BUILDING)
        for number, (surface, material) in enumerate(build(*storeys))
    ]
    x, z = np.meshgrid(np.linspace(-5.99, 5.99, 120), np.linspace(0.01, 5.99, 60))
    origins = np.column_stack([x.ravel(), np.full(x.size, -5.0), z.ravel()]).astype(np.float32)
    towards = np.broadcast_to(np.array([0.0, 1.0, 0.0], np.float32), origins.shape)
    hits = Raycaster(build_flat_world(*meshes)).cast(Rays(origins, towards), 50.0)
    assert hits.range_m.max() == pytest.approx(5.0 + REVEAL_M, abs=0.01)


def test_the_door_is_where_it_is_declared_and_begins_at_the_ground() -> None:
    door = of(build(STOREY), "wood").vertices
    assert door[:, 2].min() == pytest.approx(0.05)
    assert door[:, 0].mean() == pytest.approx(-1.5)


@pytest.mark.parametrize(("fraction", "count"), [(0.0, 0), (1.0, 4)])
def test_as_many_windows_have_blinds_as_declared(fraction: float, count: int) -> None:
    parts = build(replace(STOREY, door_at=None), style=replace(STYLE, blind_fraction=fraction))
    cloths = corners(of(parts, "cloth_light"))
    # Curtains cover a part of the width, blinds all of it.
    is_blind = np.ptp(cloths[..., 0], axis=1) > 1.0
    assert np.count_nonzero(is_blind) == 2 * count


def test_a_third_of_the_rooms_is_lit_by_night_and_most_shops() -> None:
    many = replace(STOREY, openings=2000, width_m=0.004, door_at=None)
    rooms, shops = build(many), build(replace(many, is_shop=True))

    def count_panes(parts: list[tuple[TriangleSurface, str]], *materials: str) -> int:
        return len(of(parts, *materials).triangles) // 2

    assert count_panes(rooms, *PANES) == count_panes(shops, *PANES) == 2000
    lit = count_panes(rooms, "room_warm", "room_cool")
    assert lit == pytest.approx(2000 * LIT_ROOM_FRACTION, rel=0.1)
    assert 0 < count_panes(rooms, "room_cool") < count_panes(rooms, "room_warm")
    assert count_panes(shops, "room_shop") == pytest.approx(2000 * LIT_SHOP_FRACTION, rel=0.1)


def test_blinds_and_curtains_are_behind_panes_that_tell_of_them() -> None:
    storeys = [replace(STOREY, bottom_m=3.0 * n, door_at=None) for n in range(200)]
    parts = build(*storeys, style=replace(STYLE, blind_fraction=0.5))
    cloths, panes = of(parts, "cloth_light"), of(parts, *PANES)
    assert cloths.vertices[:, 1].min() > REVEAL_M
    assert panes.uv is not None
    middles = corners(cloths).mean(axis=1)
    bays, floors = np.floor(middles[:, 0] / 3.0), np.floor(middles[:, 2] / 3.0)
    places = set(zip(bays.tolist(), floors.tolist(), strict=True))
    number, cover = np.floor(panes.uv[::4]).T
    assert number.min() >= 0 and number.max() == ROOM_NUMBERS - 1
    assert len(places) == np.count_nonzero(cover != NO_COVER)
    assert len(places) / 800 == pytest.approx(0.5 + 0.5 * CURTAINED_FRACTION, abs=0.06)


def test_shops_have_a_sign_above_undivided_panes() -> None:
    shop = replace(STOREY, width_m=2.4, sill_m=0.4, opening_m=2.0, is_shop=True, door_at=None)
    # Its name is in white.
    parts = build(shop, style=replace(STYLE, trim="black_plastic"))
    sign = of(parts, "cloth_blue").vertices
    assert sign[:, 2].max() > 2.4
    frames = of(parts, "black_plastic")
    assert len(frames.triangles) == 4 * 4 * 2


def test_the_door_of_a_shop_is_a_pane() -> None:
    parts = build(replace(STOREY, is_shop=True))
    assert not any(name == "wood" for _, name in parts)
    # A door of 1.2 m by 2.35 m among three windows of 1.2 m by 1.5 m.
    panes = corners(of(parts, *PANES))
    edges = panes[:, 1] - panes[:, 0], panes[:, 2] - panes[:, 0]
    area = np.linalg.norm(np.cross(*edges), axis=1).sum() / 2.0
    assert area == pytest.approx(3 * 1.2 * 1.5 + 1.2 * 2.35)


def test_steps_lead_up_a_plinth_to_a_door_above_it() -> None:
    parts = build(STOREY, style=replace(STYLE, plinth_m=0.35))
    assert of(parts, "wood").vertices[:, 2].min() == pytest.approx(0.35)
    below = of(parts, "concrete").vertices
    heights = np.unique(below[(below[:, 2] > 0.0) & (below[:, 2] < 1.0), 2])
    assert heights == pytest.approx([0.175, 0.35])


def test_a_gate_has_a_size_of_its_own() -> None:
    gate = of(build(replace(STOREY, gate_m=(2.6, 2.8))), "enamel_white").vertices
    is_gate = np.abs(gate[:, 0] - -1.5) <= 1.3 + 1e-9
    assert gate[is_gate, 2].max() == pytest.approx(2.8)
    wall = of(build(replace(STOREY, gate_m=(2.6, 2.8))), "brick")
    assert front_area(wall) == pytest.approx(36.0 - 3 * 1.2 * 1.5 - 2.6 * (2.8 - 0.05))
