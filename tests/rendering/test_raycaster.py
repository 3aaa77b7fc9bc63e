import gc
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import invert_pose, pose_matrix, rotation_matrix, transform_points
from advercity.randomness import create_generator
from advercity.rendering.embree import EmbreeMesh
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.testing import build_box
from advercity.world import Body, Gait, World


def box(
    size: tuple[float, float, float],
    middle: tuple[float, float, float] = (0, 0, 0),
    material: str = "concrete",
    semantic: Semantic = Semantic.BUILDING,
) -> Mesh:
    return build_box(size, middle, material=material, semantic=semantic)


CAR = Body((box((4, 2, 1), (0, 0, 0.5), "paint", Semantic.VEHICLE),), (4, 2, 1))
GROUND = box((400, 400, 1), (0, 0, -0.5), "asphalt", Semantic.ROAD)
WALL = box((1, 40, 10), (20.5, 0, 5))


def caster(*static: Mesh) -> Raycaster:
    return Raycaster(World("tried", static, {"car": CAR}, (), Path("none")))


def car(actor_id: int, x: float, y: float = 0.0, *, yaw: float = 0.0) -> ActorState:
    actor = Actor(actor_id, "car", "car", "car_paint_red", CAR.size)
    return ActorState(actor, pose_matrix((x, y, 0), yaw=yaw), 0.0, 0.0, Lamp(0))


def frame(*states: ActorState) -> Frame:
    return Frame(0, 0.0, states, {})


def rays(origins: Any, directions: Any, **more: Any) -> Rays:
    return Rays(np.array(origins, np.float32), np.array(directions, np.float32), **more)


def forward(eye: Raycaster, *, height: float = 0.5, max_range_m: float = 100.0) -> RayHits:
    return eye.cast(rays([[0, 0, height]], [[1, 0, 0]]), max_range_m)


def test_a_ray_reports_what_it_hit() -> None:
    hits = forward(caster(GROUND, WALL))
    assert hits.range_m[0] == pytest.approx(20.0, abs=1e-4)
    np.testing.assert_allclose(hits.normal[0], [-1, 0, 0], atol=1e-6)
    assert hits.cosine[0] == pytest.approx(1.0)
    assert MATERIAL_NAMES[hits.material[0]] == "concrete"
    assert hits.semantic[0] == Semantic.BUILDING
    assert hits.instance[0] == 0


def test_meshes_that_are_parts_of_one_array_return_the_same_hits() -> None:
    meshes = (GROUND, WALL, box((1, 40, 10), (-20.5, 0, 5), "bark", Semantic.VEGETATION))
    vertices, triangles = (
        np.split(np.concatenate(rows), np.cumsum([len(row) for row in rows])[:-1])
        for rows in ([mesh.vertices for mesh in meshes], [mesh.triangles for mesh in meshes])
    )
    parts = [
        replace(mesh, vertices=points, triangles=corners)
        for mesh, points, corners in zip(meshes, vertices, triangles, strict=True)
    ]
    directions = create_generator("rays").normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    around = rays(np.tile([0.0, 0.0, 2.0], (200, 1)), directions)
    apart, joined = (caster(*each).cast(around, 100.0) for each in (meshes, parts))
    assert set(np.unique(apart.semantic)) == {0, *(mesh.semantic for mesh in meshes)}
    for item in fields(RayHits):
        np.testing.assert_array_equal(getattr(joined, item.name), getattr(apart, item.name))


def test_the_normal_faces_the_ray_and_the_cosine_is_of_its_angle() -> None:
    hits = caster(GROUND).cast(rays([[0, 0, 3]], [[0.8, 0, -0.6]]), 100.0)
    assert hits.range_m[0] == pytest.approx(5.0, abs=1e-4)
    assert hits.cosine[0] == pytest.approx(0.6)
    np.testing.assert_allclose(hits.normal[0], [0, 0, 1], atol=1e-6)


def test_what_is_beyond_the_range_is_missed() -> None:
    hits = forward(caster(WALL), max_range_m=19.9)
    assert hits.range_m[0] == np.inf
    assert not hits.semantic[0]
    assert not hits.normal.any()


def test_an_empty_world_misses_everything() -> None:
    assert forward(caster()).range_m[0] == np.inf


