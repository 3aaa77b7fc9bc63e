"""Captures frames with every camera, LiDAR and radar of a scenario, in any order of frames."""

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain

import numpy as np
from advercity_dsl import Agent, RoadsideUnit, Spec, ThermalCamera
from advercity_dsl.sampling import Sampled
from numpy.typing import NDArray

from advercity.assets.body_pose import build_pose_box_fitter
from advercity.channel.transmission import Air, V2xChannel
from advercity.dataset.image_codec import quantise_depth
from advercity.errors import InputError
from advercity.frames import Frame
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.poses import Matrix
from advercity.physics.lamp_beams import LightSource
from advercity.physics.microwaves import fog_water_g_m3
from advercity.pipeline.frame_conditions import ConditionsByFrame
from advercity.pipeline.preparation import PreparedScenario
from advercity.rendering.backend import (
    CameraCapture,
    CameraView,
    Renderer,
    RenderProfile,
    check_capture,
)
from advercity.rendering.led_flicker import apply_led_flicker
from advercity.rendering.light_sources import list_light_sources
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.annotation import build_hull_point_lookup, count_lidar_hits, project_boxes
from advercity.sensors.camera import CameraExposure, ExposedImage, meter_image, render_image
from advercity.sensors.camera.lens_map import build_lens_map
from advercity.sensors.camera.moments import Instant, MomentBlender, list_moments
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.gnss import SkyView
from advercity.sensors.lidar import (
    ScanHits,
    cast_scan,
    measure_point_cloud,
)
from advercity.sensors.measurements import GnssFix, OpticalFlow
from advercity.sensors.optical_flow import CameraMotion, build_point_mover, measure_optical_flow
from advercity.sensors.radar import PlacedRadar, SceneMotion, scan_radar
from advercity.sensors.sample_times import SampleMoment
from advercity.sensors.sensor_frame import (
    CameraImage,
    LidarScan,
    RadarScan,
    SensorFrame,
    ThermalImage,
)
from advercity.sensors.thermal import cast_thermal, take_thermal_image
from advercity.world import World


@contextmanager
def open_sensors(prepared: PreparedScenario) -> Generator["SensorRig"]:
    """Open the world of a scenario in its backend, with a sensor at every mount.

    Loading or building the world and compiling shaders take seconds.
    """
    world = prepared.load_world()
    conditions = ConditionsByFrame(prepared.spec, prepared.poses.timeline)
    with prepared.backend.open(world, conditions.at(0).atmosphere, prepared.profile) as renderer:
        yield SensorRig(prepared, conditions, renderer, world)


