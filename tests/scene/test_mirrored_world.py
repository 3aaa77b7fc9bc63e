"""The world of a left-hand road is the mirror image of its plan, but for writing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.assets.lettering import WritingPlane, write_text
from advercity.geometry.mesh import Mesh, MeshPart, build_meshes, move_surface
from advercity.geometry.mirroring import mirror_mesh
from advercity.geometry.poses import mirror_pose, pose_matrix, to_yaw_pitch_roll
from advercity.geometry.primitives import box
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.roads.plan_frame import to_plan_spec
from advercity.scene.build import build_world
from advercity.scene.parking import find_parked_cars
from advercity.scene.rooms import code_panes, mirror_panes
from advercity.scene.world_storage import load_world, save_world
from advercity.semantics import Semantic
from advercity.world import World
from tests.roads.left_hand_roads import AXIS_Y_M, build_street

NETWORK = Path("road.net.xml")
MIRROR = np.array([1, -1, 1], np.float32)


@pytest.fixture(scope="module")
def spec(specs: dict[str, Spec]) -> Spec:
    return specs["ui_clear_day_sparse"].model_copy(
        update={"road": build_street(), "agents": (), "conflicts": ()}
    )


@pytest.fixture(scope="module")
def world(spec: Spec) -> World:
    return build_world(spec, NETWORK)


@pytest.fixture(scope="module")
def plan(spec: Spec) -> World:
    return build_world(to_plan_spec(spec), NETWORK)


def find_edges(mesh: Mesh) -> NDArray[np.float32]:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def test_meshes_are_mirror_images_with_the_same_side_outward(world: World, plan: World):
    assert [mesh.name for mesh in world.static] == [mesh.name for mesh in plan.static]
    for mesh, image in zip(world.static, plan.static, strict=True):
        plain = np.ones(len(image.vertices), bool)
        for first, last in image.writing:
            plain[first:last] = False

        assert (mesh.vertices[plain] == image.vertices[plain] * MIRROR).all()
        shown = plain[image.triangles[:, 0]]
        assert np.allclose(find_edges(mesh)[shown], find_edges(image)[shown] * MIRROR, atol=1e-3)
        if image.normals is not None and mesh.normals is not None:
            assert (mesh.normals == image.normals * MIRROR).all()
            here = np.sum(find_edges(mesh) * mesh.normals[mesh.triangles].sum(axis=1), axis=1)
            there = np.sum(find_edges(image) * image.normals[image.triangles].sum(axis=1), axis=1)
            assert np.allclose(here[shown], there[shown], atol=1e-3, rtol=1e-3)


def test_rays_find_the_mirror_image(world: World, plan: World):
    """As a LiDAR's without noise, from above the street, but for the millimetres of letters."""
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 360), np.linspace(-0.5, 0.3, 24))
    level = np.cos(rise)
    ways = np.stack([level * np.cos(turn), level * np.sin(turn), np.sin(rise)], axis=-1)
    ways = ways.reshape(-1, 3).astype(np.float32)
    eyes = np.tile(np.array([-60, AXIS_Y_M + 1.75, 2], np.float32), (len(ways), 1))

    found = Raycaster(world).cast(Rays(eyes, ways), 200.0)
    image = Raycaster(plan).cast(Rays(eyes * MIRROR, ways * MIRROR), 200.0)

    same = np.isclose(found.range_m, image.range_m, atol=0.02)
    assert np.isfinite(found.range_m).mean() > 0.6
    assert same.mean() > 0.999
    assert (found.semantic[same] == image.semantic[same]).mean() > 0.999
    assert np.allclose(found.cosine[same], image.cosine[same], atol=0.01)


def test_lanes_lamps_and_parked_cars_are_on_the_declared_side(world: World, spec: Spec):
    (lane,) = (lane for lane in world.lanes if lane.id == "main+.1")
    assert lane.left[0, 1] == pytest.approx(AXIS_Y_M + 3.5)
    (lamp,) = world.street_lamps
    assert np.hypot(lamp.position[0] + 50, lamp.position[1] - 20) < 3
    cars = find_parked_cars(spec)
    assert len(cars) > 10
    for car in cars:
        assert np.linalg.det(car.world_from_body[:3, :3]) == pytest.approx(1)
        if car.world_from_body[0, 3] < 30:
            # Beside the lane that leads east, and facing east.
            assert car.world_from_body[0, 0] == pytest.approx(1)
            assert AXIS_Y_M + 3.5 < car.world_from_body[1, 3] < AXIS_Y_M + 6


