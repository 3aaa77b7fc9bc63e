from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from advercity.poses import pose
from advercity.rendering.casting import MATERIAL_NAMES, Caster, Hits
from advercity.semantics import Semantic
from advercity.traffic.trace import Actor, ActorState, Frame, Lamp
from advercity.world.scene import Body, Mesh, World

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
SIDES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    np.int32,
)  # fmt: skip


def box(
    size: tuple[float, float, float],
    middle: tuple[float, float, float] = (0, 0, 0),
    material: str = "concrete",
    semantic: Semantic = Semantic.BUILDING,
) -> Mesh:
    vertices = (CORNERS * np.array(size) / 2 + middle).astype(np.float32)
    return Mesh("box", vertices, SIDES, material, semantic)


CAR = Body((box((4, 2, 1), (0, 0, 0.5), "paint", Semantic.VEHICLE),), (4, 2, 1))
GROUND = box((400, 400, 1), (0, 0, -0.5), "asphalt", Semantic.ROAD)
WALL = box((1, 40, 10), (20.5, 0, 5))


def caster(*static: Mesh) -> Caster:
    return Caster(World("tried", static, {"car": CAR}, (), Path("none")))


def car(actor_id: int, x: float, y: float = 0.0, *, yaw: float = 0.0) -> ActorState:
    actor = Actor(actor_id, "car", "car", "car_paint_red", CAR.size)
    return ActorState(actor, pose((x, y, 0), yaw=yaw), 0.0, 0.0, Lamp(0))


def frame(*states: ActorState) -> Frame:
    return Frame(0, 0.0, states, {})


def forward(eye: Caster, *, height: float = 0.5, max_range_m: float = 100.0) -> Hits:
    return eye.cast(np.array([[0.0, 0.0, height]]), np.array([[1.0, 0.0, 0.0]]), max_range_m)


def test_a_ray_tells_what_it_met() -> None:
    hits = forward(caster(GROUND, WALL))
    assert hits.range_m[0] == pytest.approx(20.0, abs=1e-4)
    np.testing.assert_allclose(hits.normal[0], [-1, 0, 0], atol=1e-6)
    assert hits.cosine[0] == pytest.approx(1.0)
    assert MATERIAL_NAMES[hits.material[0]] == "concrete"
    assert hits.semantic[0] == Semantic.BUILDING
    assert hits.instance[0] == 0


def test_the_normal_faces_the_ray_and_the_cosine_is_of_its_angle() -> None:
    down = np.array([[0.8, 0.0, -0.6]])
    hits = caster(GROUND).cast(np.array([[0.0, 0.0, 3.0]]), down, 100.0)
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
    hits = eye.cast(np.zeros_like(directions), directions, 100.0)
    points = hits.range_m[:, None] * directions
    np.testing.assert_allclose(np.abs(points).max(axis=1), 25.0, atol=1e-4)
