"""Builds single trees: forking trunks, and crowns of leaves around the ends of branches."""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache

import numpy as np
from advercity_dsl.road import Season, Species

from advercity.geometry.arrays import Float64Array
from advercity.geometry.directions import spread_directions
from advercity.geometry.mesh import TriangleSurface, join_surfaces, normalize, shade_smooth, xyz
from advercity.geometry.primitives import ellipsoid, loft_rings, tube
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.randomness import create_generator
from advercity.scene.foliage import build_leaves, roughen, strew_leaves
from advercity.scene.seasons import select_tree_leaves


class Detail(IntEnum):
    """How finely a tree is built: for close views, across a street, and beyond."""

    NEAR = 0
    MIDDLE = 1
    FAR = 2


@dataclass(frozen=True)
class _Crown:
    """A species: its trunk, and its leaves' ellipsoids (x, y, z, radius, half height)."""

    trunk_m: float
    trunk_radius_m: float
    blobs: tuple[tuple[float, float, float, float, float], ...]
    droop: float = 0.0


_CROWNS = {
    Species.OAK: _Crown(
        2.6,
        0.26,
        (
            (0.0, 0.0, 5.6, 2.3, 1.9),
            (1.5, 0.6, 4.6, 1.6, 1.2),
            (-1.3, 1.0, 4.8, 1.6, 1.2),
            (-0.2, -1.5, 4.6, 1.5, 1.2),
        ),
    ),
    Species.POPLAR: _Crown(
        1.8,
        0.2,
        ((0.0, 0.0, 7.4, 0.95, 2.6), (0.15, 0.1, 4.6, 1.15, 2.3), (0.0, 0.0, 2.9, 0.8, 1.0)),
    ),
    Species.BIRCH: _Crown(
        1.7,
        0.12,
        ((0.0, 0.0, 4.1, 0.9, 1.1), (0.2, -0.1, 3.1, 1.2, 1.1), (-0.3, 0.3, 2.4, 0.9, 0.7)),
        0.5,
    ),
    Species.MAPLE: _Crown(
        1.9,
        0.18,
        (
            (0.0, 0.0, 4.5, 1.6, 1.4),
            (0.9, 0.1, 3.7, 1.5, 1.2),
            (-0.9, 0.7, 3.8, 1.5, 1.2),
            (0.0, -1.0, 3.5, 1.4, 1.1),
        ),
    ),
}
SPRUCE_HEIGHT_M = 10.8
_ENDS = {Detail.NEAR: 64, Detail.MIDDLE: 38, Detail.FAR: 24}
"""Ends of branches of a tree."""
_SHOOTS = {Detail.NEAR: (8, 11), Detail.MIDDLE: (5, 7), Detail.FAR: (4, 6)}
"""Shoots of each, and leaves of a shoot."""
_LEAF_LENGTH_M = {Detail.NEAR: 0.165, Detail.MIDDLE: 0.24, Detail.FAR: 0.38}
_BRANCHES_PER_LIMB = 6
_CORE_RATIO = {Detail.NEAR: 0.58, Detail.MIDDLE: 0.64, Detail.FAR: 0.72}
_CORE_BUMP = 0.16
"""Size of the dense inside over the crown's (more leaves hide it better), and its unevenness."""
_CORE_SIDES = {Detail.NEAR: (12, 8), Detail.MIDDLE: (10, 6), Detail.FAR: (8, 5)}
_HIDDEN_RATIO = 0.72
"""Size over the crown's of the ellipsoids for hiding parts of other ellipsoids."""
_INNER_COVERAGE = 0.33
"""Area of the leaves on the inside of a crown over its own."""
_SHOOT_RADIUS_M = 0.012
_SPRUCE_BRANCHES = {Detail.NEAR: 220, Detail.MIDDLE: 128, Detail.FAR: 104}
_TWIGS = {Detail.NEAR: 10, Detail.MIDDLE: 5, Detail.FAR: 4}
"""Twigs on either side of a spruce's branch."""
_TIERS = {Detail.NEAR: (18, 9), Detail.MIDDLE: (12, 8), Detail.FAR: (9, 6)}
"""Tiers of the dense inside of a spruce, and their sides."""

TreeParts = tuple[tuple[TriangleSurface, str], ...]