class SensorRig:
    """The sensors of all agents of an open scenario."""

    def __init__(
        self,
        prepared: PreparedScenario,
        conditions: ConditionsByFrame,
        renderer: Renderer,
        world: World,
    ) -> None:
        spec = prepared.spec
        self._spec, self._profile, self._poses = spec, prepared.profile, prepared.poses
        self._backend_name = prepared.backend.name
        self._world, self._renderer, self._raycaster = world, renderer, Raycaster(world)
        self._sky = SkyView(self._raycaster)
        self._conditions_by_frame, self._conditions = conditions, conditions.at(0)
        self._placed_frame: Frame | None = None
        self._sampled_frames: dict[SampleMoment, Frame] = {}
        self._light_sources: dict[float, tuple[LightSource, ...]] = {}
        self._hull_points = build_hull_point_lookup(world.bodies)
        self._move_points = build_point_mover(world.bodies)
        trace = prepared.traffic.trace
        self._channel = V2xChannel(spec, spec.channel, trace, world) if spec.channel else None
        self._fit_boxes, self._min_points = build_pose_box_fitter(world.bodies), prepared.min_points

    def capture_frame(self, index: int) -> tuple[SensorFrame, ...]:
        """Capture what every agent senses in recorded frame `index`, in the spec's order."""
        frame, agents = self._place_frame(index), self._spec.agents
        motion = SceneMotion(frame, self._world.bodies)
        fixes = self._measure_fixes(frame)
        radars = {agent.id: self._poses.place_radars(agent, frame) for agent in agents}
        captures = self._render_captures(frame)
        return self._send_messages(
            [
                self._build_sensor_frame(
                    agent, frame, captures, radars, motion, fixes.get(agent.id)
                )
                for agent in agents
            ]
        )

    def capture_image(self, agent: Agent, camera: int, index: int) -> Uint8Array:
        """Render the image (h, w, 3), RGB, of one camera alone in recorded frame `index`."""
        frame = self._place_frame(index)
        capture = self._capture_moments(agent, [camera], frame)[0]
        sampled = self._find_camera_frame(agent, camera, frame)
        return self._render_image(capture, agent, camera, sampled).image

    def capture_camera(self, agent: Agent, camera: int, index: int) -> CameraCapture:
        """Render the light that arrives at one camera alone in recorded frame `index`."""
        frame = self._place_frame(index)
        return self._capture_moments(agent, [camera], frame)[0]

    def _render_captures(self, frame: Frame) -> Iterator[CameraCapture]:
        """Render the light at all cameras of the placed frame, by agents and their cameras."""
        agents = self._spec.agents
        if any(item.model.has_moments for agent in agents for item in agent.sensors.cameras):
            # Agent by agent, since the images of all would take much memory.
            return chain.from_iterable(
                self._capture_moments(agent, range(len(agent.sensors.cameras)), frame)
                for agent in agents
            )
        return self._renderer.render_cameras(
            [
                build_camera_view(agent, camera, pose, self._profile)
                for agent in agents
                for camera, pose in enumerate(self._poses.world_from_cameras(agent, frame))
            ]
        )

    def _capture_moments(
        self, agent: Agent, cameras: Sequence[int], frame: Frame
    ) -> list[CameraCapture]:
        """Render the light at some cameras of an agent, at all moments of their images."""
        frames = {camera: self._find_camera_frame(agent, camera, frame) for camera in cameras}
        captures: dict[int, CameraCapture] = {}
        for time_s, sampled in {one.time_s: one for one in frames.values()}.items():
            together = [camera for camera in cameras if frames[camera].time_s == time_s]
            found = self._capture_together(agent, together, sampled)
            captures |= dict(zip(together, found, strict=True))
        return [captures[camera] for camera in cameras]

    def _capture_together(
        self, agent: Agent, cameras: Sequence[int], frame: Frame
    ) -> list[CameraCapture]:
        """Render the light at cameras that take their images at one time."""
        blenders = {camera: self._build_blender(agent, camera, frame) for camera in cameras}
        instants = set[Instant]().union(*(one.instants for one in blenders.values()))
        for instant in sorted(instants, key=lambda one: (one.time_s, one.exposure_s or 0.0)):
            self._place_actors(self._advance_frame(frame, instant))
            poses_now = self._poses.world_from_cameras(agent, frame, time_s=instant.time_s)
            shown = [camera for camera in cameras if instant in blenders[camera].instants]
            captures = self._renderer.render_cameras(
                [
                    build_camera_view(agent, camera, poses_now[camera], self._profile)
                    for camera in shown
                ]
            )
            for camera, capture in zip(shown, captures, strict=True):
                blenders[camera].add(capture, instant)
        return [blenders[camera].finish() for camera in cameras]

    def _build_blender(self, agent: Agent, camera: int, frame: Frame) -> MomentBlender:
        kind = agent.sensors.cameras[camera].model
        shutter_s = kind.exposure.shutter_s
        if kind.is_metered_first:
            shutter_s = self._meter_shutter(agent, camera, frame)
        moments = list_moments(kind, shutter_s)
        return MomentBlender(moments, build_camera_model(agent, camera, self._profile))

    def _meter_shutter(self, agent: Agent, camera: int, frame: Frame) -> float:
        """Meter for how long a camera exposes the scene of the frame's instant, in seconds."""
        self._place_actors(frame)
        exposure = self._build_exposure(agent, camera, frame)
        return meter_image(
            self._renderer.render_camera(exposure.view),
            exposure,
            self._conditions.camera,
            mount=agent.sensors.cameras[camera].mount,
            carrier=agent.id,
        ).shutter_s

    def _advance_frame(self, frame: Frame, instant: Instant) -> Frame:
        """Advance actors to an instant, and let lamps flicker in its exposure."""
        then = frame.advance(instant.time_s) if instant.time_s else frame
        if instant.exposure_s is None:
            return then
        return apply_led_flicker(then, instant.exposure_s, seed=self._spec.seeds.traffic)

    def _place_actors(self, frame: Frame) -> None:
        if frame is not self._placed_frame:
            self._renderer.place(frame)
            self._placed_frame = frame

    def _place_frame(self, index: int) -> Frame:
        """Place weather and actors of recorded frame `index` in the renderer."""
        before, self._conditions = self._conditions, self._conditions_by_frame.at(index)
        atmosphere = self._conditions.atmosphere
        if atmosphere is not before.atmosphere:
            self._renderer.change_atmosphere(atmosphere)
            self._placed_frame = None
        frame = self._fit_boxes(self._poses.load_frame(index))
        self._place_actors(frame)
        self._sampled_frames, self._light_sources = {}, {}
        return frame

    def _find_light_sources(self, frame: Frame) -> tuple[LightSource, ...]:
        """Find the lamps that light the scene at a time; none by day."""
        if not self._conditions.atmosphere.night:
            return ()
        if frame.time_s not in self._light_sources:
            self._light_sources[frame.time_s] = tuple(list_light_sources(self._world, frame))
        return self._light_sources[frame.time_s]

    def _build_sensor_frame(
        self,
        agent: Agent,
        frame: Frame,
        captures: Iterator[CameraCapture],
        radars: Mapping[str, Sequence[PlacedRadar]],
        motion: SceneMotion,
        fix: GnssFix | None,
    ) -> SensorFrame:
        return self._poses.build_sensor_frame(
            agent,
            frame,
            readings={
                "camera": tuple(self._capture_images(agent, frame, captures)),
                "lidar": tuple(self._measure_scans(agent, frame)),
                "radar": tuple(self._scan_radars(agent, radars, motion)),
                "thermal": tuple(self._take_thermal_images(agent, frame)),
            },
            min_points=self._min_points,
            fix=fix,
        )

    def _measure_fixes(self, frame: Frame) -> dict[str, GnssFix | None]:
        """Measure the fixes of all receivers of satellites, by their agents' ids.

        All before the other sensors, since their rays are cast into a world without actors.
        """
        return {
            agent.id: self._poses.measure_fix(agent, frame, self._sky)
            for agent in self._spec.agents
            if agent.sensors.gnss.mode == "satellites"
        }

    def _send_messages(self, sensor_frames: Sequence[SensorFrame]) -> tuple[SensorFrame, ...]:
        """Add what every agent sends, if the scenario has a channel."""
        if self._channel is None:
            return tuple(sensor_frames)
        atmosphere = self._conditions.atmosphere
        fog = self._poses.timeline.weather_at(sensor_frames[0].frame.index).fog
        water_g_m3 = fog_water_g_m3(atmosphere.extinction.fog.at_550nm, fog.droplet_um)
        sent = self._channel.send(sensor_frames, Air(atmosphere.rain_mm_h, water_g_m3))
        return tuple(replace(item, sent=sent[item.agent.id]) for item in sensor_frames)

    def _measure_scans(self, agent: Agent, frame: Frame) -> Iterator[LidarScan]:
        for index, lidar in enumerate(agent.sensors.lidars):
            sampled = self._find_sampled_frame(agent, f"lidar{index}", lidar, frame)
            hits = self._cast_scan(agent, index, sampled)
            # The first LiDAR's key has no number, as in datasets of carriers with one.
            rng = self._poses.make_generator("lidar", agent, sampled, *([index] if index else []))
            cloud = measure_point_cloud(
                lidar, hits, self._conditions.lidar, rng, states=sampled.states
            )
            counted = count_lidar_hits(hits, lidar)
            yield LidarScan(hits.world_from_lidar, cloud, counted, _find_stamp(lidar, sampled))

    def _find_sampled_frame(self, agent: Agent, name: str, sensor: Sampled, frame: Frame) -> Frame:
        """Find the moment of a sensor's newest sample: mostly the frame itself."""
        if sensor.rate_hz is None:
            return frame
        moment = self._poses.find_sample(agent, name, sensor, frame.index)
        if moment not in self._sampled_frames:
            if moment.frame != frame.index:
                frame = self._fit_boxes(self._poses.load_frame(moment.frame))
            shifted = frame.advance(moment.shift_s) if moment.shift_s else frame
            self._sampled_frames[moment] = shifted
        return self._sampled_frames[moment]

    def _find_camera_frame(self, agent: Agent, camera: int, frame: Frame) -> Frame:
        """Find the moment that a camera's image shows."""
        kind = agent.sensors.cameras[camera].model
        return self._find_sampled_frame(agent, f"camera{camera}", kind, frame)

    def _cast_scan(self, agent: Agent, index: int, frame: Frame) -> ScanHits:
        lidar = agent.sensors.lidars[index]
        time = self._poses.find_scan_time(lidar, frame)
        previous = (
            self._poses.rewind_frame(frame, time.period_s) if lidar.motion_distortion else None
        )
        self._raycaster.place(frame, hide=_carrier_ids(agent), previous_frame=previous)
        return cast_scan(
            lidar,
            self._poses.world_from_lidars(agent, frame)[index],
            self._raycaster,
            previous_world_from_lidar=None
            if previous is None
            else self._poses.world_from_lidars(agent, previous)[index],
            puddle_coverage=self._conditions.lidar.puddle_coverage,
            time=time,
        )

    def _scan_radars(
        self, agent: Agent, radars: Mapping[str, Sequence[PlacedRadar]], motion: SceneMotion
    ) -> Iterator[RadarScan]:
        """Measure with the radars of an agent; all others of the scene disturb them."""
        for index, placed in enumerate(radars[agent.id]):
            sampled = self._find_sampled_frame(agent, f"radar{index}", placed.radar, motion.frame)
            self._raycaster.place(sampled, hide=_carrier_ids(agent))
            others = [other for one in radars.values() for other in one if other is not placed]
            rng = self._poses.make_generator("radar", agent, sampled, index)
            air = self._conditions.radar
            if sampled is not motion.frame:
                placed = self._poses.place_radars(agent, sampled)[index]
                moved = SceneMotion(sampled, self._world.bodies)
            else:
                moved = motion
            found = scan_radar(placed, others, self._raycaster, moved, air, rng)
            stamp_s = _find_stamp(placed.radar, sampled)
            yield RadarScan(placed.world_from_radar, found.detections, found.cube, stamp_s)

    def _take_thermal_images(self, agent: Agent, frame: Frame) -> Iterator[ThermalImage]:
        """Take the images of the thermal cameras of an agent."""
        seed = self._spec.seeds.sensors
        for number, mounted in enumerate(agent.sensors.thermals):
            camera, hide = mounted.model, _carrier_ids(agent)
            sampled = self._find_sampled_frame(agent, f"thermal{number}", camera, frame)
            pose = self._poses.world_from_thermals(agent, sampled)[number]
            conditions = self._conditions_by_frame.thermal_at(frame.index)
            model = build_thermal_model(camera, self._profile)
            view = cast_thermal(model, pose, sampled, self._raycaster, conditions, hide=hide)
            counts = take_thermal_image(
                camera,
                view,
                conditions,
                sampled.states,
                self._poses.make_generator("thermal", agent, sampled, number),
                seed=seed,
                name=f"{agent.id} {number}",
            )
            boxes = project_boxes(view.instance, pose, model, sampled, self._hull_points, hide=hide)
            stamp_s = _find_stamp(camera, sampled)
            yield ThermalImage(pose, counts, view.semantic, view.instance, boxes, stamp_s)

    def _capture_images(
        self, agent: Agent, frame: Frame, captures: Iterator[CameraCapture]
    ) -> Iterator[CameraImage]:
        for camera, mounted in enumerate(agent.sensors.cameras):
            kind, sampled = mounted.model, self._find_camera_frame(agent, camera, frame)
            pose = self._poses.world_from_cameras(agent, sampled)[camera]
            capture, model = next(captures), build_camera_model(agent, camera, self._profile)
            exposed = self._render_image(capture, agent, camera, sampled)
            lens_map = build_lens_map(model)
            seen = capture if lens_map is None else lens_map.select(capture)
            rolling = self._poses.find_rolling_camera(agent, camera, sampled)
            row_poses = rolling.find_row_poses(model.height_px) if rolling else pose[None]
            yield CameraImage(
                world_from_camera=pose,
                rolling=rolling,
                image=exposed.image,
                semantic=seen.semantic,
                depth_cm=quantise_depth(seen.depth),
                projected_boxes=project_boxes(
                    seen.instance,
                    pose,
                    model,
                    sampled,
                    self._hull_points,
                    hide=_carrier_ids(agent),
                    rolling=rolling,
                ),
                instance=seen.instance if "instance" in kind.truth else None,
                normal=_turn_normals(seen.normal, row_poses) if "normal" in kind.truth else None,
                flow=(
                    self._measure_flow(seen, agent, camera, frame, model)
                    if "flow" in kind.truth
                    else None
                ),
                hdr=exposed.hdr,
                raw=exposed.raw,
                readout=exposed.readout if kind.hdr or kind.raw else None,
                time_s=_find_stamp(kind, sampled),
            )

    def _measure_flow(
        self, seen: CameraCapture, agent: Agent, camera: int, frame: Frame, model: CameraModel
    ) -> OpticalFlow:
        after = self._poses.next_frame(frame)
        if after is None:
            return OpticalFlow.build_unknown((model.height_px, model.width_px))
        now, then = (self._poses.world_from_cameras(agent, one)[camera] for one in (frame, after))
        self._raycaster.place(after, hide=_carrier_ids(agent))
        motion = CameraMotion(model, (now, then), (frame, after))
        return measure_optical_flow(seen, motion, self._raycaster, self._move_points)

    def _render_image(
        self, capture: CameraCapture, agent: Agent, camera: int, frame: Frame
    ) -> ExposedImage:
        exposure = self._build_exposure(agent, camera, frame)
        check_capture(capture, exposure.view, self._backend_name)
        return render_image(
            capture,
            exposure,
            self._conditions.camera,
            self._poses.make_generator("camera", agent, frame, camera),
            mount=agent.sensors.cameras[camera].mount,
            carrier=agent.id,
        )

    def _build_exposure(self, agent: Agent, camera: int, frame: Frame) -> CameraExposure:
        pose = self._poses.world_from_cameras(agent, frame)[camera]
        return CameraExposure(
            view=build_camera_view(agent, camera, pose, self._profile),
            camera=agent.sensors.cameras[camera].model,
            frame=frame,
            velocity=self._poses.velocity(agent, frame),
            light_sources=self._find_light_sources(frame),
            lens_map=build_lens_map(build_camera_model(agent, camera, self._profile)),
            cover=self._raycaster.cover,
        )


