"""Helpers for tests of your own backends, sinks and tools: a fake backend and tiny worlds.

They need no graphics driver. No other module of advercity imports them.
"""

import functools
import hashlib
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from advercity_dsl import ActorClass, Spec

from advercity.compiler import (
    compile_suite,
    find_shipped_library,
    find_suite,
    load_library,
    with_digest,
)
from advercity.frames import Actor, ActorState, BodyMotion, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.pipeline import Progress, ScenarioResult
from advercity.rendering.backend import (
    CAPTURE_ARRAYS,
    Backend,
    CameraCapture,
    CameraView,
    Capabilities,
    Renderer,
    RenderProfile,
    check_capture,
)
from advercity.semantics import Semantic
from advercity.world import Body, World

__all__ = [
    "CAR",
    "BackendContract",
    "FakeBackend",
    "FakeRenderer",
    "RecordingListener",
    "build_box",
    "build_flat_world",
    "compile_shaped",
    "hash_tree",
    "load_example_spec",
    "make_actor_state",
    "make_capture",
    "make_frame",
    "with_small_sensors",
]

FAKE_RADIANCE_CD_M2 = 100.0
FAKE_DEPTH_M = 10.0

_CUBE_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
_CUBE_TRIANGLES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    np.int32,
)  # fmt: skip


def build_box(
    size: tuple[float, float, float],
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    material: str = "concrete",
    semantic: Semantic = Semantic.BUILDING,
) -> Mesh:
    """Build a closed box of length, width and height `size` in metres around `center`."""
    vertices = (_CUBE_CORNERS * np.array(size) + center).astype(np.float32)
    return Mesh(f"box {center}", vertices, _CUBE_TRIANGLES, material, semantic)


CAR = Body(
    (build_box((4.0, 2.0, 1.5), (0.0, 0.0, 0.75), material="paint", semantic=Semantic.VEHICLE),),
    (4.0, 2.0, 1.5),
)
"""A car as one box, origin on the ground under its middle."""


def build_flat_world(
    *static: Mesh,
    bodies: Mapping[str, Body] = MappingProxyType({"car": CAR}),
    material: str = "asphalt",
    size_m: float = 400.0,
) -> World:
    """Build a world of flat ground at height 0, `static` meshes on it, and bodies by blueprint."""
    ground = build_box(
        (size_m, size_m, 1.0), (0.0, 0.0, -0.5), material=material, semantic=Semantic.ROAD
    )
    return World("flat", (ground, *static), dict(bodies), lanes=(), network=Path("none"))


def make_actor_state(
    actor_id: int,
    x_m: float,
    y_m: float = 0.0,
    *,
    yaw_rad: float = 0.0,
    speed_m_s: float = 0.0,
    actor_class: ActorClass = "car",
    blueprint: str = "car",
    paint: str = "car_paint_red",
    size: tuple[float, float, float] = CAR.size,
) -> ActorState:
    """Place an actor on the ground of a flat world, lamps off."""
    actor = Actor(actor_id, actor_class, blueprint, paint, size)
    pose = pose_matrix((x_m, y_m, 0.0), yaw=yaw_rad)
    motion = BodyMotion(speed_m_s * pose[:3, 0], np.zeros(3), np.zeros(3))
    return ActorState(actor, pose, speed_m_s, 0.0, Lamp(0), motion=motion)


def make_frame(*states: ActorState, index: int = 0, time_s: float = 0.0) -> Frame:
    """Make a frame of actors, without signals."""
    return Frame(index, time_s, states, {})


def compile_shaped(*folders: Path, suite: str | None = None) -> list[Spec]:
    """Compile a suite as with `looks: shaped`: its specs run without asset packages."""
    paths = folders or (find_shipped_library(),)
    library = load_library(*paths)
    found = find_suite(library, *paths, suite=suite)
    return compile_suite(library, found.model_copy(update={"looks": "shaped"}))


@functools.cache
def _shipped_specs() -> dict[str, Spec]:
    return {spec.id: spec for spec in compile_shaped()}


def load_example_spec(spec_id: str = "ui_fog_day_sparse") -> Spec:
    """Compile a spec of the shipped library, without the models of packages, once per process."""
    return _shipped_specs()[spec_id]


_CHANNEL_TABLES = {
    "channel_table",
    "elevations_deg",
    "azimuth_offsets_deg",
    "channel_efficiency",
}
"""Fields of a LiDAR with a value per channel."""


def with_small_sensors(
    spec: Spec, *, width_px: int = 16, height_px: int = 16, channels: int = 1, azimuths: int = 16
) -> Spec:
    """Return the spec with few pixels and beams of cameras and LiDARs, for quick runs."""
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        sensors = agent["sensors"]
        for camera in _list_models(sensors, "camera"):
            camera |= {"width_px": width_px, "height_px": height_px}
        for lidar in _list_models(sensors, "lidar"):
            for table in _CHANNEL_TABLES & lidar.keys():
                del lidar[table]
            lidar |= {"channels": channels, "azimuths": azimuths}
        if radar := sensors.get("radar"):
            radar |= {"rays": 1000}
        if thermal := sensors.get("thermal"):
            thermal |= {"width_px": width_px, "height_px": height_px}
    return with_digest(Spec.model_validate(data))