def test_a_mover_hides_the_wall_behind_it_and_wears_its_paint() -> None:
    eye = caster(GROUND, WALL)
    eye.place(frame(car(7, 12.0)))
    hits = forward(eye)
    assert hits.range_m[0] == pytest.approx(10.0, abs=1e-4)
    assert hits.instance[0] == 7
    assert hits.semantic[0] == Semantic.VEHICLE
    assert MATERIAL_NAMES[hits.material[0]] == "car_paint_red"


def test_a_mover_behind_the_wall_is_not_seen() -> None:
    eye = caster(WALL)
    eye.place(frame(car(7, 40.0)))
    assert forward(eye).instance[0] == 0


def test_movers_turn_with_their_pose() -> None:
    eye = caster()
    eye.place(frame(car(7, 12.0, yaw=np.pi / 2)))
    assert forward(eye).range_m[0] == pytest.approx(11.0, abs=1e-4)


def test_every_frame_starts_afresh() -> None:
    eye = caster(WALL)
    eye.place(frame(car(7, 12.0), car(8, 30.0)))
    eye.place(frame(car(8, 15.0)))
    assert forward(eye).instance[0] == 8
    eye.place(frame())
    assert forward(eye).range_m[0] == pytest.approx(20.0, abs=1e-4)


def test_rays_go_through_the_hidden_and_meet_what_is_behind() -> None:
    eye = caster(WALL)
    placed = frame(car(1, 0.0), car(7, 6.0), car(8, 12.0))
    eye.place(placed, frozenset({1, 7}))
    assert forward(eye).instance[0] == 8
    assert forward(eye).range_m[0] == pytest.approx(10.0, abs=1e-3)
    eye.place(placed, frozenset({1, 7, 8}))
    assert forward(eye).range_m[0] == pytest.approx(20.0, abs=1e-4)
    eye.place(placed)
    assert forward(eye).instance[0] == 1


def test_a_seen_mover_inside_a_hidden_one_is_met() -> None:
    eye = caster(WALL)
    eye.place(frame(car(1, 10.0), car(2, 11.0)), frozenset({1}))
    assert forward(eye).instance[0] == 2
    assert forward(eye).range_m[0] == pytest.approx(9.0, abs=1e-3)


def test_no_ray_slips_through_a_closed_box() -> None:
    eye = caster(replace(box((50, 50, 50)), name="shell"))
    directions = np.random.default_rng(3).normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = eye.cast(rays(np.zeros_like(directions), directions), 100.0)
    points = hits.range_m[:, None] * directions
    np.testing.assert_allclose(np.abs(points).max(axis=1), 25.0, atol=1e-4)


@pytest.mark.parametrize("rings", [64, 601])
def test_rays_in_rings_find_what_they_find_alone(rings: int) -> None:
    eye = caster(GROUND, WALL)
    places = [(9, 0), (4, 5), (-15, 3), (0, 12), (-40, 20), (60, 60), (2.5, -1.2)]
    cars = [car(number, x, y, yaw=x / 7) for number, (x, y) in enumerate(places, start=1)]
    eye.place(frame(*cars))
    bearing = np.arange(601) * (2 * np.pi / 601)
    elevation = np.radians(np.linspace(-25, 15, 64))
    around, up = np.meshgrid(bearing, elevation, indexing="ij")
    own = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)
    stand = pose_matrix((0, 0, 1.9), yaw=2.0, pitch=0.08, roll=-0.05)
    world = own.reshape(-1, 3) @ stand[:3, :3].T
    origins = np.broadcast_to(stand[:3, 3], world.shape)
    plain = rays(origins, world)
    ringed = replace(plain, rings=rings)
    whole = eye.cast(ringed, 100.0)
    assert set(whole.instance) == {0, 1, 2, 3, 4, 5, 6, 7}
    some = np.arange(0, len(world), 7)
    for rows, hits in (
        (np.arange(len(world)), eye.cast(plain, 100.0)),
        (some, eye.cast(ringed.select(some), 100.0)),
    ):
        np.testing.assert_array_equal(hits.instance, whole.instance[rows])
        np.testing.assert_allclose(hits.range_m, whole.range_m[rows], rtol=1e-6)
    alone = [
        eye.cast(plain.select(np.array([row])), 100.0).range_m[0] for row in range(0, 38_000, 999)
    ]
    np.testing.assert_allclose(alone, whole.range_m[:38_000:999], rtol=1e-6)


