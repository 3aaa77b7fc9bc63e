"""Single trees: shape, leaves and levels of detail."""

import numpy as np
import pytest
from advercity_dsl.road import Species
from numpy.typing import NDArray

from advercity.geometry.mesh import TriangleSurface, join_surfaces
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.scene.trees import Detail, build_tree
from advercity.semantics import Semantic
from advercity.testing import build_flat_world

EVERY_TREE = [(species, detail) for species in Species for detail in Detail]


def parts(species: Species, detail: Detail = Detail.NEAR) -> dict[str, TriangleSurface]:
    return {material: surface for surface, material in build_tree(species, detail)[0]}


def leaves(species: Species, detail: Detail = Detail.NEAR) -> TriangleSurface:
    built = parts(species, detail)
    return built["needles" if species is Species.SPRUCE else "leaves"]


@pytest.mark.parametrize(("species", "detail"), EVERY_TREE)
def test_trees_stand_on_the_ground_and_are_as_high_as_they_say(
    species: Species, detail: Detail
) -> None:
    built, height_m = build_tree(species, detail)
    vertices = np.concatenate([surface.vertices for surface, _ in built])
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=0.05)
    assert vertices[:, 2].max() == pytest.approx(height_m, rel=0.1)


@pytest.mark.parametrize("species", Species)
def test_fewer_triangles_make_the_same_outline_farther_away(species: Species) -> None:
    near, middle, far = (leaves(species, detail) for detail in Detail)
    assert len(near.triangles) > 1.7 * len(middle.triangles) > 2.5 * len(far.triangles)
    for other in (middle, far):
        assert np.ptp(other.vertices, axis=0) == pytest.approx(
            np.ptp(near.vertices, axis=0), rel=0.3
        )


@pytest.mark.parametrize(("species", "detail"), EVERY_TREE)
def test_no_leaf_is_loose_in_the_air(species: Species, detail: Detail) -> None:
    """The middle of every leaf is within a metre of another's."""
    surface = leaves(species, detail)
    middles = surface.vertices[surface.triangles].mean(axis=1)
    for middle in middles[::5]:
        _, nearest, *_ = np.partition(np.linalg.norm(middles - middle, axis=1), 1)
        assert nearest < 1.0


def hit_fraction(
    species: Species,
    heights_m: NDArray[np.float64],
    offset_m: float,
    detail: Detail = Detail.NEAR,
) -> float:
    """Fraction of horizontal rays, at heights and an offset from the trunk, that meet leaves."""
    inside = "inner_needles" if species is Species.SPRUCE else "inner_leaves"
    crown = join_surfaces([leaves(species, detail), parts(species, detail)[inside]])
    mesh = crown.to_mesh("leaves", "leaves", Semantic.VEGETATION)
    turn = np.arange(40) / 40 * 2.0 * np.pi
    angle, height = (grid.ravel() for grid in np.meshgrid(turn, heights_m))
    along = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    aside = np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=1)
    origins = offset_m * aside - 20.0 * along + np.array([0.0, 0.0, 1.0]) * height[:, None]
    rays = Rays(origins.astype(np.float32), along.astype(np.float32))
    hits = Raycaster(build_flat_world(mesh)).cast(rays, 40.0)
    return float(np.isfinite(hits.range_m).mean())


def test_a_crown_is_dense_in_its_middle_and_open_at_its_edge() -> None:
    heights = np.linspace(4.4, 5.6, 20)
    assert hit_fraction(Species.OAK, heights, 0.0) > 0.97
    assert 0.1 < hit_fraction(Species.OAK, heights, 2.7) < 0.8


@pytest.mark.parametrize(
    ("species", "heights_m"),
    [
        (Species.OAK, (4.4, 6.4)),
        (Species.MAPLE, (3.4, 5.0)),
        (Species.BIRCH, (2.4, 4.4)),
        (Species.POPLAR, (3.0, 8.0)),
        (Species.SPRUCE, (1.8, 7.5)),
    ],
)
def test_crowns_of_few_leaves_have_no_holes_in_their_middle(
    species: Species, heights_m: tuple[float, float]
) -> None:
    heights = np.linspace(*heights_m, 40)
    assert hit_fraction(species, heights, 0.1, Detail.FAR) == 1.0


def test_branches_reach_into_the_crown() -> None:
    bark = parts(Species.MAPLE)["bark"].vertices
    crown = leaves(Species.MAPLE).vertices
    beyond_trunk = np.linalg.norm(bark[:, :2], axis=1) > 0.8
    assert beyond_trunk.sum() > 20
    assert bark[beyond_trunk, 2].min() > 0.5 * crown[:, 2].min()