def _find_stamp(sensor: Sampled, sampled: Frame) -> float | None:
    """Find the time of a sample; None of a sensor that samples with every frame."""
    return None if sensor.rate_hz is None else sampled.time_s


def build_camera_model(agent: Agent, number: int, profile: RenderProfile) -> CameraModel:
    """Build the projection of a camera by its number to an image at the scale of `profile`."""
    camera = agent.sensors.cameras[number].model
    return CameraModel.build(
        camera,
        max(1, round(camera.width_px * profile.scale)),
        max(1, round(camera.height_px * profile.scale)),
    )


def build_thermal_model(camera: ThermalCamera, profile: RenderProfile) -> CameraModel:
    """Build the projection of a thermal camera to an image at the scale of `profile`."""
    width_px, height_px = (
        max(1, round(side * profile.scale)) for side in (camera.width_px, camera.height_px)
    )
    return CameraModel.build_pinhole(camera.horizontal_fov_deg, width_px, height_px)


def find_agent_with_camera(spec: Spec, name: str | None, camera: int) -> Agent:
    """Find an agent, None for the ego; InputError if there is none, or it has no such camera."""
    agents = {agent.id: agent for agent in spec.agents}
    if name is not None and name not in agents:
        raise InputError(f"{spec.id} has no agent '{name}'; it has {', '.join(agents)}")
    agent = spec.ego if name is None else agents[name]
    count = len(agent.sensors.cameras)
    if not 0 <= camera < count:
        raise InputError(f"{agent.id} has cameras 0 to {count - 1}, not {camera}")
    return agent


