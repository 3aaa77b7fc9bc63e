"""Takes the images of the cameras of an open scenario."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.poses import Matrix
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile, check_capture
from advercity.rendering.led_flicker import apply_led_flicker
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.annotation import project_boxes
from advercity.sensors.camera.exposed_image import ExposedImage
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.image_formation import meter_image, render_image
from advercity.sensors.camera.lens_map import build_lens_map
from advercity.sensors.camera.moments import Instant, MomentBlender, list_moments
from advercity.sensors.camera.weather import CameraWeather
from advercity.sensors.camera_model import CameraModel, quantise_depth
from advercity.sensors.measurements import OpticalFlow
from advercity.sensors.optical_flow import CameraMotion, build_point_mover, measure_optical_flow
from advercity.sensors.rolling_shutter import RollingCamera, compute_row_times
from advercity.sensors.sensor_frame import CameraImage
from advercity.sensors.stage import SensorDriver, Stage, list_carrier_ids


class CameraDriver(SensorDriver):
    """Measures with cameras; renders the light for all agents together where possible."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._weather = CameraWeather(stage.spec, stage.poses.timeline)
        self._move_points = build_point_mover(stage.world.bodies)
        self._captures: Iterator[CameraCapture] = iter(())

    def prepare(self) -> None:
        """Begin to render the light at the cameras of all agents."""
        self._captures = self._render_captures()

    def measure(self, agent: Agent, number: int) -> CameraImage:
        """Form the image of the next camera."""
        stage, kind = self.stage, agent.sensors.cameras[number].model
        sampled = stage.find_sampled_frame("camera", agent, number)
        pose = stage.poses.world_from_sensors("camera", agent, sampled)[number]
        capture, model = next(self._captures), build_camera_model(agent, number, stage.profile)
        exposed = self._render_image(capture, agent, number, sampled)
        lens_map = build_lens_map(model)
        seen = capture if lens_map is None else lens_map.select(capture)
        rolling = find_rolling_camera(stage.poses, agent, number, sampled)
        row_poses = rolling.find_row_poses(model.height_px) if rolling else pose[None]
        return CameraImage(
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
                stage.find_hull_points,
                hide=list_carrier_ids(agent),
                rolling=rolling,
            ),
            instance=seen.instance if "instance" in kind.truth else None,
            normal=_turn_normals(seen.normal, row_poses) if "normal" in kind.truth else None,
            flow=self._measure_flow(seen, agent, number, model) if "flow" in kind.truth else None,
            hdr=exposed.hdr,
            raw=exposed.raw,
            readout=exposed.readout if kind.hdr or kind.raw else None,
            time_s=stage.find_stamp("camera", agent, number),
        )

    def capture(self, agent: Agent, number: int) -> CameraCapture:
        """Render the light at one camera alone."""
        return self._capture_moments(agent, [number])[0]

    def capture_image(self, agent: Agent, number: int) -> Uint8Array:
        """Render the image (h, w, 3), RGB, of one camera alone."""
        sampled = self.stage.find_sampled_frame("camera", agent, number)
        return self._render_image(self.capture(agent, number), agent, number, sampled).image

    def _render_captures(self) -> Iterator[CameraCapture]:
        """Render the light at all cameras of the placed frame, by agents and their cameras."""
        agents = self.stage.spec.recorded_agents
        if any(item.model.has_moments for agent in agents for item in agent.sensors.cameras):
            # Agent by agent, to save memory.
            return chain.from_iterable(
                self._capture_moments(agent, range(len(agent.sensors.cameras))) for agent in agents
            )
        return self.stage.renderer.render_cameras(
            [
                build_camera_view(agent, camera, pose, self.stage.profile)
                for agent in agents
                for camera, pose in enumerate(
                    self.stage.poses.world_from_sensors("camera", agent, self.stage.frame)
                )
            ]
        )

    def _capture_moments(self, agent: Agent, cameras: Sequence[int]) -> list[CameraCapture]:
        """Render the light at some cameras of an agent, at all moments of their images."""
        frames = {
            camera: self.stage.find_sampled_frame("camera", agent, camera) for camera in cameras
        }
        captures: dict[int, CameraCapture] = {}
        for time_s, sampled in {one.time_s: one for one in frames.values()}.items():
            together = [camera for camera in cameras if frames[camera].time_s == time_s]
            found = self._capture_together(agent, together, sampled)
            captures |= dict(zip(together, found, strict=True))
        return [captures[camera] for camera in cameras]

    def _capture_together(
        self, agent: Agent, cameras: Sequence[int], frame: Frame
    ) -> list[CameraCapture]:
        """Render the light at cameras with the same sample time."""
        blenders = {camera: self._build_blender(agent, camera, frame) for camera in cameras}
        instants = set[Instant]().union(*(one.instants for one in blenders.values()))
        for instant in sorted(instants, key=lambda one: (one.time_s, one.exposure_s or 0.0)):
            self.stage.place_renderer(self._advance_frame(frame, instant))
            poses_now = self.stage.poses.world_from_sensors(
                "camera", agent, frame, time_s=instant.time_s
            )
            shown = [camera for camera in cameras if instant in blenders[camera].instants]
            captures = self.stage.renderer.render_cameras(
                [
                    build_camera_view(agent, camera, poses_now[camera], self.stage.profile)
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
        return MomentBlender(moments, build_camera_model(agent, camera, self.stage.profile))

    def _meter_shutter(self, agent: Agent, camera: int, frame: Frame) -> float:
        """Meter for how long a camera exposes the scene of the frame's instant, in seconds."""
        self.stage.place_renderer(frame)
        exposure = self._build_exposure(agent, camera, frame)
        return meter_image(
            self.stage.renderer.render_camera(exposure.view),
            exposure,
            self._weather.at(self.stage.weather_state),
            mount=agent.sensors.cameras[camera].mount,
            carrier=agent.id,
        ).shutter_s

    def _advance_frame(self, frame: Frame, instant: Instant) -> Frame:
        """Advance actors to an instant, and flicker lamps in its exposure."""
        then = frame.advance(instant.time_s) if instant.time_s else frame
        if instant.exposure_s is None:
            return then
        return apply_led_flicker(then, instant.exposure_s, seed=self.stage.spec.seeds.traffic)

    def _measure_flow(
        self, seen: CameraCapture, agent: Agent, camera: int, model: CameraModel
    ) -> OpticalFlow:
        frame = self.stage.frame
        after = self.stage.poses.next_frame(frame)
        if after is None:
            return OpticalFlow.build_unknown((model.height_px, model.width_px))
        now, then = (
            self.stage.poses.world_from_sensors("camera", agent, one)[camera]
            for one in (frame, after)
        )
        raycaster = self.stage.place_raycaster(after, agent)
        motion = CameraMotion(model, (now, then), (frame, after))
        return measure_optical_flow(seen, motion, raycaster, self._move_points)

    def _render_image(
        self, capture: CameraCapture, agent: Agent, camera: int, frame: Frame
    ) -> ExposedImage:
        exposure = self._build_exposure(agent, camera, frame)
        check_capture(capture, exposure.view, self.stage.backend_name)
        return render_image(
            capture,
            exposure,
            self._weather.at(self.stage.weather_state),
            self.stage.poses.make_generator("camera", agent, frame, camera),
            mount=agent.sensors.cameras[camera].mount,
            carrier=agent.id,
        )

    def _build_exposure(self, agent: Agent, camera: int, frame: Frame) -> CameraExposure:
        pose = self.stage.poses.world_from_sensors("camera", agent, frame)[camera]
        return CameraExposure(
            view=build_camera_view(agent, camera, pose, self.stage.profile),
            camera=agent.sensors.cameras[camera].model,
            frame=frame,
            velocity=self.stage.poses.velocity(agent, frame),
            light_sources=self.stage.find_light_sources(frame),
            lens_map=build_lens_map(build_camera_model(agent, camera, self.stage.profile)),
            cover=self.stage.raycaster.cover,
        )


def find_rolling_camera(
    agent_poses: AgentPoses, agent: Agent, camera: int, frame: Frame
) -> RollingCamera | None:
    """Find the poses of a camera during its readout; None if all rows are exposed at once."""
    kind = agent.sensors.cameras[camera].model
    if not kind.is_rolling:
        return None
    start_s, end_s = compute_row_times(np.array([0.0, 1.0]), kind, 1).tolist()
    upper, lower = (
        agent_poses.world_from_sensors("camera", agent, frame, time_s=time_s)[camera]
        for time_s in (start_s, end_s)
    )
    return RollingCamera(end_s - start_s, upper, lower)


def build_camera_model(agent: Agent, number: int, profile: RenderProfile) -> CameraModel:
    """Build the projection of a camera by its number to an image at the scale of `profile`."""
    camera = agent.sensors.cameras[number].model
    return CameraModel.build(
        camera,
        max(1, round(camera.width_px * profile.scale)),
        max(1, round(camera.height_px * profile.scale)),
    )


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
        hide=list_carrier_ids(agent),
    )


def _turn_normals(normal: NDArray[np.float32], world_from_camera: Matrix) -> NDArray[np.float32]:
    """Turn vectors (h, w, 3) of the world into a camera's optical axes.

    The camera has a pose for each row (h, 4, 4), or one for the whole image (1, 4, 4).
    """
    rotations = poses.OPTICAL_FROM_BODY[:3, :3] @ world_from_camera[:, :3, :3].swapaxes(1, 2)
    return (normal @ rotations.swapaxes(1, 2)).astype(np.float32)