def _list_models(sensors: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    models = (sensors.get(kind), *sensors.get(f"more_{kind}s", {}).values())
    return [model for model in models if model]


def make_capture(
    width_px: int,
    height_px: int,
    *,
    radiance_cd_m2: float = FAKE_RADIANCE_CD_M2,
    depth_m: float = FAKE_DEPTH_M,
    semantic: Semantic = Semantic.UNLABELED,
    actor_id: int = 0,
) -> CameraCapture:
    """Make a capture whose pixels are all the same: grey, at one depth, of one class."""
    shape = (height_px, width_px)
    return CameraCapture(
        radiance=np.full((*shape, 3), radiance_cd_m2, np.float32),
        depth=np.full(shape, depth_m, np.float32),
        normal=np.zeros((*shape, 3), np.float32),
        semantic=np.full(shape, semantic, np.uint8),
        instance=np.full(shape, actor_id, np.int32),
    )


class FakeRenderer:
    """Renders every pixel the same; `frames` and `atmospheres` record its input."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.atmospheres: list[Atmosphere] = []

    def change_atmosphere(self, atmosphere: Atmosphere) -> None:
        """Record the atmosphere."""
        self.atmospheres.append(atmosphere)

    def place(self, frame: Frame) -> None:
        """Record the frame."""
        self.frames.append(frame)

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Return a grey capture of the view's size."""
        return make_capture(view.width_px, view.height_px)

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Return grey captures, in order."""
        return map(self.render_camera, views)


class FakeBackend:
    """A backend without a device, installed as `--backend fake`."""

    name = "fake"

    def capabilities(self) -> Capabilities:
        """Claim everything, so the core adds nothing to the pixels."""
        return Capabilities(
            participating_medium=True,
            lamps=True,
            wet_surfaces=True,
            deterministic=True,
            ray_traced=False,
            hardware=False,
            device="fake",
        )

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> Generator[Renderer]:
        """Open a fake renderer; world, atmosphere and profile are ignored."""
        yield FakeRenderer()


class RecordingListener:
    """Keeps the progress and the results reported by a run."""

    def __init__(self) -> None:
        self.progress: list[Progress] = []
        self.results: list[ScenarioResult] = []

    def on_progress(self, progress: Progress) -> None:
        """Record progress of a scenario."""
        self.progress.append(progress)

    def on_result(self, result: ScenarioResult) -> None:
        """Record how a scenario ended."""
        self.results.append(result)


def hash_tree(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file below `folder`, by its relative path."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class BackendContract:
    """The contract of every backend: inherit it in a test class and define `make_backend`.

        class TestMyBackend(BackendContract):
            def make_backend(self) -> Backend:
                return MyBackend()

    pytest collects the tests of the subclass.
    """

    PROFILE = RenderProfile("contract", 1.0, "raster")
    VIEW = CameraView(pose_matrix((-12.0, 0.0, 1.5)), 32, 24, np.pi / 2)

    def make_backend(self) -> Backend:
        """Make the backend under test."""
        raise NotImplementedError

    @contextmanager
    def open_renderer(self, world: World, weather: str = "clear_day") -> Generator[Renderer]:
        """Open a world under a weather of the shipped library."""
        air = self.make_atmosphere(weather)
        with self.make_backend().open(world, air, self.PROFILE) as renderer:
            yield renderer

    def make_atmosphere(self, weather: str) -> Atmosphere:
        """Make the atmosphere of a weather of the shipped library."""
        from advercity.compiler import find_weather
        from advercity.physics.atmosphere import compute_atmosphere

        return compute_atmosphere(find_weather(weather).declaration, "urban")

    def test_a_capture_has_the_shapes_and_types_of_the_protocol(self) -> None:
        """Arrays are (h, w[, 3]) of the documented types."""
        with self.open_renderer(build_flat_world()) as renderer:
            renderer.place(make_frame(make_actor_state(7, 0.0)))
            check_capture(renderer.render_camera(self.VIEW), self.VIEW, self.make_backend().name)

    def test_the_same_frame_gives_the_same_bytes_whatever_was_placed_before(self) -> None:
        """Frames are independent: a run may ask for them in any order."""
        near, far = (make_frame(make_actor_state(7, x_m)) for x_m in (-4.0, 20.0))
        with self.open_renderer(build_flat_world()) as renderer:
            captures: list[CameraCapture] = []
            for frame in (near, far, near):
                renderer.place(frame)
                captures.append(renderer.render_camera(self.VIEW))
        for name in CAPTURE_ARRAYS:
            first, again = getattr(captures[0], name), getattr(captures[2], name)
            assert np.array_equal(first, again), f"{name} depends on the frames before"

    def test_several_cameras_give_what_each_gives_alone(self) -> None:
        """`render_cameras` keeps the order of its views."""
        views = [self.VIEW, CameraView(pose_matrix((0.0, 30.0, 1.5)), 16, 12, np.pi / 2)]
        with self.open_renderer(build_flat_world()) as renderer:
            renderer.place(make_frame(make_actor_state(7, 0.0)))
            together = list(renderer.render_cameras(views))
            alone = [renderer.render_camera(view) for view in views]
        for one, other in zip(together, alone, strict=True):
            assert np.array_equal(one.radiance, other.radiance)
            assert np.array_equal(one.instance, other.instance)

    def test_changed_air_and_light_are_those_of_a_scene_opened_with_them(self) -> None:
        """A weather may change from frame to frame, and to frames in any order."""
        world, frame = build_flat_world(), make_frame(make_actor_state(7, 0.0))
        weathers = ("fog_day", "clear_night", "clear_day")
        with self.open_renderer(world) as renderer:
            for weather in weathers:
                renderer.change_atmosphere(self.make_atmosphere(weather))
                renderer.place(frame)
                changed = renderer.render_camera(self.VIEW)
                with self.open_renderer(world, weather) as opened:
                    opened.place(frame)
                    expected = opened.render_camera(self.VIEW)
                assert np.array_equal(changed.radiance, expected.radiance), weather
