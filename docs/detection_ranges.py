"""Finds the ranges at which camera, LiDAR and radar still detect a car and a pedestrian.

The target is alone on a wide, level road, ahead of a vehicle at rest. A detection is

- by a camera if the target's luminance differs by 5 % from the scene without it in the mean
  over its pixels, the contrast that defines visibility; drops on the lens and noise do not count,
- by a LiDAR if five points are the target's,
- by a radar if one detection is.

For camera and radar the target is moved away in steps of 5 m until less than half of the scans
within a step detect it. Whether a LiDAR detects it depends on where its rings fall. So its range is
a mean over many placements, which are the same in all weathers: the fraction that is detected,
integrated over the distance.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Agent, Lidar, Mount, Spec, Weather
from numpy.typing import NDArray

from advercity.assets.bodies import build_body
from advercity.frames import Frame
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraView, Renderer, RenderProfile, load_backend
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.camera import CameraConditions, CameraExposure, add_air_effects
from advercity.sensors.lidar import cast_scan, derive_lidar_conditions, measure_point_cloud
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar import (
    PlacedRadar,
    SceneMotion,
    derive_radar_conditions,
    scan_radar,
)
from advercity.testing import build_flat_world, make_actor_state, make_frame

MIN_CONTRAST, MIN_POINTS = 0.05, 5
FARTHEST_M, STEP_M = 200, 5
SCANS, SCAN_STEP_M = 5, 1.0
PLACEMENT_STEP_M, PLACEMENTS = 10, 16
"""Of the LiDAR: steps of distance, and placements in each."""
MAX_LEFT_M, MAX_YAW_DEG, MAX_PITCH_DEG = 3.5, 15.0, 0.7
"""How far placements are to a side, how far targets turn, and how far the vehicle nods."""
LIDAR_SECTOR_DEG = (-12.0, 12.0)
"""Azimuths that are scanned, which hold all placements from 17 m on."""
CROP = 4
"""The camera's picture and its field of view are this many times smaller, which is enough."""
TARGET_ID = 7
LAND_USE = "urban"

Detector = Callable[[Frame, float], bool]
"""Whether a sensor of a vehicle that nods by an angle in rad detects the target of a frame."""


@dataclass(frozen=True)
class Target:
    """A road user that sensors look at from behind."""

    name: str
    blueprint: str
    paint: str


TARGETS = (
    Target("car", "seat_leon", "car_paint_silver"),
    Target("pedestrian", "pedestrian_0001", "cloth_grey"),
)


@dataclass(frozen=True)
class MeanRange:
    """A range over many placements, and half of its 95 % interval."""

    range_m: float
    error_m: float

    def __str__(self) -> str:
        return f"{self.range_m:.0f} ± {self.error_m:.0f}"


@dataclass(frozen=True)
class DetectionRanges:
    """Ranges at which sensors detect a target, at most `FARTHEST_M`."""

    camera_m: int
    lidar: MeanRange
    radar_m: int