def test_moving_bodies_are_hit_anywhere_on_their_path_across_the_seam_of_the_compass() -> None:
    """Between two poses, against the mover placed at the pose between them."""
    eye, still = caster(), caster()
    first, last = car(7, 12.0, yaw=3.1), car(7, 13.0, yaw=-3.1)
    eye.place(frame(last), previous_frame=frame(first))
    around = np.linspace(-0.2, 0.2, 40)
    ahead = np.column_stack([np.cos(around), np.sin(around), np.zeros(40)])
    origins = np.full((40, 3), (0, 0, 0.5))
    for share in (0.0, 0.3, 0.8, 1.0):
        moment = np.full(40, share, np.float32)
        between = poses.interpolate_poses(first.world_from_body, last.world_from_body, [share])[0]
        still.place(frame(replace(last, world_from_body=between)))
        seen = eye.cast(rays(origins, ahead, time_fraction=moment), 100.0)
        wanted = still.cast(rays(origins, ahead), 100.0)
        np.testing.assert_array_equal(seen.instance, wanted.instance)
        np.testing.assert_allclose(seen.range_m, wanted.range_m, atol=2e-4)
        np.testing.assert_allclose(seen.normal, wanted.normal, atol=1e-5)


def test_rays_that_are_cast_again_meet_what_has_moved_since() -> None:
    eye = caster(WALL)
    ahead = rays([[0, 0, 0.5]], [[1, 0, 0]])
    ranges: list[float] = []
    for states in ((car(7, 12.0),), (car(7, 9.0),), ()):
        eye.place(frame(*states))
        ranges.append(float(eye.cast(ahead, 100.0).range_m[0]))
    assert ranges == pytest.approx([10.0, 7.0, 20.0], abs=1e-4)
    assert eye.cast(ahead, 15.0).range_m[0] == np.inf


def test_a_mover_is_met_where_it_is_at_the_moment_of_the_ray() -> None:
    eye = caster(WALL)
    eye.place(frame(car(7, 14.0)), previous_frame=frame(car(7, 12.0)))
    shares = np.array([0.0, 0.25, 1.0], np.float32)
    hits = eye.cast(rays([[0, 0, 0.5]] * 3, [[1, 0, 0]] * 3, time_fraction=shares), 100.0)
    np.testing.assert_allclose(hits.range_m, [10.0, 10.5, 12.0], atol=1e-4)
    assert (hits.instance == 7).all()


def test_a_turning_mover_shows_its_side_as_it_turns() -> None:
    eye = caster()
    eye.place(frame(car(7, 12.0, yaw=0.4)), previous_frame=frame(car(7, 12.0)))
    shares = np.array([0.0, 0.5, 1.0], np.float32)
    hits = eye.cast(rays([[0, 0, 0.5]] * 3, [[1, 0, 0]] * 3, time_fraction=shares), 100.0)
    np.testing.assert_allclose(hits.cosine, np.cos([0.0, 0.2, 0.4]), atol=1e-5)
    np.testing.assert_allclose(hits.normal[:, 1], -np.sin([0.0, 0.2, 0.4]), atol=1e-5)


def test_an_actor_that_was_absent_before_is_stationary() -> None:
    eye = caster()
    eye.place(frame(car(7, 12.0)), previous_frame=frame())
    hits = eye.cast(rays([[0, 0, 0.5]], [[1, 0, 0]], time_fraction=np.zeros(1, np.float32)), 100.0)
    assert hits.range_m[0] == pytest.approx(10.0, abs=1e-4)


def test_a_turned_bodys_normal_is_the_worlds() -> None:
    eye = caster()
    eye.place(frame(car(7, 12.0, yaw=0.3)))
    np.testing.assert_allclose(
        forward(eye).normal[0], rotation_matrix(yaw=0.3) @ [-1, 0, 0], atol=1e-6
    )


