"""Path-traced images against SAPIEN's `rt` pack and Mitsuba: `python benchmarks/tracing.py`.

All trace the ego's front camera at a sparse urban intersection by day, at the same small size with
the same samples and path depth, and without a denoiser. Mitsuba has all triangles in one mesh of
one diffuse material under a uniform sky, which is less work; it is measured if it is installed.

Our backend on Mitsuba is compared by samples per processor second, with that of Mitsuba's own path
tracer in the same variant and of our SAPIEN pack. Its images are larger, since it is for those.
"""

import math
import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from benchmark_scene import BenchmarkScene
from measurement import Measurement, format_table, measure_median_cpu_s
from stock_renderer import StockRenderer

from advercity.errors import BackendError, InputError
from advercity.rendering.backend import CameraView, RenderProfile, load_backend

SPEC, FRAME = Path("compiled/ui_clear_day_sparse.json"), 40
TRACED = RenderProfile("bench", 0.05, "ray_traced", samples=2, path_depth=2)
SAMPLED = RenderProfile("bench", 0.25, "ray_traced", samples=16, path_depth=4)
RATE_GOALS = {"Mitsuba's path tracer, same variant": 0.8, "SAPIEN backend": 20.0}
SAMPLED_BY_SAPIEN = replace(SAMPLED, scale=0.05)


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure our pack against the peers, each in a process of its own: two packs do not mix."""
    rounds = 2 if quick else 5
    peers = {"SAPIEN's `rt` pack": measure_sapien_s}
    if find_spec("mitsuba"):
        peers["Mitsuba's path tracer"] = measure_mitsuba_s
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        own_s = pool.submit(measure_own_s, rounds).result()
        times = {name: pool.submit(measure, rounds).result() for name, measure in peers.items()}
        rates = _measure_rates(pool, rounds) if find_spec("mitsuba") else {}
    return [
        *(
            Measurement("traced image, processor time", own_s / peer_s, name)
            for name, peer_s in times.items()
        ),
        *(
            Measurement(
                "Mitsuba backend, samples per processor second",
                rates["own"] / rates[name],
                name,
                at_least=goal,
            )
            for name, goal in RATE_GOALS.items()
            if rates
        ),
    ]


def _measure_rates(pool: ProcessPoolExecutor, rounds: int) -> dict[str, float]:
    """Measure samples per processor second; nothing where Mitsuba has no compiler."""
    try:
        load_backend("mitsuba").capabilities()
    except (BackendError, InputError):
        return {}
    measures = {
        "own": measure_backend_rate,
        "Mitsuba's path tracer, same variant": measure_mitsuba_rate,
        "SAPIEN backend": measure_sapien_rate,
    }
    return {name: pool.submit(measure, rounds).result() for name, measure in measures.items()}


def measure_backend_rate(rounds: int) -> float:
    """Measure our backend on Mitsuba."""
    return _measure_rate("mitsuba", SAMPLED, rounds)


def measure_sapien_rate(rounds: int) -> float:
    """Measure our backend on SAPIEN."""
    return _measure_rate("sapien", SAMPLED_BY_SAPIEN, rounds)


def _measure_rate(backend: str, profile: RenderProfile, rounds: int) -> float:
    scene, view = _load_scene(profile)
    with load_backend(backend).open(scene.world, scene.air, profile) as renderer:
        renderer.place(scene.frame)
        time_s = measure_median_cpu_s(lambda: renderer.render_camera(view), rounds, warm_up=1)
    return _count_samples(view, profile) / time_s


def measure_mitsuba_rate(rounds: int) -> float:
    """Measure Mitsuba's own path tracer in the variant of our backend."""
    scene, view = _load_scene(SAMPLED)
    # Our backend has found the compiler, which the variant needs.
    device = load_backend("mitsuba").capabilities().device
    variant = next(word for word in device.split() if "_" in word).rstrip(",")
    render = _build_mitsuba_renderer(scene, view, SAMPLED, variant)
    return _count_samples(view, SAMPLED) / measure_median_cpu_s(render, rounds, warm_up=1)


def _count_samples(view: CameraView, profile: RenderProfile) -> int:
    return view.width_px * view.height_px * profile.samples


def measure_own_s(rounds: int) -> float:
    """Measure our image."""
    scene, view = _load_scene(TRACED)
    with load_backend("sapien").open(scene.world, scene.air, TRACED) as renderer:
        renderer.place(scene.frame)
        return measure_median_cpu_s(lambda: renderer.render_camera(view), rounds, warm_up=1)


def measure_sapien_s(rounds: int) -> float:
    """Measure SAPIEN's image."""
    _, view = _load_scene(TRACED)
    with StockRenderer(SPEC, FRAME, [view], traced=TRACED) as stock:
        times_s = [stock.measure().cpu_s for _ in range(1 + rounds)]
    return statistics.median(times_s[1:])


def measure_mitsuba_s(rounds: int) -> float:
    """Measure Mitsuba's image."""
    render = _build_mitsuba_renderer(*_load_scene(TRACED), TRACED, "scalar_rgb")
    return measure_median_cpu_s(render, rounds, warm_up=1)


def _load_scene(profile: RenderProfile) -> tuple[BenchmarkScene, CameraView]:
    scene = BenchmarkScene(SPEC, FRAME)
    return scene, scene.list_views(scene.ego, profile)[0]


def _build_mitsuba_renderer(
    scene: BenchmarkScene, view: CameraView, profile: RenderProfile, variant: str
) -> Callable[[], object]:
    """Load a scene into Mitsuba, and return a function that renders it."""
    mitsuba: Any = import_module("mitsuba")
    mitsuba.set_variant(variant)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.ply"
        _merge_meshes(scene).export(file)
        loaded: Any = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": profile.path_depth + 1},
                "all": {"type": "ply", "filename": str(file), "bsdf": {"type": "diffuse"}},
                "sky": {"type": "constant"},
                "camera": _mitsuba_camera(view, mitsuba.ScalarTransform4f()),
            }
        )
    return lambda: np.asarray(mitsuba.render(loaded, spp=profile.samples))


def _mitsuba_camera(view: CameraView, identity: Any) -> dict[str, Any]:
    eye = view.world_from_camera[:3, 3]
    ahead, up = view.world_from_camera[:3, 0], view.world_from_camera[:3, 2]
    return {
        "type": "perspective",
        "fov": math.degrees(view.horizontal_fov_rad),
        "to_world": identity.look_at(eye.tolist(), (eye + ahead).tolist(), up.tolist()),
        "film": {"type": "hdrfilm", "width": view.width_px, "height": view.height_px},
    }


def _merge_meshes(scene: BenchmarkScene) -> Any:
    """Merge all meshes of the frame in world coordinates."""
    return trimesh.util.concatenate(
        [
            trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
            for mesh in scene.list_world_meshes(scene.frame)
        ]
    )


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False)))