class DetectionScene:
    """The first camera, LiDAR and radar of an agent, and a target ahead of them."""

    def __init__(self, spec: Spec, agent: Agent, target: Target) -> None:
        self._sensors, self._target = agent.sensors, target
        self._blueprint = spec.blueprints[target.blueprint]
        self._body = build_body(target.blueprint, self._blueprint)
        self._world = build_flat_world(bodies={target.blueprint: self._body}, size_m=1000.0)
        self._caster = Raycaster(self._world)

    def find_ranges(self, weather: Weather) -> DetectionRanges:
        """Find the ranges in a weather."""
        atmosphere = compute_atmosphere(weather, LAND_USE)
        profile = RenderProfile("ranges", 1.0, "raster")
        with load_backend("sapien").open(self._world, atmosphere, profile) as renderer:
            camera_m = self._find_range(self._build_camera_detector(renderer, weather))
        return DetectionRanges(
            camera_m=camera_m,
            lidar=self._measure_range(self._build_lidar_detector(weather)),
            radar_m=self._find_range(self._build_radar_detector(weather)),
        )

    def _find_range(self, detects: Detector) -> int:
        for distance_m in range(STEP_M, FARTHEST_M + 1, STEP_M):
            places_m = [distance_m + SCAN_STEP_M * step for step in range(SCANS)]
            found = [
                detects(self._place_target(place_m, index=round(place_m / SCAN_STEP_M)), 0.0)
                for place_m in places_m
            ]
            if 2 * sum(found) < SCANS:
                return distance_m - STEP_M
        return FARTHEST_M

    def _measure_range(self, detects: Detector) -> MeanRange:
        rng = create_generator("ranges", self._target.name)
        steps = range(0, FARTHEST_M, PLACEMENT_STEP_M)
        offsets = rng.random((len(steps), PLACEMENTS, 4))
        found = np.zeros(offsets.shape[:2])
        for row, column in np.ndindex(found.shape):
            along, *turns = offsets[row, column]
            left, yaw, pitch = 2.0 * np.array(turns) - 1.0
            frame = self._place_target(
                steps[row] + PLACEMENT_STEP_M * along,
                MAX_LEFT_M * left,
                math.radians(MAX_YAW_DEG) * yaw,
                index=row * PLACEMENTS + column,
            )
            found[row, column] = detects(frame, math.radians(MAX_PITCH_DEG) * pitch)
        fraction = found.mean(axis=1)
        variance = fraction * (1.0 - fraction) / (PLACEMENTS - 1)
        error = 1.96 * math.sqrt(variance.sum())
        return MeanRange(PLACEMENT_STEP_M * fraction.sum(), PLACEMENT_STEP_M * error)

    def _place_target(
        self, distance_m: float, left_m: float = 0.0, yaw_rad: float = 0.0, index: int = 0
    ) -> Frame:
        state = make_actor_state(
            TARGET_ID,
            distance_m + self._body.size[0] / 2,
            left_m,
            yaw_rad=yaw_rad,
            actor_class=self._blueprint.actor_class,
            blueprint=self._target.blueprint,
            paint=self._target.paint,
            size=self._body.size,
        )
        walked = replace(state, travelled_m=0.3 * distance_m)
        return make_frame(walked, index=index)

    def _build_camera_detector(self, renderer: Renderer, weather: Weather) -> Detector:
        mounted = self._sensors.cameras[0]
        camera = mounted.model
        view = CameraView(
            _build_pose(mounted.mount, 0.0),
            camera.width_px // CROP,
            camera.height_px // CROP,
            2 * math.atan(math.tan(math.radians(camera.horizontal_fov_deg) / 2) / CROP),
        )
        atmosphere = compute_atmosphere(weather, LAND_USE)
        air = CameraConditions.build(atmosphere, weather.lens, "ranges")

        def look(frame: Frame) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
            """Compute luminances (h, w) and where the target is (h, w)."""
            renderer.place(frame)
            exposure = CameraExposure(view, camera, make_frame(), velocity=np.zeros(3))
            capture = add_air_effects(renderer.render_camera(view), exposure, air)
            return capture.radiance @ LUMINANCE_WEIGHTS, capture.instance == TARGET_ID

        empty, _ = look(make_frame())

        def detects(frame: Frame, _: float) -> bool:
            luminance, on_target = look(frame)
            contrast = np.abs(luminance / empty - 1.0)[on_target]
            return bool(on_target.any()) and contrast.mean() >= MIN_CONTRAST

        return detects

    def _build_lidar_detector(self, weather: Weather) -> Detector:
        lidar = _narrow_lidar(self._sensors.lidars[0])
        atmosphere = compute_atmosphere(weather, LAND_USE)
        air = derive_lidar_conditions(atmosphere, weather.lens)

        def detects(frame: Frame, pitch_rad: float) -> bool:
            self._caster.place(frame)
            pose = _build_pose(lidar.mount, pitch_rad)
            hits = cast_scan(lidar, pose, self._caster, puddle_coverage=air.puddle_coverage)
            rng = create_generator("ranges", "lidar", frame.index)
            key = "ranges", frame.index
            cloud = measure_point_cloud(lidar, hits, air, rng, states=frame.states, window_key=key)
            on_target = (cloud.instance == TARGET_ID) & (cloud.kind == PointKind.SURFACE)
            return int(on_target.sum()) >= MIN_POINTS

        return detects

    def _build_radar_detector(self, weather: Weather) -> Detector:
        radar, mount, _ = self._sensors.radars[0]
        atmosphere = compute_atmosphere(weather, LAND_USE)
        air = derive_radar_conditions(atmosphere, weather.lens)
        placed = PlacedRadar(radar, mount, _build_pose(mount, 0.0), np.zeros(3))

        def detects(frame: Frame, _: float) -> bool:
            self._caster.place(frame)
            motion = SceneMotion(frame, self._world.bodies)
            rng = create_generator("ranges", "radar", frame.index)
            found = scan_radar(placed, (), self._caster, motion, air, rng).detections
            on_target = (found.instance == TARGET_ID) & (found.kind == PointKind.SURFACE)
            return bool(on_target.any())

        return detects


def _narrow_lidar(lidar: Lidar) -> Lidar:
    """Make a spinning LiDAR scan ahead only, as densely as before."""
    first_deg, last_deg = LIDAR_SECTOR_DEG
    azimuths = round(lidar.azimuths * (last_deg - first_deg) / 360.0)
    fields = {"azimuth_deg": LIDAR_SECTOR_DEG, "azimuths": azimuths}
    return Lidar.model_validate(lidar.model_dump() | fields)


def _build_pose(mount: Mount, pitch_rad: float) -> Matrix:
    return pose_matrix((mount.x_m, mount.y_m, mount.z_m), pitch=pitch_rad)