def test_poses_between_two_go_straight_and_turn_evenly() -> None:
    first, last = (
        pose_matrix((1, 2, 0), yaw=0.3, pitch=0.1),
        pose_matrix((3, 1, 1), yaw=0.9, pitch=-0.1),
    )
    between = poses.interpolate_poses(first, last, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(between[0], first, atol=1e-12)
    np.testing.assert_allclose(between[2], last, atol=1e-12)
    halves = [invert_pose(first) @ between[1], invert_pose(between[1]) @ last]
    np.testing.assert_allclose(halves[0][:3, :3], halves[1][:3, :3], atol=1e-12)
    np.testing.assert_allclose(between[1][:3, 3], [2, 1.5, 0.5])
    np.testing.assert_allclose(transform_points(between[1], np.zeros(3)), [2, 1.5, 0.5])


def build_bending_body() -> Body:
    """A column whose upper half leans ahead, by another angle in each of 16 poses."""
    lean = np.linspace(0.0, 1.2, 16)
    turns = np.zeros((16, 2, 3, 4), np.float32)
    turns[:, :, :, :3] = np.eye(3)
    turns[:, 1, :, :3] = [rotation_matrix(pitch=angle) for angle in lean]
    turns[:, 1, :, 3] = [[0, 0, 1] - rotation_matrix(pitch=angle) @ [0, 0, 1] for angle in lean]
    part = box((0.5, 0.5, 2), (0, 0, 1), "cloth_blue", Semantic.PEDESTRIAN)
    upper = (part.vertices[:, 2] > 1.0).astype(np.float32)
    part = replace(part, weights=np.stack([1 - upper, upper], axis=1))
    return Body((part,), (0.5, 0.5, 2), Gait(16.0, turns, returns_to_rest=True))


def test_hits_on_people_do_not_depend_on_the_poses_that_they_were_in_before() -> None:
    world = World("tried", (WALL,), {"walker": build_bending_body()}, (), Path("none"))
    actor = Actor(1, "pedestrian", "walker", "cloth_grey", (0.5, 0.5, 2))
    walker = ActorState(actor, pose_matrix((10, 0, 0)), 1.0, 0.0, Lamp(0))
    frames = [frame(replace(walker, travelled_m=float(metres))) for metres in (3, 9, 14, 6)]
    y, z = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0, 3, 61)))
    ahead = rays(np.column_stack([0 * y, y, z]), np.tile([1.0, 0.0, 0.0], (len(y), 1)))
    followed = Raycaster(world)
    seen: list[bytes] = []
    for moment in frames:
        alone = Raycaster(world)
        hits: list[RayHits] = []
        for eye in (followed, alone):
            eye.place(moment)
            hits.append(eye.cast(ahead, 100.0))
        for item in fields(RayHits):
            one, other = (getattr(found, item.name) for found in hits)
            np.testing.assert_array_equal(one, other)
        assert (hits[0].instance == 1).sum() > 100
        seen.append(hits[0].range_m.tobytes())
    assert len(set(seen)) == len(frames)


def test_poses_of_people_are_freed_and_met_again() -> None:
    lift = np.zeros((16, 1, 3, 4), np.float32)
    lift[:, :, :, :3], lift[:, 0, 2, 3] = np.eye(3), np.linspace(0.0, 10.0, 16)
    part = box((1, 1, 2), (0, 0, 1), "cloth_blue", Semantic.PEDESTRIAN)
    part = replace(part, weights=np.ones((len(part.vertices), 1), np.float32))
    body = Body((part,), (1, 1, 12), Gait(16.0, lift, returns_to_rest=True))
    eye = Raycaster(World("tried", (WALL,), {"car": CAR, "walker": body}, (), Path("none")))
    actor = Actor(1, "pedestrian", "walker", "cloth_grey", body.size)
    walker = ActorState(actor, pose_matrix((10, 0, 0)), 1.0, 0.0, Lamp(0))
    others = [car(2, 8, 5), car(3, 8, -5)]
    heights: list[int] = []
    held: list[int] = []
    for metres in (*range(40), 0):
        # Vehicles of a new kind come while poses change rows.
        eye.place(frame(*others[: metres % 3], replace(walker, travelled_m=float(metres))))
        up = np.arange(0.5, 13.0)
        origins = np.column_stack([np.zeros(13), np.zeros(13), up])
        hits = eye.cast(rays(origins, np.tile([1.0, 0.0, 0.0], (13, 1))), 100.0)
        seen = hits.semantic == Semantic.PEDESTRIAN
        np.testing.assert_array_equal(hits.instance, np.where(seen, 1, 0))
        np.testing.assert_array_equal(hits.normal[:, 0], np.where(seen | (up < 10.0), -1.0, 0.0))
        heights.append(int(seen.argmax()))
        gc.collect()
        held.append(sum(isinstance(item, EmbreeMesh) for item in gc.get_objects()))
    assert len(set(heights)) > 5
    assert heights[0] == heights[-1]
    # The world, the vehicle and one pose.
    assert max(held) - min(held) <= 1
