"""What cameras and LiDARs see in a frame; frames may be asked for in any order."""

import math
from collections.abc import Generator, Iterator
from contextlib import contextmanager

import numpy as np
from advercity_dsl import Agent, RoadsideUnit
from numpy.typing import NDArray

from advercity.dataset.images import whole_metres
from advercity.dataset.reading import Picture, Reading, pinhole
from advercity.dataset.sightings import Sighting, points_of_bodies, sightings
from advercity.poses import Matrix
from advercity.rendering.backend import Backend, CameraCapture, CameraView, Profile, Renderer
from advercity.rendering.casting import Caster
from advercity.rendering.lamps import LitLamp, lit_lamps
from advercity.runner.stage import Stage, world_of
from advercity.runner.viewpoints import Viewpoints
from advercity.sensors.camera import CameraAir, Shot, photograph
from advercity.sensors.lidar import Scan, air_of, shoot, sweep, visible_counts
from advercity.traffic.trace import Frame
from advercity.weather.atmosphere import Atmosphere
from advercity.weather.derivation import atmosphere_of
from advercity.world.scene import World

Image = NDArray[np.uint8]


@contextmanager
def senses(
    viewpoints: Viewpoints, stage: Stage, backend: Backend, profile: Profile
) -> Generator["Senses"]:
    """Open a scenario's world in a backend, with a sensor at every mount."""
    spec = viewpoints.spec
    world = world_of(spec, stage.network)
    atmosphere = atmosphere_of(spec.weather, spec.road.land_use)
    with backend.open(world, atmosphere, profile) as renderer:
        yield Senses(viewpoints, atmosphere, profile, renderer, Caster(world), world)


class Senses:
    """The sensors of all viewpoints of an open scenario."""

    def __init__(
        self,
        viewpoints: Viewpoints,
        atmosphere: Atmosphere,
        profile: Profile,
        renderer: Renderer,
        caster: Caster,
        world: World,
    ) -> None:
        self._viewpoints = viewpoints
        spec = viewpoints.spec
        self._world = world
        self._air = air_of(spec.weather, atmosphere)
        self._camera_air = CameraAir.of(spec.weather, atmosphere, spec.seeds.sensors, spec.id)
        self._lamps: tuple[LitLamp, ...] = ()
        self._profile = profile
        self._renderer = renderer
        self._caster = caster
        self._points_of = points_of_bodies(world.bodies)

    def read(self, index: int) -> tuple[Reading, ...]:
        """The readings of every viewpoint in kept frame `index`, in the spec's order."""
        frame, agents = self._placed(index), self._viewpoints.spec.agents
        captures = self._renderer.cameras(
            [
                view_of(agent, pose, self._profile)
                for agent in agents
                for pose in self._viewpoints.camera_poses(agent, index)
            ]
        )
        return tuple(self._reading(agent, frame, captures) for agent in agents)

    def look(self, agent: Agent, camera: int, index: int) -> Image:
        """The picture (h, w, 3) RGB of one camera alone in kept frame `index`."""
        frame = self._placed(index)
        pose = self._viewpoints.camera_poses(agent, index)[camera]
        capture = self._renderer.camera(view_of(agent, pose, self._profile))
        return self._developed(capture, agent, camera, pose, frame)

    def _placed(self, index: int) -> Frame:
        """Kept frame `index`, ready to be looked at."""
        frame = self._viewpoints.frame(index)
        self._renderer.place(frame)
        is_night = self._camera_air.atmosphere.night
        self._lamps = tuple(lit_lamps(self._world, frame)) if is_night else ()
        return frame

    def _reading(self, agent: Agent, frame: Frame, captures: Iterator[CameraCapture]) -> Reading:
        lidar = agent.sensors.lidar
        scan = self._scan(agent, frame)
        rng = self._viewpoints.rng("lidar", agent, frame)
        return self._viewpoints.reading(
            agent,
            frame,
            pictures=tuple(self._pictures(agent, frame, captures)),
            cloud=sweep(lidar, scan, self._air, rng, states=frame.states),
            visible=visible_counts(scan, lidar),
        )

    def _scan(self, agent: Agent, frame: Frame) -> Scan:
        lidar, viewpoints = agent.sensors.lidar, self._viewpoints
        before = viewpoints.before(frame) if lidar.motion_distortion else None
        self._caster.place(frame, hide=_carrier(agent), before=before)
        return shoot(
            lidar,
            viewpoints.lidar_pose(agent, frame),
            self._caster,
            before=None if before is None else viewpoints.lidar_pose(agent, before),
            puddle_coverage=self._air.puddle_coverage,
        )

    def _pictures(
        self, agent: Agent, frame: Frame, captures: Iterator[CameraCapture]
    ) -> Iterator[Picture]:
        for camera, pose in enumerate(self._viewpoints.camera_poses(agent, frame.index)):
            view, capture = view_of(agent, pose, self._profile), next(captures)
            yield Picture(
                world_from_camera=pose,
                image=self._developed(capture, agent, camera, pose, frame),
                semantic=capture.semantic,
                depth=whole_metres(capture.depth),
                sightings=self._sightings(capture, view, frame),
            )

    def _developed(
        self, capture: CameraCapture, agent: Agent, camera: int, pose: Matrix, frame: Frame
    ) -> Image:
        shot = Shot(
            view=view_of(agent, pose, self._profile),
            camera=agent.sensors.camera,
            frame=frame,
            velocity=self._viewpoints.velocity(agent, frame),
            lamps=self._lamps,
        )
        return photograph(
            capture,
            shot,
            self._camera_air,
            self._viewpoints.rng("camera", agent, frame, camera),
            mount=agent.sensors.camera.mounts[camera],
            carrier=agent.id,
        )

    def _sightings(
        self, capture: CameraCapture, view: CameraView, frame: Frame
    ) -> dict[int, Sighting]:
        field_of_view = math.degrees(view.horizontal_fov_rad)
        return sightings(
            capture.instance,
            view.world_from_camera,
            pinhole(view.width_px, view.height_px, horizontal_fov_deg=field_of_view),
            frame,
            self._points_of,
            hide=view.hide,
        )


def view_of(agent: Agent, world_from_camera: Matrix, profile: Profile) -> CameraView:
    """What a camera of an agent that is there (4, 4) looks at, as large as `profile` says."""
    camera = agent.sensors.camera
    return CameraView(
        world_from_camera=world_from_camera,
        width_px=max(1, round(camera.width_px * profile.scale)),
        height_px=max(1, round(camera.height_px * profile.scale)),
        horizontal_fov_rad=math.radians(camera.horizontal_fov_deg),
        hide=_carrier(agent),
    )


def _carrier(agent: Agent) -> frozenset[int]:
    """The vehicle that a sensor is mounted on, which it must not see."""
    return frozenset() if isinstance(agent.place, RoadsideUnit) else frozenset({agent.number})