@cache
def build_tree(
    species: Species, detail: Detail, season: Season = Season.SUMMER
) -> tuple[TreeParts, float]:
    """Build the shaded parts of a tree at the origin with their materials, and its height."""
    # The key holds the species' type by name: `Species` may not be renamed.
    draw = create_generator("tree", species, int(detail))
    if species is Species.SPRUCE:
        return _build_spruce(detail, draw), SPRUCE_HEIGHT_M
    crown = _CROWNS[species]
    ends = _spread_ends(crown, _ENDS[detail], draw)
    shoots = _build_shoots(crown, ends, detail, draw)
    wood = [_build_stem(crown)]
    is_bare = season is Season.WINTER
    if detail < Detail.FAR or is_bare:
        wood += _build_limbs(crown, ends[::_BRANCHES_PER_LIMB])
    if detail is Detail.NEAR or is_bare:
        wood += [*_build_branches(crown, ends), shoots.build_stems()]
    length_m = _LEAF_LENGTH_M[detail]
    outer = shoots.build_leaves(length_m, draw)
    inside = roughen(shade_smooth(_build_core(crown, detail, draw)), draw)
    inner = strew_leaves(_select_outside(inside, crown), length_m, draw, _INNER_COVERAGE)
    parts = [
        (shade_smooth(join_surfaces(wood)), "bark"),
        *select_tree_leaves(join_surfaces([outer, inner]), species, season),
    ]
    if not is_bare:
        shade = "inner_leaves_brown" if season is Season.AUTUMN else "inner_leaves"
        parts.append((inside, shade))
    return tuple(parts), max(z + rise for *_, z, _, rise in crown.blobs)


def _spread_ends(crown: _Crown, count: int, draw: np.random.Generator) -> Float64Array:
    """Spread the ends of branches (n, 3) through the outer part of the crown."""
    volumes = np.array([radius**2 * rise for *_, radius, rise in crown.blobs])
    counts = np.maximum(1, np.round(count * volumes / volumes.sum()).astype(int))
    ends: list[Float64Array] = []
    for (x, y, z, radius, rise), number in zip(crown.blobs, counts, strict=True):
        # Evenly: crowns of few branches are as wide as crowns of many.
        direction = normalize(spread_directions(number) + draw.normal(scale=0.12, size=(number, 3)))
        depth = draw.uniform(0.7, 0.88, (number, 1)) * (radius, radius, rise)
        ends.append(direction * depth + (x, y, z))
    return np.concatenate(ends)


@dataclass(frozen=True, eq=False)
class _Shoots:
    """Shoots around the ends of branches, with leaves on both sides.

    Attributes:
        points: (n, k, 3), from where each leaves its branch, then where its leaves are.
        outward: (n, 3) out of the crown.
    """

    points: Float64Array
    outward: Float64Array

    def build_stems(self) -> TriangleSurface:
        """Build the stems: one long triangle each, since they are too thin to be seen from afar."""
        foot, tip = self.points[:, 0], self.points[:, -1]
        aside = _SHOOT_RADIUS_M * normalize(np.cross(tip - foot, self.outward + xyz(x=0.01)))
        corners = np.stack([foot - aside, foot + aside, tip], axis=1).reshape(-1, 3)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        return TriangleSurface(corners, triangles)

    def build_leaves(self, length_m: float, draw: np.random.Generator) -> TriangleSurface:
        """Build the leaves: by turns to the left and the right, the last one ahead."""
        count = self.points.shape[1] - 1
        ahead = np.diff(self.points, axis=1)
        ahead /= np.linalg.norm(ahead, axis=2, keepdims=True)
        outward = np.broadcast_to(self.outward[:, None], ahead.shape)
        aside = np.cross(outward, ahead)
        side = np.where(np.arange(count) % 2, 1.0, -1.0) * (np.arange(count) < count - 1)
        along = ahead + 1.2 * side[:, None] * aside + draw.normal(scale=0.25, size=ahead.shape)
        points, directions, faces = (
            array.reshape(-1, 3) for array in (self.points[:, 1:], along, outward)
        )
        return build_leaves(points, directions, faces, length_m, draw)


