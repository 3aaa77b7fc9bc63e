"""Triangle surfaces: triangulation, joining, shading, and primitives."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from advercity.geometry import primitives
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    Wheel,
    build_meshes,
    build_ribbon,
    join_surfaces,
    mirror_surface,
    move_surface,
    shade_smooth,
    signed_volume,
    triangulate_polygon,
)
from advercity.semantics import Semantic

SHAPES = {
    "box": (primitives.box((0, 0, 0), (2, 3, 4)), 24.0),
    "plate": (primitives.plate([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 0.1), 0.1),
    "tube": (primitives.tube([(0, 0, 0), (0, 0, 5)], 1.0, sides=64), 5 * np.pi),
    "ellipsoid": (primitives.ellipsoid((1, 2, 3), (1, 2, 3), sides=64, bands=64), 8 * np.pi),
    "wheel": (primitives.revolve_profile([(1, 0), (1, 0.5)], (0, 0, 0), sides=64), np.pi / 2),
    "ring": (
        primitives.revolve_closed_profile([(1, 0), (2, 0), (2, 1), (1, 1)], (0, 0, 0), sides=64),
        3 * np.pi,
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_primitives_are_closed_and_wound_outward(name: str) -> None:
    surface, volume_m3 = SHAPES[name]
    edges = np.sort(surface.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert signed_volume(surface) == pytest.approx(volume_m3, rel=0.01)


def test_a_ribbon_faces_up_where_left_is_on_the_left() -> None:
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    ribbon = build_ribbon(line + np.array([0.0, 1, 0]), line)
    a, b, c = np.moveaxis(ribbon.vertices[ribbon.triangles], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_images_run_along_a_ribbon_in_metres_and_survive_joining() -> None:
    line = np.array([[0.0, 0, 0], [3, 4, 0], [3, 6, 0]])
    ribbon = build_ribbon(line + np.array([0.0, 0, 2]), line)
    along = [0.0, 5.0, 7.0]
    expected = np.column_stack([along * 2, [2.0] * 3 + [0.0] * 3])
    assert ribbon.uv is not None
    np.testing.assert_allclose(ribbon.uv, expected)
    mesh = join_surfaces([ribbon, ribbon]).to_mesh("wall", "brick", Semantic.WALL)
    assert mesh.uv is not None
    np.testing.assert_allclose(mesh.uv, np.vstack([expected, expected]))
    bare = TriangleSurface(ribbon.vertices, ribbon.triangles)
    assert join_surfaces([ribbon, bare]).uv is None


@pytest.mark.parametrize(
    "ring", [[(0, 0), (4, 0), (4, 4), (0, 4)], [(0, 0), (0, 4), (4, 4), (4, 0)]]
)
def test_polygons_are_triangulated_counter_clockwise_around_their_holes(
    ring: list[tuple[int, int]],
) -> None:
    polygon = shapely.Polygon(ring, [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    corners, triangles = triangulate_polygon(polygon)
    a, b, c = np.moveaxis(corners[triangles], 1, 0)
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (area > 0).all()
    assert area.sum() == pytest.approx(15)


def test_moving_and_mirroring_keep_a_surface_outward() -> None:
    cube = primitives.box((0, 0, 0), (1, 1, 1))
    assert signed_volume(move_surface(cube, (5, 0, 0), yaw=1.0)) == pytest.approx(1)
    assert signed_volume(mirror_surface(cube)) == pytest.approx(1)


def test_shading_splits_creases_and_smooths_shallow_edges() -> None:
    cube = shade_smooth(primitives.box((0, 0, 0), (1, 1, 1)))
    assert len(cube.vertices) > 8
    tube = shade_smooth(primitives.tube([(0, 0, 0), (0, 0, 5)], 1.0, sides=24))
    assert tube.normals is not None
    side = np.abs(tube.normals[:, 2]) < 0.1
    outward = tube.vertices[side, :2]
    np.testing.assert_allclose(tube.normals[side, :2], outward, atol=0.05)


def test_joined_surfaces_have_normals_only_if_all_of_them_have() -> None:
    flat = primitives.box((0, 0, 0), (1, 1, 1))
    shaded = shade_smooth(flat)
    assert join_surfaces([shaded, shaded]).normals is not None
    joined = join_surfaces([flat, shaded])
    assert joined.normals is None
    assert joined.triangles.max() == len(joined.vertices) - 1


def test_parts_of_one_material_class_and_wheel_become_one_mesh() -> None:
    cube = primitives.box((0, 0, 0), (1, 1, 1))
    wheel = Wheel((1.0, 0.8, 0.3))
    parts = [
        MeshPart(cube, "metal", Semantic.POLE),
        MeshPart(cube, "glass", Semantic.POLE),
        MeshPart(move_surface(cube, (2, 0, 0)), "metal", Semantic.POLE),
        MeshPart(cube, "metal", Semantic.POLE, wheel),
    ]
    meshes = build_meshes(parts, "a_")
    assert [mesh.name for mesh in meshes] == [
        "a_pole_glass",
        "a_pole_metal",
        "a_pole_metal_wheel_1",
    ]
    assert [mesh.wheel for mesh in meshes] == [None, None, wheel]
    assert len(meshes[1].vertices) == 2 * len(meshes[0].vertices)


def test_a_mesh_is_in_single_precision() -> None:
    mesh = TriangleSurface(np.eye(3), np.array([[0, 1, 2]])).to_mesh("a", "metal", Semantic.POLE)
    assert (mesh.vertices.dtype, mesh.triangles.dtype) == (np.float32, np.int32)


@given(
    place_m=st.tuples(*[st.floats(-500, 500)] * 3),
    yaw_rad=st.floats(-np.pi, np.pi),
    size=st.tuples(st.integers(2, 6), st.integers(2, 6)),
    is_turned=st.booleans(),
)
def test_a_sheet_is_seen_from_above_wherever_its_rows_lead(
    place_m: tuple[float, float, float], yaw_rad: float, size: tuple[int, int], is_turned: bool
) -> None:
    i, j = np.mgrid[: size[0], : size[1]]
    flat = (i + 1j * j) * np.exp(1j * yaw_rad)
    points = np.stack([flat.real, flat.imag, 0.2 * np.sin(i + j)], axis=-1) + place_m
    sheet = primitives.grid_sheet(points.transpose(1, 0, 2) if is_turned else points)
    corner = sheet.vertices[sheet.triangles]
    up = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2]
    assert (up > 0).all()
    assert up.sum() / 2 == pytest.approx((size[0] - 1) * (size[1] - 1), rel=1e-6)
