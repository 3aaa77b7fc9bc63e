"""Fields: what they look like from above, and the plants at their border."""

import numpy as np
import pytest
import shapely
from advercity_dsl.road import Season
from numpy.typing import NDArray

from advercity.geometry.mesh import MeshPart
from advercity.scene.crops import build_crops, sample_rows
from advercity.scene.site import Rectangle, Site
from advercity.semantics import Semantic
from tests.scene.test_surroundings import PAVED, level

AXES = shapely.LineString([(-100, 0), (100, 0)])
FIELD = Rectangle.from_corners(((-60, 8), (60, 58)))


def grow(height_m: float | None = None, season: Season = Season.SUMMER) -> dict[str, MeshPart]:
    site = Site(level, PAVED, AXES, PAVED, season)
    parts = build_crops(sample_rows(FIELD), height_m, site, "test")
    return {part.material: part for part in parts}


def blades(part: MeshPart) -> NDArray[np.float64]:
    """Corners (n, 3, 3): two at the root of a blade, and its tip."""
    return part.surface.vertices[part.surface.triangles]


def widths_m(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)


def test_no_plant_is_wider_than_two_centimetres_or_much_higher_than_its_field():
    field = grow(0.8)
    for material in ("crop_stalks", "crop_ears"):
        corners = blades(field[material])
        assert widths_m(corners).max() < 0.02
        assert corners[..., 2].max() < 0.8 * 1.25
    assert np.percentile(blades(field["crop_ears"])[..., 2], 95) > 0.7
    assert {part.semantic for part in field.values()} == {Semantic.VEGETATION}


def test_a_field_ends_in_more_than_a_hundred_stalks_a_metre_that_stand_on_the_ground():
    corners = blades(grow(0.8)["crop_stalks"])
    roots = corners[:, :2].mean(axis=1)
    of_stalks = roots[np.abs(roots[:, 2]) < 0.1]
    # The border next to the street, away from the field's corners.
    in_front = of_stalks[(of_stalks[:, 1] < 10) & (np.abs(of_stalks[:, 0]) < 50)]
    per_metre = np.histogram(in_front[:, 0], bins=np.arange(-50, 51))[0]
    assert per_metre.mean() > 100
    assert per_metre.min() > 60
    assert 8.0 <= in_front[:, 1].min() < in_front[:, 1].max() < 9.6


def test_wheels_of_tractors_leave_tracks_through_a_field():
    field = grow(0.8)
    points = field["crops"].surface.vertices
    row = np.round((points[:, 1] - 8) / 0.65).astype(int)
    low = {int(number) for number in row[(points[:, 2] > 0) & (points[:, 2] < 0.3)]}
    # Points 10 and 13 of every 36 across: 1.95 m apart, 23.4 m from the next pair.
    assert low == {10, 13, 46, 49}
    ears = blades(field["crop_ears"])[:, 2]
    above = ears[np.abs(ears[:, 1] - (8 + 10 * 0.65)) < 0.1]
    assert len(above) < 0.05 * len(ears)


def test_the_top_of_a_field_undulates():
    heights = grow(0.8)["crops"].surface.vertices[:, 2]
    canopy = heights[heights > 0.4]
    assert 0.02 < canopy.std() < 0.08


def test_maize_has_broad_leaves_and_wheat_has_none():
    wheat, maize = (blades(grow(height)["crop_stalks"]) for height in (0.8, 2.2))
    assert (widths_m(maize) > 0.05).mean() > 0.8
    assert (widths_m(wheat) > 0.05).mean() == 0.0
    assert maize[..., 2].max() == pytest.approx(2.2, rel=0.15)


@pytest.mark.parametrize(
    ("season", "material"), [(Season.AUTUMN, "straw"), (Season.WINTER, "seedlings")]
)
def test_cut_and_young_fields_have_short_stalks_without_ears(season: Season, material: str):
    field = grow(0.8, season)
    assert "crop_ears" not in field
    assert blades(field[material])[..., 2].max() < 0.3


def test_the_same_field_grows_the_same_plants():
    first, second = grow(0.8), grow(0.8)
    for material, part in first.items():
        assert part.surface.vertices.tobytes() == second[material].surface.vertices.tobytes()