def test_vehicles_have_headlamps_for_the_declared_side(world: World, plan: World, tmp_path: Path):
    assert world.is_left_hand
    assert not plan.is_left_hand
    save_world(world, tmp_path / "world.npz")
    assert load_world(tmp_path / "world.npz", world.network).is_left_hand


def test_writing_reads_from_left_to_right(world: World, plan: World):
    """Seen from in front, the letters of every line have the order and form of the plan's."""
    lines = 0
    for mesh, image in zip(world.static, plan.static, strict=True):
        for first, last in image.writing:
            lines += 1
            assert mesh.normals is not None
            assert image.normals is not None
            assert (mesh.normals[first] == image.normals[first] * MIRROR).all()
            seen, meant = (
                look_at(item.vertices[first:last], item.normals[first])
                for item in (mesh, image)
                if item.normals is not None
            )
            assert np.allclose(seen - seen.min(axis=0), meant - meant.min(axis=0), atol=1e-4)
    # The limit, signs of shops and of hoardings.
    assert lines > 4


def look_at(points: NDArray[np.float32], facing: NDArray[np.float32]) -> NDArray[np.floating]:
    """Coordinates (n, 2) to the right and up of points seen from in front."""
    right = np.array([-facing[1], facing[0], 0.0])
    return np.column_stack([points @ right, points[:, 2]])


@pytest.mark.parametrize("yaw_deg", [0, 35, 90, 200])
def test_a_line_is_where_its_mirror_image_would_be(yaw_deg: float):
    text = write_text("AB", WritingPlane((0.1, 0, 2), (0, 1, 0)), 0.5)
    placed = move_surface(text, (10, 4, 0), yaw=np.radians(yaw_deg))
    (mesh,) = build_meshes([MeshPart(placed, "metal", Semantic.TRAFFIC_SIGN)])

    mirrored = mirror_mesh(mesh)

    for end in (np.min, np.max):
        image = end(mesh.vertices * MIRROR, axis=0)
        assert end(mirrored.vertices, axis=0) == pytest.approx(image, abs=1e-5)
    assert mirrored.normals is not None
    along = np.sum(find_edges(mirrored) * mirrored.normals[mirrored.triangles[:, 0]], axis=1)
    assert (along > 0).all()


def test_images_on_a_mirrored_mesh_run_to_the_right():
    wall = box((0, 0, 0), (4, 1, 3))
    surface = replace(wall, uv=wall.vertices[:, [0, 2]])
    mesh = surface.to_mesh("wall", "metal", Semantic.BUILDING)

    mirrored = mirror_mesh(mesh)

    for one in (mesh, mirrored):
        assert one.uv is not None
        uv = one.uv[one.triangles]
        (ax, ay), (bx, by) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
        turned = ax * by - bx * ay
        front = find_edges(one)[:, 1] < -1
        # The front faces -y, where x runs to the right; that of the image faces +y.
        assert (turned[front if one is mesh else find_edges(one)[:, 1] > 1] > 0).all()


def test_panes_keep_their_rooms_and_covers():
    uv = code_panes(np.array([3, 63]), np.array([0, 5])).astype(np.float32)

    mirrored = mirror_panes(uv)

    assert (np.floor(mirrored) == np.floor(uv)).all()
    assert mirrored[0] == pytest.approx([3.75, 0.25])
    assert (mirror_panes(mirrored) == uv).all()


def test_mirrored_poses_turn_the_other_way_about():
    pose = pose_matrix((3, 4, 5), yaw=0.5, pitch=0.2, roll=-0.1)

    mirrored = mirror_pose(pose)

    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1)
    assert mirrored[:3, 3] == pytest.approx([3, -4, 5])
    assert to_yaw_pitch_roll(mirrored) == pytest.approx((-0.5, 0.2, 0.1))
    assert (mirror_pose(mirrored) == pose).all()
