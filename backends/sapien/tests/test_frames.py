"""Frames after one another and cameras together, with both shader packs."""

import gc
from dataclasses import replace
from unittest.mock import create_autospec

import numpy as np
import pytest
import sapien
from advercity_sapien.culling import FrustumCuller
from advercity_sapien.sapien_scene import SapienScene
from advercity_sapien.shader_bindings import RasterBindings

from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.semantics import Semantic
from advercity.world import Body, Gait, World
from tests.box_scenes import (
    Open,
    air_of,
    frame_of,
    grey,
    state,
    uniform,
    view_of,
    world_of,
)
from tests.render_builders import (
    build_box,
)

pytestmark = [pytest.mark.render, pytest.mark.usefixtures("ideal_surfaces")]


def test_an_actor_that_leaves_disappears_and_its_bodies_serve_another(opened: Open) -> None:
    with opened(world_of(), air_of(sky=uniform(1000.0))) as renderer:
        seen: list[set[int]] = []
        for states in ((state(1, (8, 0, 0)),), (), (state(5, (9, 0, 0)),)):
            renderer.place(frame_of(*states))
            seen.append(set(np.unique(renderer.render_camera(view_of()).instance).tolist()))
    assert seen == [{0, 1}, {0}, {0, 5}]


def test_pictures_do_not_depend_on_what_was_rendered_before(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "asphalt")
    air = air_of(mor_m=300.0, sky=uniform(900.0), sun_lx=3e4, airlight=grey(900.0))
    frames = [frame_of(state(1, (8.0 + k, 1.0, 0.0)), index=k) for k in range(2)]
    views = [
        view_of(size=(64, 48)),
        view_of(pose_matrix((0, 0, 3), yaw=0.2), size=(64, 48), hide=1),
    ]

    def shoot(order: list[tuple[int, int]]) -> dict[tuple[int, int], bytes]:
        pictures: dict[tuple[int, int], bytes] = {}
        with opened(world_of(ground), air, samples=2, path_depth=2) as renderer:
            for frame, view in order:
                renderer.place(frames[frame])
                capture = renderer.render_camera(views[view])
                pictures[frame, view] = capture.radiance.tobytes() + capture.depth.tobytes()
        return pictures

    order = [(0, 0), (0, 1), (1, 0), (1, 1)]
    first, second = shoot(order), shoot(order[::-1])
    assert first == second
    assert len(set(first.values())) == 4


def walker_world() -> World:
    """A world with a walking body rising and sinking, in poses of some triangles each."""
    lift = np.zeros((16, 1, 3, 4), np.float32)
    lift[:, :, :, :3], lift[:, 0, 2, 3] = np.eye(3), np.linspace(0.0, 1.0, 16)
    part = build_box((0, 0, 1), (2, 2, 2), "paint", Semantic.PEDESTRIAN)
    part = replace(part, weights=np.ones((len(part.vertices), 1), np.float32))
    body = Body((part,), (2.0, 2.0, 3.0), Gait(16.0, lift, returns_to_rest=True))
    return world_of(bodies={"box": body})


def walkers_after(metres: int) -> Frame:
    """Two walkers; with each metre each takes another pose."""
    both = state(1, (8, 2, 0)), state(2, (8, -2, 0))
    walking = [replace(one, speed_m_s=1.0, travelled_m=float(metres)) for one in both]
    return frame_of(*walking, index=metres)


def test_poses_are_freed_and_look_the_same_when_they_return(opened: Open) -> None:
    pictures: list[bytes] = []
    air = air_of(sky=uniform(1000.0))
    with opened(walker_world(), air) as renderer:
        for metres in (0, 5, 9, 0):
            renderer.place(replace(walkers_after(metres), index=0))
            pictures.append(renderer.render_camera(view_of(size=(64, 48))).radiance.tobytes())
    assert pictures[0] == pictures[-1]
    assert len(set(pictures)) == 3


def count_meshes_of_people() -> int:
    gc.collect()
    held = [item for item in gc.get_objects() if isinstance(item, Mesh)]
    return sum(item.semantic == Semantic.PEDESTRIAN for item in held)


def test_a_scene_holds_no_more_poses_than_a_frame_has() -> None:
    before = count_meshes_of_people()
    scene = sapien.Scene([sapien.render.RenderSystem(sapien.Device("cpu"))])
    placed = SapienScene(walker_world(), scene, create_autospec(RasterBindings), night=False)
    for metres in range(40):
        placed.place_actors(walkers_after(metres))
        assert len(scene.entities) == 2
    assert count_meshes_of_people() - before <= 3


def test_pictures_taken_together_are_those_taken_one_by_one(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "asphalt")
    air = air_of(mor_m=300.0, sky=uniform(900.0), sun_lx=3e4, airlight=grey(900.0))
    far, near = pose_matrix((0, 0, 3), yaw=0.2), pose_matrix((0, 0, 1), yaw=-0.1)
    views = [
        view_of(far, size=(64, 48)),
        view_of(near, size=(64, 48), hide=1),
        view_of(near, size=(32, 24)),
        view_of(near, size=(64, 48)),
    ]
    with opened(world_of(ground), air, samples=2, path_depth=2) as renderer:
        renderer.place(frame_of(state(1, (8.0, 1.0, 0.0))))
        together = list(renderer.render_cameras(views))
        alone = [renderer.render_camera(view) for view in views]
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one.radiance, other.radiance)
        assert np.array_equal(one.depth, other.depth)
        assert np.array_equal(one.normal, other.normal)
        assert np.array_equal(one.instance, other.instance)
    assert {len(np.unique(one.instance)) for one in together} == {1, 2}


def show_all(*_: object) -> None:
    """Bodies are shown until they are left out."""


def test_what_is_left_out_of_a_picture_would_not_have_shown(
    opened: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    around = [(8 * np.cos(turn), 8 * np.sin(turn)) for turn in np.arange(24) * np.pi / 12]
    posts = [build_box((x, y, 2.0), (0.7, 0.7, 4.0)) for x, y in around]
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0))
    frame = frame_of(*(state(k, (1.5 * x, 1.5 * y, 0)) for k, (x, y) in enumerate(around, 1)))
    air = air_of(sky=uniform(900.0), sun_lx=3e4, sun_elevation_deg=20.0)
    views = [view_of(pose_matrix((0, 0, 1), yaw=yaw, pitch=0.1), hide=3) for yaw in (0.0, 0.4, 2.0)]

    def shoot() -> list[bytes]:
        with opened(world_of(ground, *posts), air) as renderer:
            renderer.place(frame)
            return [
                capture.radiance.tobytes() + capture.instance.tobytes()
                for capture in renderer.render_cameras(views)
            ]

    culled = shoot()
    monkeypatch.setattr(FrustumCuller, "show_only", show_all)
    assert shoot() == culled
