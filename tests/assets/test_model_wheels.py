"""Wheels that turn as far as their vehicle goes, and steer."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from advercity_dsl import Blueprint, BodyModel

from advercity.assets.bodies import build_body
from advercity.assets.body_pose import compute_wheel_pose
from advercity.assets.model_store import ModelStore
from advercity.frames import Actor, ActorState, Lamp
from advercity.geometry.mesh import Wheel
from advercity.geometry.poses import transform_points
from advercity.world import Body
from tests.shipped import CATALOGUE, ShippedBodies

WHEELED = ShippedBodies("car", "van", "truck", "motorcycle")
CAR = Actor(7, "car", "lincoln_mkz_2017", "car_paint_blue", (4.9, 2.1, 1.5))
every_vehicle = pytest.mark.parametrize("name", WHEELED)


def driving(travelled_m: float = 0.0, steering_rad: float = 0.0) -> ActorState:
    return ActorState(
        CAR, np.eye(4), 9.0, 0.0, Lamp(0), steering_rad=steering_rad, travelled_m=travelled_m
    )


def wheels_of(whole: Body) -> set[Wheel]:
    return {part.wheel for part in whole.parts if part.wheel is not None}


def points_of(whole: Body, wheel: Wheel) -> np.ndarray:
    own = [part for part in whole.parts if part.wheel == wheel]
    return np.concatenate([part.vertices[np.unique(part.triangles)] for part in own])


def test_a_wheel_rolls_by_distance_over_radius():
    wheel = Wheel((1.5, 0.8, 0.3))
    quarter = compute_wheel_pose(driving(travelled_m=0.3 * np.pi / 2), wheel)
    # What was on top is ahead now, what was ahead is on the ground, the hub is where it was.
    np.testing.assert_allclose(
        transform_points(quarter, [1.5, 0.8, 0.6]), [1.8, 0.8, 0.3], atol=1e-12
    )
    np.testing.assert_allclose(
        transform_points(quarter, [1.8, 0.8, 0.3]), [1.5, 0.8, 0.0], atol=1e-12
    )
    np.testing.assert_allclose(transform_points(quarter, wheel.hub), wheel.hub, atol=1e-12)


def test_steered_wheels_turn_left_about_their_own_centres():
    state, hub = driving(steering_rad=np.pi / 6), (1.5, 0.8, 0.3)
    turn = compute_wheel_pose(state, Wheel(hub, is_steered=True))
    ahead = (1.5 + 0.3 * np.cos(np.pi / 6), 0.8 + 0.15, 0.3)
    np.testing.assert_allclose(transform_points(turn, [1.8, 0.8, 0.3]), ahead, atol=1e-12)
    np.testing.assert_allclose(compute_wheel_pose(state, Wheel(hub)), np.eye(4), atol=1e-12)


@every_vehicle
def test_a_vehicle_rests_on_wheels_and_the_front_ones_steer(name: str):
    whole, blueprint = WHEELED[name], CATALOGUE.blueprints[name]
    wheels = sorted(wheels_of(whole))
    steering = [wheel for wheel in wheels if wheel.is_steered]
    if blueprint.actor_class == "motorcycle":
        assert len(wheels) == 2
        assert not steering
    elif blueprint.semitrailer:
        middles = sorted({round(wheel.hub[0], 2) for wheel in wheels})
        # Three axles, 1.31 m apart, with their middle 9.3 m behind the front.
        assert middles == pytest.approx([-3.81, -2.5, -1.19], abs=0.02)
        assert not steering
        return
    else:
        left, right = sorted(steering, key=lambda wheel: -wheel.hub[1])
        assert left.hub[0] == pytest.approx(right.hub[0])
        assert left.hub[1] == pytest.approx(-right.hub[1]) and left.hub[1] > 0.25 * whole.size[1]
        assert left.hub[0] > 0.2 * whole.size[0]
        assert len(wheels) >= 3
    assert wheels[0].hub[0] < -0.2 * whole.size[0]
    # Trucks have painted discs with dark holes.
    disc = {"car_paint_silver", "black_plastic"} if blueprint.actor_class == "truck" else {"metal"}
    assert {part.material for part in whole.parts if part.wheel} == {"rubber", *disc}


@every_vehicle
def test_a_wheel_that_rolls_stays_on_the_ground_and_in_its_box(name: str):
    whole = WHEELED[name]
    for wheel in wheels_of(whole):
        for travelled_m in np.linspace(0.0, 2.0 * np.pi * wheel.radius_m, 9):
            turn = compute_wheel_pose(driving(travelled_m=travelled_m), wheel)
            points = transform_points(turn, points_of(whole, wheel))
            assert abs(points[:, 2].min()) < 0.02
            assert (np.abs(points[:, :2]) < np.array(whole.size[:2]) / 2 + 0.01).all()


def test_a_wheel_does_not_look_the_same_a_little_later():
    whole = WHEELED["nissan_micra"]
    wheel = min(wheels_of(whole))
    rim = [part for part in whole.parts if part.wheel == wheel and part.material == "metal"]
    points = rim[0].vertices.astype(np.float64)
    later = transform_points(compute_wheel_pose(driving(travelled_m=0.1), wheel), points)
    nearest = np.linalg.norm(later[:, None] - points, axis=2).min(axis=1)
    assert nearest.max() > 0.02


def model_car(steering_rad: float) -> bytes:
    """A GLB of a car with round tyres and square rims, y up, front along z, its front steered."""
    scene = trimesh.Scene()

    def add(mesh: trimesh.Trimesh, name: str, at: tuple[float, ...], turn_rad: float = 0.0) -> None:
        pose = trimesh.transformations.rotation_matrix(turn_rad, (0, 1, 0))
        pose[:3, 3] = at
        scene.add_geometry(mesh, geom_name=name, transform=pose)

    about_x = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    add(trimesh.creation.box((1.8, 0.9, 4.4)), "body_paint", (0, 0.85, 0))
    add(trimesh.creation.box((1.5, 0.3, 2.0)), "window", (0, 1.35, 0))
    for number, (x, z) in enumerate([(0.75, 1.4), (-0.75, 1.4), (0.75, -1.4), (-0.75, -1.4)]):
        turn_rad = steering_rad if z > 0 else 0.0
        tyre = trimesh.creation.annulus(0.2, 0.32, 0.2, transform=about_x, sections=24)
        add(tyre, f"tyre_{number}", (x, 0.32, z), turn_rad)
        add(trimesh.creation.box((0.1, 0.15, 0.25)), f"rim_{number}", (x, 0.32, z), turn_rad)
    exported = scene.export(file_type="glb")
    assert isinstance(exported, bytes)
    return exported


@pytest.mark.parametrize("steering_deg", [0.0, 25.0])
def test_wheels_of_a_model_are_found_by_their_tyres_and_straightened(
    tmp_path: Path, steering_deg: float
):
    path, here = tmp_path / "model.glb", ModelStore(tmp_path / "shelf")
    path.write_bytes(model_car(np.radians(steering_deg)))
    model = BodyModel(file="model.glb", sha256=here.add_model(path), author="A", licence="MIT")
    made = Blueprint(actor_class="car", length_m=4.4, width_m=1.8, height_m=1.5, model=model)
    whole = build_body("own", made, here)
    wheels = sorted(wheels_of(whole))

    assert [wheel.is_steered for wheel in wheels] == [False, True, True]
    np.testing.assert_allclose(wheels[0].hub, (-1.4, 0.0, 0.32), atol=0.01)
    np.testing.assert_allclose(wheels[1].hub, (1.4, -0.75, 0.32), atol=0.01)
    np.testing.assert_allclose(wheels[2].hub, (1.4, 0.75, 0.32), atol=0.01)
    front = points_of(whole, wheels[2])
    np.testing.assert_allclose(np.ptp(front, axis=0), (0.64, 0.2, 0.64), atol=0.02)
    assert {part.material for part in whole.parts if part.wheel == wheels[2]} == {"rubber", "metal"}
    assert not any(part.wheel for part in whole.parts if part.material in ("paint", "glass"))


def test_a_stretched_body_keeps_round_wheels():
    made = CATALOGUE.blueprints["nissan_micra"]
    for stretched in (made, made.model_copy(update={"length_m": 4.4, "height_m": 1.4})):
        whole = build_body("nissan_micra", stretched)
        wheel = max(wheels_of(whole))
        points = points_of(whole, wheel)
        assert np.ptp(points[:, 0]) == pytest.approx(np.ptp(points[:, 2]), rel=0.01)
        assert wheel.radius_m == pytest.approx(np.ptp(points[:, 2]) / 2, rel=0.01)


def test_steering_is_limited_by_the_wheel_arches():
    wheel = Wheel((1.5, 0.8, 0.3), is_steered=True)
    widest, more = (compute_wheel_pose(driving(steering_rad=angle), wheel) for angle in (1.0, 1.4))
    np.testing.assert_array_equal(widest, more)
