"""Builders for tests: a small library, and sensor frames of five agents on a sloping street."""

import functools
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Agent, Camera, Mount, Spec
from numpy.typing import NDArray

from advercity.compiler import with_digest
from advercity.compiler.crossing import compile_library
from advercity.dataset.manifest import Identity
from advercity.dataset.writer import ScenarioWriter
from advercity.diagnostics import DiagnosticsError
from advercity.errors import InputError
from advercity.frames import Actor, ActorState, BodyMotion, Frame, Lamp, Signal
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.randomness import create_generator
from advercity.run_options import DatasetOptions
from advercity.semantics import Semantic
from advercity.sensors.annotation import project_boxes
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import GnssFix, ImuSample, PointCloud, PointKind
from advercity.sensors.sensor_frame import (
    CameraImage,
    LidarScan,
    SensorFrame,
)
from advercity.testing import compile_shaped

IMAGE_SCALE = 1 / 20
SLOPE_RAD = np.deg2rad(-4.0)
POINTS_PER_ACTOR = 40


SensorFramesOf = Callable[[int], tuple[SensorFrame, ...]]

ACTORS = (
    Actor(101, "car", "lincoln_mkz_2017", "car_paint_white", (4.9, 2.06, 1.51)),
    Actor(102, "car", "lincoln_mkz_2017", "car_paint_white", (4.9, 2.06, 1.51)),
    Actor(103, "car", "lincoln_mkz_2017", "car_paint_white", (4.9, 2.06, 1.51)),
    Actor(201, "van", "sprinter", "car_paint_red", (5.9, 2.0, 2.55)),
    Actor(202, "bicycle", "crossbike", "black_plastic", (1.5, 0.86, 1.1)),
    Actor(203, "pedestrian", "walker", "cloth_blue", (0.38, 0.38, 1.86)),
    Actor(204, "truck", "far_truck", "car_paint_blue", (8.0, 2.6, 3.6)),
)
PLACES = {
    101: (0.0, 0.0, 0.0),
    102: (22.0, 6.0, 180.0),
    103: (-18.0, -1.0, 8.0),
    201: (12.0, 5.0, 175.0),
    202: (9.0, -4.0, 20.0),
    203: (14.0, -6.0, 90.0),
    204: (320.0, 0.0, 0.0),
}
"""Along the street and to its left in metres, heading against it in degrees, at frame 0."""
SPEEDS = {101: 10.0, 102: 8.0, 103: 0.0, 201: 5.0, 202: 4.0, 203: 1.2, 204: 12.0}

WORLD_FROM_STREET = poses.pose_matrix((60.0, -30.0, 4.0), yaw=np.deg2rad(50.0), pitch=SLOPE_RAD)


def identify(spec: Spec, *, format: str = "opv2v", **renderer: str) -> Identity:
    """Identify the data of a spec whose traffic was not simulated, with clouds anybody can read."""
    return Identity.for_spec(
        spec,
        trace_sha256="0" * 64,
        world_sha256="0" * 64,
        renderer=dict(renderer),
        options=DatasetOptions(format=format, clouds="binary"),
    )


def write_scenario(
    root: Path,
    spec: Spec,
    sensor_frames_of: SensorFramesOf,
    *,
    frames: int = 1,
    format: str = "opv2v",
) -> Path:
    """Write the first frames of a scenario that are missing, and return its folder."""
    with ScenarioWriter(root, spec, identify(spec, format=format), length=frames) as writer:
        for index in sorted(set(range(frames)) - writer.done_frames):
            writer.write_frame(index, sensor_frames_of(index))
        writer.finish()
    return writer.scenario


@pytest.fixture(scope="session")
def specs(library: Path) -> dict[str, Spec]:
    """Every spec of the shipped library, by id, without the models of packages."""
    return {spec.id: spec for spec in compile_shaped(library)}


@pytest.fixture(scope="session")
def spec(specs: dict[str, Spec]) -> Spec:
    return specs["rcnj_fog_day_sparse"]


@pytest.fixture(scope="session")
def sensor_frames_of(spec: Spec) -> SensorFramesOf:
    """Returns the sensor frames of the five agents in a frame, by its index."""

    @functools.cache
    def sensor_frames(index: int) -> tuple[SensorFrame, ...]:
        frame = frame_of(spec, index)
        return tuple(sensor_frame_of(agent, frame) for agent in spec.agents)

    return sensor_frames


TWO_ROADS_FRAMES = 3