def _build_shoots(
    crown: _Crown, ends: Float64Array, detail: Detail, draw: np.random.Generator
) -> _Shoots:
    number, leaves = _SHOOTS[detail]
    middle = np.mean([blob[:3] for blob in crown.blobs], axis=0)
    root = np.repeat(ends, number, axis=0)
    outward = normalize(root - middle + xyz(z=0.4))
    fan = np.tile(spread_directions(number), (len(ends), 1))
    away = normalize(fan + 0.55 * outward + draw.normal(scale=0.3, size=root.shape))
    reach = 0.3 * max(blob[3] for blob in crown.blobs) + 0.2 - 0.3 * _LEAF_LENGTH_M[detail]
    reach = reach * draw.uniform(0.75, 1.15, (len(root), 1, 1))
    at = np.concatenate([[0.0], np.linspace(0.3, 1.0, leaves)])[None, :, None]
    # Leaves bend shoots down by their weight, most on a birch.
    sag = at**2 * reach * (0.15 + crown.droop)
    points = root[:, None] + at * reach * away[:, None] - sag * xyz(z=1.0)
    return _Shoots(points, normalize(outward + 0.5 * away))


def _build_core(crown: _Crown, detail: Detail, draw: np.random.Generator) -> TriangleSurface:
    """Build bumpy ellipsoids inside the crown's, through which hardly any light comes.

    Only a closed core leaves no holes, however few leaves are before it.
    """
    around, bands = _CORE_SIDES[detail]
    pieces: list[TriangleSurface] = []
    for x, y, z, radius, rise in crown.blobs:
        ball = ellipsoid((0, 0, 0), (radius, radius, rise), sides=around, bands=bands)
        bumps = draw.uniform(-_CORE_BUMP, _CORE_BUMP, (len(ball.vertices), 1))
        pieces.append(
            replace(ball, vertices=ball.vertices * (_CORE_RATIO[detail] + bumps) + xyz(x, y, z))
        )
    return join_surfaces(pieces)


def _select_outside(core: TriangleSurface, crown: _Crown) -> TriangleSurface:
    """Select the triangles of a core not hidden by another of its ellipsoids."""
    blobs = np.array(crown.blobs)
    middles = core.vertices[core.triangles].mean(axis=1)
    inside = (middles[:, None] - blobs[:, :3]) / blobs[:, [3, 3, 4]]
    hidden = np.sum(np.linalg.norm(inside, axis=2) < _HIDDEN_RATIO, axis=1) > 1
    return replace(core, triangles=core.triangles[~hidden])


def _build_stem(crown: _Crown) -> TriangleSurface:
    radius = crown.trunk_radius_m
    points = [(0, 0, 0), (0, 0, 0.35), (0.05, 0, crown.trunk_m), (0, 0.05, _find_top(crown))]
    return tube(points, [1.35 * radius, radius, 0.8 * radius, 0.2 * radius], sides=8)


def _find_top(crown: _Crown) -> float:
    return max(z + 0.4 * rise for *_, z, _, rise in crown.blobs)


def _build_limbs(crown: _Crown, tips: Float64Array) -> list[TriangleSurface]:
    """Build limbs from the trunk to their tips (n, 3)."""
    radius = crown.trunk_radius_m
    return [
        tube(path, [0.4 * radius, 0.26 * radius, 0.06 * radius], sides=5)
        for path in _find_limbs(crown, tips)
    ]


def _build_branches(crown: _Crown, ends: Float64Array) -> list[TriangleSurface]:
    """Build branches to the ends beyond limbs, each from the limb next to its end."""
    radius = crown.trunk_radius_m
    bends = _find_limbs(crown, ends[::_BRANCHES_PER_LIMB])[:, 1]
    others = np.delete(ends, np.s_[::_BRANCHES_PER_LIMB], axis=0)
    feet = bends[np.linalg.norm(others[:, None] - bends, axis=2).argmin(axis=1)]
    middles = 0.5 * (feet + others) + xyz(z=0.12)
    return [
        tube(path, [0.17 * radius, 0.12 * radius, 0.04 * radius], sides=3)
        for path in np.stack([feet, middles, others], axis=1)
    ]


def _find_limbs(crown: _Crown, tips: Float64Array) -> Float64Array:
    """Find the foot, the bend and the tip (n, 3, 3) of limbs."""
    forks = np.clip(0.6 * tips[:, 2], 0.85 * crown.trunk_m, 0.9 * _find_top(crown))
    feet = np.column_stack([np.zeros((len(tips), 2)), forks])
    bends = np.column_stack([0.5 * tips[:, :2], forks + 0.55 * (tips[:, 2] - forks)])
    return np.stack([feet, bends, tips], axis=1)


