"""Distant leaves are drawn as few large ones."""

import numpy as np
import pytest
from advercity_sapien.leaf_levels import list_levels, thin_out

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh, TriangleSurface, normalize
from advercity.randomness import create_generator
from advercity.scene.foliage import build_leaves
from advercity.semantics import Semantic


def crown(count: int) -> Mesh:
    """Leaves on a sphere of 3 m around the origin."""
    draw = create_generator("test crown")
    outward = normalize(draw.normal(size=(count, 3)))
    leaves = build_leaves(3.0 * outward, draw.normal(size=outward.shape), outward, 0.2, draw)
    return leaves.to_mesh("crown", "leaves", Semantic.VEGETATION)


def measure_areas(mesh: Mesh) -> Float64Array:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]].astype(float) for corner in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0


def test_fewer_leaves_have_the_area_and_the_outline_of_all() -> None:
    whole = crown(8000)
    few = thin_out(whole, 4)
    assert len(few.triangles) == 2000
    assert measure_areas(few).sum() == pytest.approx(measure_areas(whole).sum(), rel=0.03)
    assert np.ptp(few.vertices, axis=0) == pytest.approx(np.ptp(whole.vertices, axis=0), rel=0.06)


def test_upright_blades_grow_wider_with_distance_but_never_longer() -> None:
    corners = np.array([[(x, 0, 0), (x + 0.01, 0, 0), (x, 0.1, 0.2)] for x in range(400)])
    triangles = np.arange(1200).reshape(-1, 3)
    whole = TriangleSurface(corners.reshape(-1, 3).astype(float), triangles).to_mesh(
        "verge", "grass_blades", Semantic.TERRAIN
    )
    few = thin_out(whole, 16)
    blades = few.vertices[few.triangles]
    assert len(blades) == 25
    assert blades[:, 2] == pytest.approx(corners[::16, 2])
    # One for sixteen is 16 to the power of 0.6 times as wide.
    assert np.ptp(blades[..., 0], axis=1) == pytest.approx(0.05278, rel=5e-3)


def test_every_size_of_a_pixel_has_one_level_and_coarser_ones_have_fewer_leaves() -> None:
    mesh = crown(8000)
    levels = [(thin_out(mesh, keep), pixel_m) for keep, pixel_m in list_levels(mesh)]
    assert [len(mesh.triangles) for mesh, _ in levels] == [8000, 2000, 500]
    (first, a), (b, c), (d, last) = (pixel_m for _, pixel_m in levels)
    assert (first, a, c, last) == (0.0, b, d, np.inf)
    # A leaf is as large as a square of 0.107 m: two pixels where one is 5.4 cm.
    assert a == pytest.approx(0.0535, rel=0.05)
    assert c == pytest.approx(2.0 * a)


def test_what_has_few_leaves_or_none_has_one_level() -> None:
    wall = Mesh(
        "wall", np.eye(3, dtype=np.float32), np.zeros((900, 3), np.int32), "brick", Semantic.WALL
    )
    for mesh in (crown(50), wall):
        assert [keep for keep, _ in list_levels(mesh)] == [1]
