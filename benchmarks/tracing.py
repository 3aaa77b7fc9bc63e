"""Path-traced pictures against SAPIEN's `rt` pack and Mitsuba: `python benchmarks/tracing.py`.

All trace the ego's front camera at a sparse urban intersection by day, at the same small size with
the same samples and path depth, and without a denoiser. Mitsuba has all triangles in one mesh of
one diffuse material under an even sky, which asks less of it; it is measured where it is installed.
"""

import math
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import sapien
import trimesh
from camera import stock_pictures
from measurement import Figure, table

from advercity.compiler import read_spec
from advercity.frames import Frame
from advercity.geometry.poses import transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.pipeline.sensing import build_camera_view
from advercity.rendering.backend import CameraView, RenderProfile, load_backend
from advercity.world import World

SPEC, FRAME = Path("compiled/ui_clear_day_sparse.json"), 40
TRACED = RenderProfile("bench", 0.05, "ray_traced", samples=2, path_depth=2)


def figures(*, quick: bool) -> list[Figure]:
    """Our pack against the peers', each in a process of its own: the two packs do not mix."""
    rounds = 2 if quick else 5
    peers = {"SAPIEN's `rt` pack": sapien_s}
    if find_spec("mitsuba"):
        peers["Mitsuba's path tracer"] = mitsuba_s
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        own_s = pool.submit(ours_s, rounds).result()
        return [
            Figure(
                "traced picture, processor time",
                own_s / pool.submit(measure, rounds).result(),
                name,
            )
            for name, measure in peers.items()
        ]


class Scene:
    """What is traced."""

    def __init__(self) -> None:
        spec = read_spec(SPEC)
        stage = load_or_simulate_traffic(spec)
        viewpoints, ego = AgentPoses(spec, stage.trace), spec.agents[0]
        self.frame, self.world = (
            viewpoints.load_frame(FRAME),
            load_or_build_world(spec, stage.network_path),
        )
        self.air = compute_atmosphere(spec.weather, spec.road.land_use)
        self.view = build_camera_view(ego, viewpoints.world_from_cameras(ego, FRAME)[0], TRACED)


def ours_s(rounds: int) -> float:
    """Seconds of our picture."""
    scene = Scene()
    with load_backend("sapien").open(scene.world, scene.air, TRACED) as renderer:
        renderer.place(scene.frame)
        return _median_s(lambda: renderer.render_camera(scene.view), rounds)


def sapien_s(rounds: int) -> float:
    """Seconds of SAPIEN's picture."""
    sapien.render.set_ray_tracing_samples_per_pixel(TRACED.samples)
    sapien.render.set_ray_tracing_path_depth(TRACED.path_depth)
    scene = Scene()
    take = stock_pictures(scene.world, scene.air, scene.frame, [scene.view], pack="rt")
    return _median_s(take, rounds)


def mitsuba_s(rounds: int) -> float:
    """Seconds of Mitsuba's picture."""
    scene = Scene()
    return _median_s(mitsuba_picture(scene.world, scene.frame, scene.view), rounds)


def mitsuba_picture(world: World, frame: Frame, view: CameraView) -> Callable[[], object]:
    """Takes a picture with Mitsuba."""
    mitsuba: Any = import_module("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.ply"
        _everything(world, frame).export(file)
        scene: Any = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": TRACED.path_depth + 1},
                "all": {"type": "ply", "filename": str(file), "bsdf": {"type": "diffuse"}},
                "sky": {"type": "constant"},
                "camera": _mitsuba_camera(view, mitsuba.ScalarTransform4f()),
            }
        )
    return lambda: np.asarray(mitsuba.render(scene, spp=TRACED.samples))


def _mitsuba_camera(view: CameraView, identity: Any) -> dict[str, Any]:
    eye = view.world_from_camera[:3, 3]
    ahead, up = view.world_from_camera[:3, 0], view.world_from_camera[:3, 2]
    return {
        "type": "perspective",
        "fov": math.degrees(view.horizontal_fov_rad),
        "to_world": identity.look_at(eye.tolist(), (eye + ahead).tolist(), up.tolist()),
        "film": {"type": "hdrfilm", "width": view.width_px, "height": view.height_px},
    }


def _everything(world: World, frame: Frame) -> Any:
    """All triangles that are there in a frame."""
    there = [(mesh, np.eye(4)) for mesh in world.static]
    for state in frame.states:
        parts = world.bodies[state.actor.blueprint].parts
        there += [(mesh, state.world_from_body) for mesh in parts]
    meshes = [
        trimesh.Trimesh(transform_points(at, mesh.vertices), mesh.triangles, process=False)
        for mesh, at in there
    ]
    return trimesh.util.concatenate(meshes)


def _median_s(act: Callable[[], object], rounds: int) -> float:
    """Of processor time in all threads; the first time does not count."""
    taken: list[float] = []
    for _ in range(rounds + 1):
        began = time.process_time()
        act()
        taken.append(time.process_time() - began)
    return statistics.median(taken[1:])


if __name__ == "__main__":
    print(table(figures(quick=False)))
