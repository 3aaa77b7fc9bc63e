import numpy as np
import pytest

from advercity.scene.facades import FacadeStyle, Storey, build_facade
from advercity.scene.roof_details import build_chimneys, build_dormers, build_gutters

WALL_M, EAVES_M = 4.0, 6.0


def roof_height(y: float) -> float:
    """Upper side of a roof that rises by 3/4 from eaves at 6 m over walls at 4 m, 0.22 m thick."""
    return EAVES_M + 0.75 * (WALL_M - abs(y)) + 0.22


def test_dormers_come_out_of_the_roof_with_their_windows_in_front():
    parts = build_dormers([-2.0, 2.0], WALL_M, EAVES_M, "brick", "roof_slate", "enamel_white")
    corners = {material: surface.vertices for surface, material in parts}
    wall, glass = corners["brick"], corners["glass"]
    front, back = wall[:, 1].min(), wall[:, 1].max()
    assert -WALL_M < front < back < 0
    assert wall[:, 2].min() < roof_height(front) < glass[:, 2].min()
    assert wall[:, 2].max() < roof_height(back)
    assert glass[:, 1].max() < corners["enamel_white"][:, 1].min() < front
    assert glass[:, 2].max() < wall[:, 2].max()


def test_gutters_hang_at_both_eaves_outside_the_roof():
    gutter = build_gutters(5.0, WALL_M, EAVES_M, 0.5).vertices
    assert np.abs(gutter[:, 1]).min() == pytest.approx(4.5)
    assert gutter[:, 2].max() < roof_height(4.5)
    assert {-1, 1} == set(np.sign(gutter[:, 1]))


def test_chimneys_begin_within_the_roof_and_end_above_its_ridge():
    chimney = build_chimneys([1.0], EAVES_M + 0.75 * WALL_M).vertices
    assert chimney[:, 2].min() < roof_height(1.1)
    assert chimney[:, 2].max() > roof_height(0) + 0.5


def test_a_shop_has_its_name_in_front_of_its_sign_and_within_its_width():
    storey = Storey(0.0, 3.5, 3, 3.0, 0.5, 2.2, 1, is_shop=True)
    style = FacadeStyle("brick", "black_plastic", "cloth_red", 0.0)
    parts = build_facade(12.0, [storey], style, np.random.default_rng(1))
    name = next(surface.vertices for surface, material in parts if material == "enamel_white")
    sign = next(surface.vertices for surface, material in parts if material == "cloth_red")
    assert name[:, 1].max() < sign[:, 1].min()
    assert sign[:, 0].min() < name[:, 0].min() < name[:, 0].max() < sign[:, 0].max()
    assert sign[:, 2].min() < name[:, 2].min() < name[:, 2].max() < sign[:, 2].max()


def test_shutters_are_on_the_wall_at_both_sides_of_a_window():
    storey = Storey(0.0, 3.0, 1, 1.2, 0.9, 1.4)
    style = FacadeStyle("brick", "enamel_white", "cloth_green", 0.0, has_shutters=True)
    parts = build_facade(4.0, [storey], style, np.random.default_rng(1))
    leaves = next(surface.vertices for surface, material in parts if material == "cloth_green")
    assert np.abs(leaves[:, 0]).min() > 0.6
    assert np.abs(leaves[:, 0]).max() < 1.3
    assert (leaves[:, 1] < 0).all()