@pytest.fixture(scope="session")
def two_roads(
    tmp_path_factory: pytest.TempPathFactory,
    spec: Spec,
    specs: dict[str, Spec],
    sensor_frames_of: SensorFramesOf,
) -> Path:
    """A dataset of two scenarios with the same images, of different roads and densities."""
    root = tmp_path_factory.mktemp("two_roads")
    for one in (spec, specs["ui_clear_night_dense"]):
        write_scenario(root, one, sensor_frames_of, frames=TWO_ROADS_FRAMES)
    return root


def without_surroundings(spec: Spec) -> Spec:
    """Return a spec with a bare road, whose world opens in half the time."""
    return with_digest(
        spec.model_copy(update={"road": spec.road.model_copy(update={"surroundings": ()})})
    )


def ask_for_instances(spec: Spec) -> Spec:
    """Ask for images of actors' ids of all cameras."""
    agents = tuple(
        agent.model_copy(
            update={
                "sensors": agent.sensors.model_copy(
                    update={
                        "camera": agent.sensors.cameras[0].model.model_copy(
                            update={"truth": ("instance",)}
                        )
                    }
                )
            }
        )
        for agent in spec.agents
    )
    return with_digest(spec.model_copy(update={"agents": agents}))


def frame_of(spec: Spec, index: int) -> Frame:
    time_s = (spec.timing.warm_up_ticks + 1 + index) * spec.timing.tick_s
    states = tuple(state_of(actor, index * spec.timing.tick_s) for actor in ACTORS)
    return Frame(index, time_s, states, {"north": Signal.GREEN})


def state_of(actor: Actor, time_s: float) -> ActorState:
    along, left, heading = PLACES[actor.id]
    start = poses.pose_matrix((along, left, 0.0), yaw=np.deg2rad(heading))
    speed = SPEEDS[actor.id]
    pose = WORLD_FROM_STREET @ start @ poses.pose_matrix((speed * time_s, 0.0, 0.0))
    motion = BodyMotion(speed * pose[:3, 0], np.zeros(3), np.zeros(3))
    return ActorState(actor, pose, speed, 0.0, Lamp.LOW_BEAM, motion=motion)


def sensor_frame_of(agent: Agent, frame: Frame) -> SensorFrame:
    is_vehicle = agent.place.kind == "vehicle"
    world_from_agent = agent_pose(agent, frame)
    level = world_from_agent if is_vehicle else poses.pose_matrix(world_from_agent[:3, 3])
    mounts = [lidar.mount for lidar in agent.sensors.lidars]
    drift = poses.pose_matrix((0.3, -0.2, 0.05))
    return SensorFrame(
        agent=agent,
        frame=frame,
        world_from_agent=world_from_agent,
        estimated_world_from_agent=world_from_agent if is_vehicle else drift @ world_from_agent,
        readings={
            "camera": tuple(
                image_of(agent, camera, frame, world_from_agent @ mounted_at(mount))
                for camera, mount, _ in agent.sensors.cameras
            ),
            "lidar": tuple(scan(agent, frame, level @ mounted_at(mount)) for mount in mounts),
            "gnss": [GnssFix(49.0 + 1e-6 * frame.index, 8.0, 120.5, frame.time_s)] * is_vehicle,
            "imu": [ImuSample(np.array([0.5, 0.25, 9.81]), np.array([0.01, 0.02, 0.03]), 1.25)]
            * is_vehicle,
        },
        planned_trajectory=((1.0, 2.0, 10.0), (3.0, 4.0, 5.0)) if is_vehicle else (),
    )


def mounted_at(mount: Mount) -> Matrix:
    angles = {"yaw": np.deg2rad(mount.yaw_deg), "pitch": np.deg2rad(mount.pitch_deg)}
    return poses.pose_matrix((mount.x_m, mount.y_m, mount.z_m), **angles)


def agent_pose(agent: Agent, frame: Frame) -> Matrix:
    if agent.place.kind == "vehicle":
        return frame.get_state(agent.number).world_from_body
    along = 16.0 if agent.number == -1 else -6.0
    yaw = 3.0 if agent.number == -1 else -0.5
    return WORLD_FROM_STREET @ poses.pose_matrix((along, -9.0, 6.0), yaw=yaw, pitch=0.2)