def build_camera_view(
    agent: Agent, number: int, world_from_camera: Matrix, profile: RenderProfile
) -> CameraView:
    """Build the view to render for a camera by its number; `world_from_camera` in body axes."""
    model = build_camera_model(agent, number, profile)
    fov_rad = math.radians(agent.sensors.cameras[number].model.horizontal_fov_deg)
    width_px, height_px = model.rendered_size
    if not model.is_rendered:
        fov_rad = 2 * math.atan(width_px / (2 * model.rendered_focal_px))
    return CameraView(
        world_from_camera=world_from_camera,
        width_px=width_px,
        height_px=height_px,
        horizontal_fov_rad=fov_rad,
        hide=_carrier_ids(agent),
    )


def _turn_normals(normal: NDArray[np.float32], world_from_camera: Matrix) -> NDArray[np.float32]:
    """Turn vectors (h, w, 3) of the world into a camera's optical axes.

    Its poses (h, 4, 4) are those of all rows, or one (1, 4, 4) of the whole image.
    """
    rotations = poses.OPTICAL_FROM_BODY[:3, :3] @ world_from_camera[:, :3, :3].swapaxes(1, 2)
    return (normal @ rotations.swapaxes(1, 2)).astype(np.float32)


def _carrier_ids(agent: Agent) -> frozenset[int]:
    """List the actor that carries the sensor, which must be invisible to it."""
    return frozenset() if isinstance(agent.place, RoadsideUnit) else frozenset({agent.number})
