"""Where the sensors of a scenario are in each frame, and what they read without looking."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from advercity_dsl import Agent, Mount, RoadsideUnit, Spec
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.reading import Picture, Reading
from advercity.dataset.roles import roles_of
from advercity.errors import RunError
from advercity.poses import Matrix
from advercity.randomness import generator
from advercity.sensors.gauss_markov import wander
from advercity.sensors.geodesy import Geodetic, enu_from_geodetic
from advercity.sensors.gnss import GnssFix, fix
from advercity.sensors.imu import ImuSample, measure
from advercity.sensors.lidar import PointCloud
from advercity.traffic.lamps import lit
from advercity.traffic.plans import planned
from advercity.traffic.trace import ActorState, Frame, Trace
from advercity.traffic.umbrellas import sheltered

Vector = NDArray[np.float64]


class Viewpoints:
    """Poses, satellite fixes, motion and plans of every agent; a function of spec and trace."""

    def __init__(self, spec: Spec, trace: Trace) -> None:
        self.spec = spec
        self._trace = trace
        self._roles = roles_of(spec)
        self._traced = lru_cache(maxsize=4)(trace.frame)
        self._origin = Geodetic(spec.road.origin_lat_deg, spec.road.origin_lon_deg)

    def frame(self, index: int) -> Frame:
        """Kept frame `index` with the lamps lit and the umbrellas up that the weather calls for."""
        weather, seed = self.spec.weather, self.spec.seeds.traffic
        shown = sheltered(self._traced(index), weather.rain.rate_mm_h, seed=seed)
        return lit(shown, weather.lamps)

    def reading(
        self,
        agent: Agent,
        frame: Frame,
        *,
        pictures: tuple[Picture, ...],
        cloud: PointCloud,
        visible: dict[int, int],
    ) -> Reading:
        """The reading of `agent` in `frame`, given what its cameras and LiDAR saw."""
        world_from_agent = self.pose(agent, frame.index)
        gnss = self._fix(agent, world_from_agent, frame)
        is_unit = isinstance(agent.place, RoadsideUnit)
        return Reading(
            agent=agent,
            frame=frame,
            world_from_agent=world_from_agent,
            estimated_world_from_agent=(
                self._located(world_from_agent, gnss) if is_unit else world_from_agent
            ),
            world_from_lidar=self.lidar_pose(agent, frame),
            pictures=pictures,
            cloud=cloud,
            visible=visible,
            gnss=None if is_unit else gnss,
            imu=self._motion(agent, frame.index),
            planned=() if is_unit else self._plan(agent, frame.index),
            roles=self._roles,
        )

    def rng(self, sensor: str, agent: Agent, frame: Frame, *more: int) -> np.random.Generator:
        """Random numbers of a sensor of an agent in a frame."""
        spec = self.spec
        return generator(spec.seeds.sensors, spec.id, sensor, agent.id, frame.index, *more)

    def pose(self, agent: Agent, index: int) -> Matrix:
        """`world_from_agent` (4, 4): its vehicle's origin, or the roadside unit.

        Raises:
            RunError: The vehicle has left the road.
        """
        place = agent.place
        if isinstance(place, RoadsideUnit):
            return poses.pose(
                place.position_m,
                yaw=math.radians(place.yaw_deg),
                pitch=math.radians(place.pitch_deg),
                roll=math.radians(place.roll_deg),
            )
        return self._vehicle_pose(agent, self._traced(index))

    def lidar_pose(self, agent: Agent, frame: Frame) -> Matrix:
        """`world_from_lidar` (4, 4) in a frame.

        A roadside unit's LiDAR stands level and looks east, however its cameras are turned.
        """
        mount = _mounted(agent.sensors.lidar.mount)
        if isinstance(agent.place, RoadsideUnit):
            return poses.pose(agent.place.position_m) @ mount
        return self._vehicle_pose(agent, frame) @ mount

    def velocity(self, agent: Agent, frame: Frame) -> Vector:
        """Velocity (3,) of an agent in the world in m/s; a roadside unit stands."""
        if isinstance(agent.place, RoadsideUnit):
            return np.zeros(3)
        state = frame.of(agent.number)
        return state.speed_m_s * state.world_from_body[:3, 0]

    def before(self, frame: Frame) -> Frame:
        """The frame one tick earlier; nothing is known before the first, so all goes on evenly."""
        if frame.index > 0:
            return self._traced(frame.index - 1)
        after = {state.actor.id: state.world_from_body for state in self._traced(1).states}
        return replace(frame, states=tuple(_reversed(state, after) for state in frame.states))

    def camera_poses(self, agent: Agent, index: int) -> list[Matrix]:
        """`world_from_camera` (4, 4) of each of its cameras.

        A roadside unit's cameras turn about the vertical before they tilt, so that all of them
        look down as far as the unit does.
        """
        mounts = agent.sensors.camera.mounts
        place = agent.place
        if not isinstance(place, RoadsideUnit):
            return [self.pose(agent, index) @ _mounted(mount) for mount in mounts]
        upright = poses.pose(place.position_m, yaw=math.radians(place.yaw_deg))
        tilt = poses.pose(
            (0, 0, 0), pitch=math.radians(place.pitch_deg), roll=math.radians(place.roll_deg)
        )
        return [upright @ _mounted(mount) @ tilt for mount in mounts]

    def _vehicle_pose(self, agent: Agent, frame: Frame) -> Matrix:
        try:
            return frame.of(agent.number).world_from_body
        except KeyError:
            raise RunError(
                f"{self.spec.id}: {agent.id} is not on the road in frame {frame.index};"
                " its route ends too early"
            ) from None

    def _plan(self, agent: Agent, index: int) -> tuple[tuple[float, float, float], ...]:
        points = planned(self._trace, agent.number, index).tolist()
        return tuple((x, y, speed) for x, y, speed in points)

    def _fix(self, agent: Agent, world_from_agent: Matrix, frame: Frame) -> GnssFix:
        gnss, spec, index = agent.sensors.gnss, self.spec, frame.index
        slow = wander(
            generator(spec.seeds.sensors, spec.id, "gnss wander", agent.id),
            index,
            index,
            memory=math.exp(-self._trace.tick_s / gnss.wander_time_s),
            axes=3,
        )
        return fix(
            gnss,
            world_from_agent[:3, 3],
            origin=self._origin,
            time_s=frame.time_s,
            rng=self.rng("gnss", agent, frame),
            wander=slow[0],
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
        around = (max(0, middle - 2), middle - 1, middle, middle + 1)
        return measure(
            imu,
            [self.pose(agent, tick) for tick in around],
            self._trace.tick_s,
            key=(self.spec.seeds.sensors, self.spec.id, agent.id),
            frame=index,
        )


def _reversed(state: ActorState, after: Mapping[int, Matrix]) -> ActorState:
    """Where an actor was a tick ago if it moved then as it moves until the next."""
    now = state.world_from_body
    then = now @ poses.inverse(after.get(state.actor.id, now)) @ now
    return replace(state, world_from_body=then)


def _mounted(mount: Mount) -> Matrix:
    """Pose (4, 4) of a sensor in the frame of its carrier."""
    return poses.pose(
        (mount.x_m, mount.y_m, mount.z_m),
        yaw=math.radians(mount.yaw_deg),
        pitch=math.radians(mount.pitch_deg),
        roll=math.radians(mount.roll_deg),
    )