def scan(agent: Agent, frame: Frame, world_from_lidar: Matrix) -> LidarScan:
    """Points inside every other actor's box and one on the street, and the hits of every actor."""
    clouds: list[NDArray[np.float64]] = [
        poses.transform_points(WORLD_FROM_STREET, [[3.0, -2.0, 0.0]])
    ]
    ids = [np.zeros(1)]
    hits: dict[int, int] = {}
    for state in frame.states:
        rng = create_generator("scan", agent.number, state.actor.id, frame.index)
        offset = rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0), (POINTS_PER_ACTOR, 3))
        hits[state.actor.id] = POINTS_PER_ACTOR
        if state.actor.id != agent.number:
            clouds.append(poses.transform_points(state.world_from_body, offset * state.actor.size))
            ids.append(np.full(POINTS_PER_ACTOR, state.actor.id))
    points = poses.transform_points(poses.invert_pose(world_from_lidar), np.concatenate(clouds))
    instance = np.concatenate(ids).astype(np.int32)
    range_m = np.linalg.norm(points, axis=1)
    semantic = np.where(instance > 0, Semantic.VEHICLE, Semantic.ROAD)
    semantic[instance == 203] = Semantic.PEDESTRIAN
    ghost, surface = PointKind.GHOST, PointKind.SURFACE
    return LidarScan(
        world_from_lidar,
        PointCloud(
            points=points.astype(np.float32),
            raw=points.astype(np.float32),
            intensity=np.exp(-0.004 * range_m).astype(np.float32),
            ring=(np.arange(len(points)) % 32).astype(np.uint16),
            range_m=range_m.astype(np.float32),
            semantic=semantic.astype(np.uint8),
            instance=instance,
            time_s=np.zeros(len(points), np.float32),
            kind=np.where(np.arange(len(points)) % 7 == 3, ghost, surface).astype(np.uint8),
        ),
        hits,
    )


def image_of(agent: Agent, camera: Camera, frame: Frame, world_from_camera: Matrix) -> CameraImage:
    """Sky, and the box of every other actor, nearer ones in front of farther ones.

    The upper half of a bicycle's box is its rider.
    """
    rng = create_generator("picture", agent.number, frame.index)
    width, height = (round(side * IMAGE_SCALE) for side in (camera.width_px, camera.height_px))
    semantic = np.full((height, width), Semantic.SKY, dtype=np.uint8)
    instance = np.zeros((height, width), np.int32)
    model = CameraModel.build(camera, width, height)
    place = world_from_camera[:3, 3]
    for state in sorted(
        frame.states, key=lambda one: -np.linalg.norm(one.world_from_body[:3, 3] - place)
    ):
        corners = corners_of(state)
        points = poses.transform_points(poses.invert_pose(world_from_camera), corners)
        if state.actor.id == agent.number or points[:, 0].min() < 0.1:
            continue
        hull = cv2.convexHull(np.rint(model.pixels_from_camera(points)).astype(np.int32))
        on_foot = state.actor.actor_class == "pedestrian"
        tag = Semantic.PEDESTRIAN if on_foot else Semantic.VEHICLE
        cv2.fillConvexPoly(semantic, hull, int(tag))
        cv2.fillConvexPoly(instance, hull, state.actor.id)
        if state.actor.actor_class == "bicycle":
            is_rider = instance == state.actor.id
            is_rider[int(hull[..., 1].mean()) :] = False
            semantic[is_rider] = Semantic.PEDESTRIAN
    return CameraImage(
        world_from_camera=world_from_camera,
        image=rng.integers(0, 256, (height, width, 3), dtype=np.uint8),
        semantic=semantic,
        depth_cm=np.where(instance > 0, 2004, 65_535).astype(np.uint16),
        projected_boxes=project_boxes(
            instance,
            world_from_camera,
            model,
            frame,
            lambda state: state.box.corners,
            hide=frozenset({agent.number}),
        ),
        instance=instance if "instance" in camera.truth else None,
    )


def corners_of(state: ActorState) -> NDArray[np.float64]:
    """Corners (8, 3) of an actor's box in the world frame."""
    unit = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
    return poses.transform_points(state.world_from_body, unit * state.actor.size)


SMALL_LIBRARY = Path(__file__).parent / "compiler" / "base"
"""A library of one scenario."""
Write = Callable[..., Path]
"""Writes the small library with some files, by name without ending, and returns its folder."""
Compile = Callable[..., dict[str, Spec]]
"""Compiles the small library with some files to specs by id."""


def write_small_library(folder: Path, **files: str) -> Path:
    """Write the small library with more files, or others in place of its own, into a new folder."""
    shutil.copytree(SMALL_LIBRARY, folder)
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)
    return folder


def describe_errors(folder: Path) -> str:
    """Headlines of the errors with which a library does not compile, without the folder's path."""
    with pytest.raises(InputError) as caught:
        compile_library(folder)
    error = caught.value
    if isinstance(error, DiagnosticsError):
        text = "\n".join(diagnostic.headline for diagnostic in error.diagnostics)
    else:
        text = str(error)
    return text.replace(f"{folder}/", "")
