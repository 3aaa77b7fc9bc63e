"""What cameras and LiDARs see in a frame; frames may be asked for in any order."""

import math
from collections.abc import Generator, Iterator
from contextlib import contextmanager

from advercity_dsl import Agent, RoadsideUnit

from advercity.dataset.image_codec import quantise_depth
from advercity.frames import Frame
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.poses import Matrix
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.lamp_beams import LightSource
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import TrafficResult, load_or_build_world
from advercity.rendering.backend import Backend, CameraCapture, CameraView, Renderer, RenderProfile
from advercity.rendering.light_sources import list_light_sources
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.annotation import build_hull_point_lookup, count_visible_beams, project_boxes
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.sensors.lidar import (
    ScanHits,
    cast_scan,
    derive_lidar_conditions,
    measure_point_cloud,
)
from advercity.sensors.sensor_frame import (
    CameraImage,
    ProjectedBox,
    SensorFrame,
    compute_pinhole_matrix,
)
from advercity.world import World


@contextmanager
def open_sensors(
    viewpoints: AgentPoses, stage: TrafficResult, backend: Backend, profile: RenderProfile
) -> Generator["SensorRig"]:
    """Open a scenario's world in a backend, with a sensor at every mount."""
    spec = viewpoints.spec
    world = load_or_build_world(spec, stage.network_path)
    atmosphere = compute_atmosphere(spec.weather, spec.road.land_use)
    with backend.open(world, atmosphere, profile) as renderer:
        yield SensorRig(viewpoints, atmosphere, profile, renderer, Raycaster(world), world)


class SensorRig:
    """The sensors of all viewpoints of an open scenario."""

    def __init__(
        self,
        viewpoints: AgentPoses,
        atmosphere: Atmosphere,
        profile: RenderProfile,
        renderer: Renderer,
        caster: Raycaster,
        world: World,
    ) -> None:
        self._viewpoints = viewpoints
        spec = viewpoints.spec
        self._world = world
        self._air = derive_lidar_conditions(spec.weather, atmosphere)
        self._camera_air = CameraConditions.build(
            spec.weather, atmosphere, spec.seeds.sensors, spec.id
        )
        self._lamps: tuple[LightSource, ...] = ()
        self._profile = profile
        self._renderer = renderer
        self._caster = caster
        self._points_of = build_hull_point_lookup(world.bodies)

    def capture_frame(self, index: int) -> tuple[SensorFrame, ...]:
        """The readings of every viewpoint in kept frame `index`, in the spec's order."""
        frame, agents = self._place_frame(index), self._viewpoints.spec.agents
        captures = self._renderer.render_cameras(
            [
                build_camera_view(agent, pose, self._profile)
                for agent in agents
                for pose in self._viewpoints.world_from_cameras(agent, index)
            ]
        )
        return tuple(self._build_sensor_frame(agent, frame, captures) for agent in agents)

    def capture_image(self, agent: Agent, camera: int, index: int) -> Uint8Array:
        """The picture (h, w, 3) RGB of one camera alone in kept frame `index`."""
        frame = self._place_frame(index)
        pose = self._viewpoints.world_from_cameras(agent, index)[camera]
        capture = self._renderer.render_camera(build_camera_view(agent, pose, self._profile))
        return self._render_image(capture, agent, camera, pose, frame)

    def _place_frame(self, index: int) -> Frame:
        """Kept frame `index`, ready to be looked at."""
        frame = self._viewpoints.load_frame(index)
        self._renderer.place(frame)
        is_night = self._camera_air.atmosphere.night
        self._lamps = tuple(list_light_sources(self._world, frame)) if is_night else ()
        return frame

    def _build_sensor_frame(
        self, agent: Agent, frame: Frame, captures: Iterator[CameraCapture]
    ) -> SensorFrame:
        lidar = agent.sensors.lidar
        scan = self._cast_scan(agent, frame)
        rng = self._viewpoints.make_generator("lidar", agent, frame)
        return self._viewpoints.build_sensor_frame(
            agent,
            frame,
            pictures=tuple(self._capture_images(agent, frame, captures)),
            cloud=measure_point_cloud(lidar, scan, self._air, rng, states=frame.states),
            visible=count_visible_beams(scan, lidar),
        )

    def _cast_scan(self, agent: Agent, frame: Frame) -> ScanHits:
        lidar, viewpoints = agent.sensors.lidar, self._viewpoints
        before = viewpoints.previous_frame(frame) if lidar.motion_distortion else None
        self._caster.place(frame, hide=_carrier_ids(agent), previous_frame=before)
        return cast_scan(
            lidar,
            viewpoints.world_from_lidar(agent, frame),
            self._caster,
            previous_world_from_lidar=None
            if before is None
            else viewpoints.world_from_lidar(agent, before),
            puddle_coverage=self._air.puddle_coverage,
        )

    def _capture_images(
        self, agent: Agent, frame: Frame, captures: Iterator[CameraCapture]
    ) -> Iterator[CameraImage]:
        for camera, pose in enumerate(self._viewpoints.world_from_cameras(agent, frame.index)):
            view, capture = build_camera_view(agent, pose, self._profile), next(captures)
            yield CameraImage(
                world_from_camera=pose,
                image=self._render_image(capture, agent, camera, pose, frame),
                semantic=capture.semantic,
                depth=quantise_depth(capture.depth),
                projected_boxes=self._project_boxes(capture, view, frame),
            )

    def _render_image(
        self, capture: CameraCapture, agent: Agent, camera: int, pose: Matrix, frame: Frame
    ) -> Uint8Array:
        shot = CameraExposure(
            view=build_camera_view(agent, pose, self._profile),
            camera=agent.sensors.camera,
            frame=frame,
            velocity=self._viewpoints.velocity(agent, frame),
            light_sources=self._lamps,
        )
        return render_image(
            capture,
            shot,
            self._camera_air,
            self._viewpoints.make_generator("camera", agent, frame, camera),
            mount=agent.sensors.camera.mounts[camera],
            carrier=agent.id,
        )

    def _project_boxes(
        self, capture: CameraCapture, view: CameraView, frame: Frame
    ) -> dict[int, ProjectedBox]:
        field_of_view = math.degrees(view.horizontal_fov_rad)
        return project_boxes(
            capture.instance,
            view.world_from_camera,
            compute_pinhole_matrix(view.width_px, view.height_px, horizontal_fov_deg=field_of_view),
            frame,
            self._points_of,
            hide=view.hide,
        )


def build_camera_view(
    agent: Agent, world_from_camera: Matrix, profile: RenderProfile
) -> CameraView:
    """What a camera of an agent that is there (4, 4) looks at, as large as `profile` says."""
    camera = agent.sensors.camera
    return CameraView(
        world_from_camera=world_from_camera,
        width_px=max(1, round(camera.width_px * profile.scale)),
        height_px=max(1, round(camera.height_px * profile.scale)),
        horizontal_fov_rad=math.radians(camera.horizontal_fov_deg),
        hide=_carrier_ids(agent),
    )


def _carrier_ids(agent: Agent) -> frozenset[int]:
    """The vehicle that a sensor is mounted on, which it must not see."""
    return frozenset() if isinstance(agent.place, RoadsideUnit) else frozenset({agent.number})
