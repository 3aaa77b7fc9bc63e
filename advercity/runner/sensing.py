"""What every viewpoint of a scenario reads in one frame; frames may be asked for in any order."""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from advercity_dsl import Agent, Mount, RoadsideUnit, Spec

from advercity import poses
from advercity.dataset.reading import Picture, Reading
from advercity.errors import RunError
from advercity.poses import Matrix
from advercity.randomness import generator
from advercity.rendering.backend import CameraView, Profile, Renderer
from advercity.rendering.casting import Caster
from advercity.sensors.camera import expose
from advercity.sensors.geodesy import Geodetic, enu_from_geodetic
from advercity.sensors.gnss import GnssFix, fix
from advercity.sensors.imu import ImuSample, measure
from advercity.sensors.lidar import shoot, sweep, visible_counts
from advercity.sensors.sun import with_sun
from advercity.traffic.lamps import lit
from advercity.traffic.plans import planned
from advercity.traffic.trace import Frame, Trace
from advercity.weather.atmosphere import Atmosphere


class Senses:
    """The sensors of all viewpoints of an open scenario."""

    def __init__(
        self,
        spec: Spec,
        trace: Trace,
        atmosphere: Atmosphere,
        profile: Profile,
        renderer: Renderer,
        caster: Caster,
    ) -> None:
        self._spec = spec
        self._trace = trace
        self._atmosphere = atmosphere
        self._profile = profile
        self._renderer = renderer
        self._caster = caster
        self._frame = lru_cache(maxsize=4)(trace.frame)
        self._origin = Geodetic(spec.road.origin_lat_deg, spec.road.origin_lon_deg, 0.0)

    def read(self, index: int) -> tuple[Reading, ...]:
        """The readings of every viewpoint in kept frame `index`, in the spec's order."""
        frame = lit(self._frame(index), self._spec.weather.lamps)
        self._renderer.place(frame)
        return tuple(self._reading(agent, frame) for agent in self._spec.agents)

    def _reading(self, agent: Agent, frame: Frame) -> Reading:
        world_from_agent = self._pose(agent, frame.index)
        world_from_lidar = self._lidar_pose(agent, world_from_agent)
        gnss = self._fix(agent, world_from_agent, frame)
        lidar = agent.sensors.lidar
        self._caster.place(frame, hide=_carrier(agent))
        hits = shoot(lidar, world_from_lidar, self._caster)
        rng = self._rng("lidar", agent.id, frame.index)
        is_unit = isinstance(agent.place, RoadsideUnit)
        return Reading(
            agent=agent,
            frame=frame,
            world_from_agent=world_from_agent,
            estimated_world_from_agent=(
                self._located(world_from_agent, gnss) if is_unit else world_from_agent
            ),
            world_from_lidar=world_from_lidar,
            pictures=tuple(self._pictures(agent, world_from_agent, frame)),
            cloud=sweep(lidar, hits, self._atmosphere, rng),
            visible=visible_counts(hits),
            gnss=None if is_unit else gnss,
            imu=self._motion(agent, frame.index),
            planned=() if is_unit else self._plan(agent, frame.index),
        )

    def _rng(self, sensor: str, agent: str, frame: int, *more: int) -> np.random.Generator:
        return generator(self._spec.seeds.sensors, self._spec.id, sensor, agent, frame, *more)

    def _pose(self, agent: Agent, index: int) -> Matrix:
        """Where the agent is: its vehicle's origin, or the roadside unit."""
        place = agent.place
        if isinstance(place, RoadsideUnit):
            return poses.pose(
                place.position_m,
                yaw=math.radians(place.yaw_deg),
                pitch=math.radians(place.pitch_deg),
                roll=math.radians(place.roll_deg),
            )
        try:
            return self._frame(index).of(agent.number).world_from_body
        except KeyError:
            raise RunError(
                f"{self._spec.id}: {agent.id} is not on the road in frame {index};"
                " its route ends too early"
            ) from None

    def _lidar_pose(self, agent: Agent, world_from_agent: Matrix) -> Matrix:
        """A roadside unit's LiDAR stands level and looks east, however its cameras are turned."""
        mount = mounted(agent.sensors.lidar.mount)
        if isinstance(agent.place, RoadsideUnit):
            return poses.pose(agent.place.position_m) @ mount
        return world_from_agent @ mount

    def _pictures(self, agent: Agent, world_from_agent: Matrix, frame: Frame) -> Iterator[Picture]:
        camera = agent.sensors.camera
        for index, mount in enumerate(camera.mounts):
            view = CameraView(
                world_from_camera=world_from_agent @ mounted(mount),
                width_px=max(1, round(camera.width_px * self._profile.scale)),
                height_px=max(1, round(camera.height_px * self._profile.scale)),
                horizontal_fov_rad=math.radians(camera.horizontal_fov_deg),
                hide=_carrier(agent),
            )
            capture = with_sun(self._renderer.camera(view), view, self._atmosphere)
            image = expose(
                capture,
                camera,
                self._rng("camera", agent.id, frame.index, index),
                stray_light=self._spec.weather.lens.stray_light,
            )
            yield Picture(view.world_from_camera, image, capture.semantic)

    def _plan(self, agent: Agent, index: int) -> tuple[tuple[float, float, float], ...]:
        points = planned(self._trace, agent.number, index).tolist()
        return tuple((x, y, speed) for x, y, speed in points)

    def _fix(self, agent: Agent, world_from_agent: Matrix, frame: Frame) -> GnssFix:
        return fix(
            agent.sensors.gnss,
            world_from_agent[:3, 3],
            origin=self._origin,
            time_s=frame.time_s,
            rng=self._rng("gnss", agent.id, frame.index),
        )

    def _located(self, world_from_agent: Matrix, gnss: GnssFix) -> Matrix:
        """The pose with the position that the receiver reports."""
        estimate = world_from_agent.copy()
        place = Geodetic(gnss.latitude_deg, gnss.longitude_deg, gnss.altitude_m)
        estimate[:3, 3] = enu_from_geodetic(place, self._origin)
        return estimate

    def _motion(self, agent: Agent, index: int) -> ImuSample | None:
        """None without an IMU. The first and last frame take the motion of their neighbour."""
        imu = agent.sensors.imu
        if imu is None:
            return None
        middle = min(max(index, 1), len(self._trace) - 2)
        before, now, after = (self._pose(agent, middle + step) for step in (-1, 0, 1))
        return measure(
            imu,
            (before, now, after),
            self._trace.tick_s,
            key=(self._spec.seeds.sensors, self._spec.id, agent.id),
            frame=index,
        )


def mounted(mount: Mount) -> Matrix:
    """Pose (4, 4) of a sensor in the frame of its carrier."""
    return poses.pose(
        (mount.x_m, mount.y_m, mount.z_m),
        yaw=math.radians(mount.yaw_deg),
        pitch=math.radians(mount.pitch_deg),
        roll=math.radians(mount.roll_deg),
    )


def _carrier(agent: Agent) -> frozenset[int]:
    """The vehicle that a sensor is mounted on, which it must not see."""
    return frozenset() if isinstance(agent.place, RoadsideUnit) else frozenset({agent.number})
