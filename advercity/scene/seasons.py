"""Effects of the season on plants: remaining leaves, their colours, and crops on fields.

The fractions are assumptions, as of late October and of January in Central Europe.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from advercity_dsl.road import Season, Species

from advercity.geometry.mesh import Mesh, TriangleSurface
from advercity.randomness import create_generator

LeafFractions = Mapping[str, float]
"""Fractions of the leaves by their material in a season; the rest has fallen."""
_Leaves = TypeVar("_Leaves", Mesh, TriangleSurface)

_GREEN: LeafFractions = {"leaves": 1.0}
# Trees have no green leaves in autumn: any green ones then belong to shrubs.
_TREE_LEAVES: Mapping[Season, Mapping[Species, LeafFractions]] = {
    Season.SUMMER: dict.fromkeys(Species, _GREEN),
    Season.AUTUMN: {
        Species.OAK: {"leaves_brown": 0.5, "leaves_yellow": 0.3},
        Species.MAPLE: {"leaves_red": 0.4, "leaves_yellow": 0.3},
        Species.BIRCH: {"leaves_yellow": 0.65},
        Species.POPLAR: {"leaves_yellow": 0.65},
    },
    # Young oaks keep some dry leaves.
    Season.WINTER: {Species.OAK: {"leaves_brown": 0.04}},
}
_SHRUB_LEAVES: Mapping[Season, LeafFractions] = {
    Season.AUTUMN: {"leaves": 0.5, "leaves_yellow": 0.3, "leaves_brown": 0.15},
    # Hedges of beech and hornbeam keep them until spring.
    Season.WINTER: {"leaves_brown": 0.7},
}
"""Fractions of hedges, shrubs and distant woods."""
CROP_HEIGHT_M = 0.8


@dataclass(frozen=True)
class Crop:
    """The state of a field of crops.

    Attributes:
        material: Material of the field from above.
        height_m: Height of its plants.
        shade: Material visible between plants from aside.
        stalks: Material of single plants.
        ears: Material of their tips.
        has_ears: Whether they bear leaves and ears.
    """

    material: str
    height_m: float
    shade: str
    stalks: str
    ears: str
    has_ears: bool = False


_LOW_CROPS: Mapping[Season, Crop] = {
    Season.AUTUMN: Crop("stubble", 0.2, "soil", "straw", "straw"),
    Season.WINTER: Crop("young_crops", 0.13, "soil", "seedlings", "seedlings"),
}
"""Fields after harvest and new sowing."""
_RECOLOURED: Mapping[Season, Mapping[str, str]] = {
    # The inside of shrubs turns last.
    Season.AUTUMN: {},
    Season.WINTER: {
        "inner_leaves": "inner_leaves_brown",
        "grass": "grass_dull",
        "grass_blades": "grass_blades_dull",
    },
}
"""Other materials of plants, and their replacements."""


def find_crop(season: Season, grown_m: float | None) -> Crop:
    """Find the crop of a field in a season; grown crops have the declared or a usual height."""
    return _LOW_CROPS.get(season) or Crop(
        "crops", grown_m or CROP_HEIGHT_M, "crop_shade", "crop_stalks", "crop_ears", has_ears=True
    )


def select_tree_leaves(
    leaves: TriangleSurface, species: Species, season: Season
) -> list[tuple[TriangleSurface, str]]:
    """Select the remaining leaves of a tree in a season, a triangle each, by their materials."""
    fractions = _TREE_LEAVES[season].get(species, {})
    return list(_select_leaves(leaves, fractions, f"{species}/{season}"))


def apply_season(meshes: Iterable[Mesh], season: Season) -> tuple[Mesh, ...]:
    """Give the plants of a world, apart from the leaves of trees, the look of a season."""
    if season is Season.SUMMER:
        return tuple(meshes)
    return tuple(dressed for mesh in meshes for dressed in _apply_to_mesh(mesh, season))


def _apply_to_mesh(mesh: Mesh, season: Season) -> Iterator[Mesh]:
    if mesh.material != "leaves":
        yield replace(mesh, material=_RECOLOURED[season].get(mesh.material, mesh.material))
        return
    for kept, material in _select_leaves(mesh, _SHRUB_LEAVES[season], f"{mesh.name}/{season}"):
        yield replace(kept, name=f"{mesh.name}_of_shrubs_{material}", material=material)


def _select_leaves(
    leaves: _Leaves, fractions: LeafFractions, key: str
) -> Iterator[tuple[_Leaves, str]]:
    """Select random leaves, whose triangles share no corner, for each material."""
    if fractions == _GREEN:
        yield leaves, "leaves"
        return
    draw = create_generator("season", key).random(len(leaves.triangles))
    for (low, high), material in zip(
        pairwise(np.cumsum([0.0, *fractions.values()])), fractions, strict=True
    ):
        corners = leaves.triangles[(draw >= low) & (draw < high)].ravel()
        yield (
            replace(
                leaves,
                vertices=leaves.vertices[corners],
                triangles=np.arange(len(corners), dtype=leaves.triangles.dtype).reshape(-1, 3),
                normals=None if leaves.normals is None else leaves.normals[corners],
            ),
            material,
        )
