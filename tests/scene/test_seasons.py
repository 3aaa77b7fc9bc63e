"""Plants in autumn and winter."""

from typing import Any

import numpy as np
import pytest
from advercity_dsl import Road
from advercity_dsl.road import Season, Species
from pydantic import ValidationError

from advercity.geometry.mesh import Mesh, TriangleSurface
from advercity.scene.seasons import apply_season
from advercity.scene.trees import Detail, build_tree
from advercity.semantics import Semantic
from tests.scene.test_furniture import beside, build, street

TURNING = [species for species in Species if species is not Species.SPRUCE]


def parts(species: Species, season: Season, detail: Detail) -> dict[str, TriangleSurface]:
    return {material: surface for surface, material in build_tree(species, detail, season)[0]}


def count_leaves(species: Species, season: Season, detail: Detail = Detail.NEAR) -> int:
    built = parts(species, season, detail)
    return sum(len(part.triangles) for name, part in built.items() if name.startswith("leaves"))


def in_season(season: str | None, *items: dict[str, Any]) -> dict[str, list[Mesh]]:
    declared = street(*items).model_dump(mode="json", exclude_none=True)
    road = Road.model_validate({**declared, **({"season": season} if season else {})})
    meshes: dict[str, list[Mesh]] = {}
    for mesh in build(road):
        meshes.setdefault(mesh.material, []).append(mesh)
    return meshes


@pytest.mark.parametrize("species", TURNING)
def test_trees_lose_leaves_in_autumn_and_nearly_all_in_winter(species: Species):
    summer, autumn, winter = (count_leaves(species, season) for season in Season)
    assert 0.5 * summer < autumn < 0.9 * summer
    assert winter < 0.06 * summer
    assert "leaves" not in parts(species, Season.AUTUMN, Detail.NEAR)


@pytest.mark.parametrize("detail", Detail)
@pytest.mark.parametrize("species", TURNING)
def test_bare_trees_have_branches_from_any_distance(species: Species, detail: Detail):
    summer, winter = (parts(species, season, detail) for season in (Season.SUMMER, Season.WINTER))
    assert "inner_leaves" not in winter
    crown = np.ptp(np.concatenate([part.vertices for part in summer.values()]), axis=0)
    wood = np.ptp(winter["bark"].vertices, axis=0)
    assert (wood > 0.6 * crown).all()


def test_spruces_are_the_same_in_all_seasons():
    summer, autumn, winter = (parts(Species.SPRUCE, season, Detail.NEAR) for season in Season)
    for other in (autumn, winter):
        assert other.keys() == summer.keys()
        assert other["needles"].vertices.tobytes() == summer["needles"].vertices.tobytes()


def test_hedges_turn_in_autumn_and_are_brown_in_winter():
    hedge = beside("hedge", offset_m=2, height_m=1.2)
    summer, autumn, winter = (in_season(season, hedge) for season in ("summer", "autumn", "winter"))

    def count(meshes: dict[str, list[Mesh]], material: str) -> int:
        return sum(len(mesh.triangles) for mesh in meshes.get(material, ()))

    green = count(summer, "leaves")
    assert count(autumn, "leaves") == pytest.approx(0.5 * green, rel=0.1)
    assert count(autumn, "leaves_yellow") == pytest.approx(0.3 * green, rel=0.1)
    assert count(winter, "leaves") == count(winter, "inner_leaves") == 0
    assert count(winter, "leaves_brown") == pytest.approx(0.7 * green, rel=0.1)
    assert count(winter, "inner_leaves_brown") == count(summer, "inner_leaves")


def test_leaves_that_are_left_are_where_they_were():
    hedge = beside("hedge", offset_m=2, height_m=1.2)
    (before,) = in_season("summer", hedge)["leaves"]
    (after,) = in_season("winter", hedge)["leaves_brown"]
    assert before.normals is not None
    assert after.normals is not None
    was = {
        corners.tobytes(): normals.tobytes()
        for corners, normals in zip(
            before.vertices[before.triangles], before.normals[before.triangles], strict=True
        )
    }
    for corners, normals in zip(
        after.vertices[after.triangles], after.normals[after.triangles], strict=True
    ):
        assert was[corners.tobytes()] == normals.tobytes()


def test_crops_are_cut_in_autumn_and_sown_again_in_winter():
    fields = beside("crops", offset_m=(6, 16), height_m=1.1)
    heights_m: dict[str, float] = {}
    for season in ("summer", "autumn", "winter"):
        materials = in_season(season, fields)
        (name,) = materials.keys() & {"crops", "stubble", "young_crops"}
        points = np.concatenate([mesh.vertices for mesh in materials[name]])
        heights_m[name] = float(np.ptp(points[:, 2]))
        assert {mesh.semantic for mesh in materials[name]} == {Semantic.VEGETATION}
    assert list(heights_m) == ["crops", "stubble", "young_crops"]
    assert heights_m["crops"] > 0.7
    assert 0.1 < heights_m["young_crops"] < heights_m["stubble"] < 0.7


def test_grass_is_dull_in_winter_alone():
    corners = np.zeros((3, 3), dtype=np.float32)
    lawn = Mesh("lawn", corners, np.array([[0, 1, 2]], np.int32), "grass", Semantic.TERRAIN)
    materials = [apply_season([lawn], season)[0].material for season in Season]
    assert materials == ["grass", "grass", "grass_dull"]


def test_a_road_without_a_season_has_that_of_summer_and_its_spec_does_not_say_so():
    trees = {"kind": "trees", "at_m": [(0, 20), (10, 20)]}
    default, summer = in_season(None, trees), in_season("summer", trees)
    assert default.keys() == summer.keys()
    for first, second in zip(default.values(), summer.values(), strict=True):
        assert first[0].vertices.tobytes() == second[0].vertices.tobytes()
    assert "season" not in street().model_dump(mode="json")


def test_a_season_that_does_not_exist_is_refused():
    with pytest.raises(ValidationError, match="'summer', 'autumn' or 'winter'"):
        in_season("spring")


def test_the_inside_of_spruces_stays_green_in_winter():
    row = beside("trees", offset_m=2, species=["spruce"], spacing_m=10)
    summer, winter = (in_season(season, row) for season in ("summer", "winter"))
    assert winter.keys() == summer.keys() >= {"needles", "inner_needles"}