def _build_spruce(detail: Detail, draw: np.random.Generator) -> TreeParts:
    """Build a spruce: hanging branches, with twigs on either side and at the end.

    Branches wind up the stem: as many in few whorls would look like plates on a stick from afar.
    """
    branch = np.arange(_SPRUCE_BRANCHES[detail])
    height = np.linspace(1.6, SPRUCE_HEIGHT_M - 0.5, len(branch))
    height += draw.uniform(-0.15, 0.15, len(branch))
    turn = 2.0 * np.pi * (GOLDEN_FRACTION * branch + draw.uniform(0.0, 0.1, len(branch)))
    reach = _find_spruce_reach(height) * draw.uniform(0.7, 1.15, len(branch))
    away = np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), -0.32)])
    aside = np.column_stack([-np.sin(turn), np.cos(turn), np.full(len(turn), -0.25)])
    root = np.column_stack([np.zeros((len(height), 2)), height])
    needles = _build_twigs(root, away * (reach + 0.25)[:, None], aside, _TWIGS[detail], draw)
    stem = tube([(0, 0, 0), (0, 0, SPRUCE_HEIGHT_M - 0.3)], [0.22, 0.04], sides=7)
    tip = tube([(0, 0, SPRUCE_HEIGHT_M - 0.9), (0, 0, SPRUCE_HEIGHT_M)], [0.14, 0.01], sides=5)
    core = _build_tiers(_TIERS[detail], draw)
    return (
        (shade_smooth(stem), "bark"),
        (join_surfaces([needles, shade_smooth(tip)]), "needles"),
        (shade_smooth(core), "inner_needles"),
    )


def _find_spruce_reach(height_m: Float64Array) -> Float64Array:
    """Find how far the branches of a spruce reach at heights (n,)."""
    return 2.3 * (1.0 - height_m / SPRUCE_HEIGHT_M) ** 0.85


def _build_tiers(sides: tuple[int, int], draw: np.random.Generator) -> TriangleSurface:
    """Build the dense inside of a spruce: skirts one above the other, with uneven hems."""
    tiers, around = sides
    hems = np.linspace(1.25, SPRUCE_HEIGHT_M - 1.3, tiers)
    waists = hems + 0.8 * (SPRUCE_HEIGHT_M - 2.5) / tiers
    heights = np.stack([hems, waists], axis=1).ravel()
    radii = _find_spruce_reach(heights + 0.3) * np.tile([0.78, 0.42], tiers)
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(around)])
    rings = radii[:, None, None] * draw.uniform(0.8, 1.15, (2 * tiers, around, 1)) * ring
    rings[..., 2] = heights[:, None] + draw.uniform(-0.25, 0.25, (2 * tiers, around))
    return loft_rings(rings)


def _build_twigs(
    root: Float64Array,
    along: Float64Array,
    aside: Float64Array,
    count: int,
    draw: np.random.Generator,
) -> TriangleSurface:
    """Build twigs of branches (n, 3): a triangle each, shorter towards the end of the branch."""
    at = np.linspace(0.25, 0.9, count)[None, :, None]
    side = np.array([-1.0, 1.0])[None, None, :]
    at, side = np.broadcast_arrays(at, side)
    foot = root[:, None, None] + at[..., None] * along[:, None, None]
    length = np.linalg.norm(along, axis=1)[:, None, None] * (0.5 - 0.3 * at)
    length = length * draw.uniform(0.75, 1.25, (len(root), count, 2))
    onward = along / np.linalg.norm(along, axis=1, keepdims=True)
    reach = side[..., None] * aside[:, None, None] + 0.9 * onward[:, None, None]
    reach = normalize(reach + draw.normal(scale=0.12, size=reach.shape)) * length[..., None]
    half = along[:, None, None] * (0.42 / count)
    corners = np.stack([foot - half, foot + half, foot + reach], axis=-2).reshape(-1, 3)
    normals = np.repeat(onward + xyz(z=0.9), 2 * count, axis=0)
    normals = normalize(normals + draw.normal(scale=0.25, size=normals.shape))
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.repeat(normals, 3, axis=0))
