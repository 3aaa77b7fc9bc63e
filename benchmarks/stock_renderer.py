"""SAPIEN's own packs on a scene of ours, which need a process of their own.

All packs of a process have vertices of one layout, and SAPIEN's have tangents, which ours lack.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from types import TracebackType

import numpy as np
import sapien
from advercity_sapien.backend import find_vulkan_device
from advercity_sapien.culling import SunShadow
from advercity_sapien.sapien_scene import SapienScene
from advercity_sapien.shader_bindings import RasterBindings
from advercity_sapien.shader_constants import FAR_M, NEAR_M
from advercity_sapien.shader_table import ShaderTable
from benchmark_scene import BenchmarkScene
from measurement import RunTime, measure_run_time
from numpy.typing import NDArray

from advercity.compiler import find_weather, with_weather
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.rendering.backend import CameraView, RenderProfile

SAPIEN_PACKS = Path(sapien.__file__).parent / "vulkan_shader"
_opened: list[Callable[[], None]] = []


class NullBindings(RasterBindings):
    """Bindings for SAPIEN's own packs, which know neither air nor lamps."""

    def __init__(self) -> None:
        """Make no textures."""

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Do nothing."""

    def set_lit_lamps(self, body: sapien.render.RenderBodyComponent, lamp_bits: int) -> None:
        """Do nothing."""

    def set_hidden(self, body: sapien.render.RenderBodyComponent, *, hidden: bool) -> None:
        """Do nothing."""

    def set_static_mesh(self, body: sapien.render.RenderBodyComponent, number: int) -> None:
        """Do nothing."""

    def upload_table(self, table: ShaderTable) -> None:
        """Do nothing."""

    def upload_contact(self, texels: NDArray[np.uint8]) -> None:
        """Do nothing."""


def build_stock_renderer(
    scene: BenchmarkScene, air: Atmosphere, views: Sequence[CameraView], pack: str
) -> Callable[[], None]:
    """Load a scene with a pack of SAPIEN's own, and return a function that renders some views.

    They have one size. It fetches as many channels as our renderer does.
    """
    device = sapien.Device(find_vulkan_device().sapien_name)
    stock = sapien.Scene([sapien.render.RenderSystem(device)])
    bodies = SapienScene(
        scene.world, stock, NullBindings(), night=air.night, has_distant_pieces=False
    )
    # SAPIEN's packs have room for one map of shadows.
    sun = SunShadow(air, stock, ((60.0, 36.0),))
    bodies.place_actors(scene.frame)
    width, height = views[0].width_px, views[0].height_px
    camera = sapien.render.RenderCameraComponent(width, height, str(SAPIEN_PACKS / pack))
    entity = sapien.Entity()
    entity.add_component(camera)
    stock.add_entity(entity)

    def render() -> None:
        for view in views:
            focal_px = width / 2.0 / math.tan(view.horizontal_fov_rad / 2.0)
            camera.set_perspective_parameters(
                NEAR_M, FAR_M, focal_px, focal_px, width / 2, height / 2, 0.0
            )
            entity.set_pose(sapien.Pose(view.world_from_camera))
            sun.update(view)
            stock.update_render()
            camera.take_picture()
            for name in ("Color", "Position", "Segmentation", "Normal"):
                camera.get_picture(name)

    return render


class StockRenderer:
    """Renders views of one size with SAPIEN's `default` pack, or traced with its `rt` pack.

    Args:
        spec_path: Scenario.
        frame_index: Frame.
        views: Views, which are rendered one after the other.
        weather: A weather in place of the scenario's own.
        traced: Samples and depth of paths; None for a raster image.
    """

    def __init__(
        self,
        spec_path: Path,
        frame_index: int,
        views: Sequence[CameraView],
        weather: str | None = None,
        *,
        traced: RenderProfile | None = None,
    ) -> None:
        arguments = (spec_path, frame_index, views, weather, traced)
        self._process = ProcessPoolExecutor(1, get_context("spawn"), _open, arguments)

    def measure(self) -> RunTime:
        """Render the views once; the time that it took, by the other process's clocks."""
        return self._process.submit(_measure).result()

    def __enter__(self) -> "StockRenderer":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.shutdown()


def _open(
    spec_path: Path,
    frame_index: int,
    views: Sequence[CameraView],
    weather: str | None,
    traced: RenderProfile | None,
) -> None:
    scene = BenchmarkScene(spec_path, frame_index)
    if traced is not None:
        sapien.render.set_ray_tracing_samples_per_pixel(traced.samples)
        sapien.render.set_ray_tracing_path_depth(traced.path_depth)
    air = scene.air
    if weather is not None:
        authored = with_weather(scene.spec, find_weather(weather)).weather
        air = compute_atmosphere(authored, scene.spec.road.land_use)
    _opened.append(build_stock_renderer(scene, air, views, "default" if traced is None else "rt"))


def _measure() -> RunTime:
    return measure_run_time(_opened[0])
