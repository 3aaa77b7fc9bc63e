"""Poses of agents and sensors in each frame, and their GNSS, IMU and planned path."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from advercity_dsl import Agent, Lidar, Mount, RoadsideUnit, Spec
from advercity_dsl.positioning import SatelliteReceiver
from advercity_dsl.sampling import Sampled

from advercity.conflicts.roles import find_conflict_roles
from advercity.errors import RunError
from advercity.frames import (
    AT_REST,
    BodyMotion,
    Frame,
    Trace,
    extract_planned_trajectory,
)
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.geodesy import Geodetic, enu_from_geodetic, find_world_origin
from advercity.geometry.poses import Matrix
from advercity.physics.timeline import WeatherTimeline
from advercity.randomness import create_generator, sample_gauss_markov
from advercity.scene.parking import find_parked_cars
from advercity.sensors.can_bus import sample_can_bus
from advercity.sensors.gnss import ReceiverInPlace, SkyView, measure_gnss
from advercity.sensors.imu import ImuConditions, measure_imu
from advercity.sensors.lidar import ScanTime
from advercity.sensors.measurements import CanSample, GnssFix, ImuSample
from advercity.sensors.mounts import carrier_from_sensor
from advercity.sensors.radar import PlacedRadar
from advercity.sensors.rolling_shutter import RollingCamera, compute_row_times
from advercity.sensors.sample_times import SampleMoment, find_newest_sample, list_sample_times
from advercity.sensors.sensor_frame import SensorFrame
from advercity.traffic.figures import assign_figures, number_figures
from advercity.traffic.weather_effects import (
    apply_lamp_state,
    fit_led_headlamps,
    light_high_beams,
    may_use_high_beams,
    raise_umbrellas,
)


class AgentPoses:
    """Poses and navigation data of every agent, a function of spec and trace.

    Attributes:
        spec: The scenario.
        timeline: Its weather in each frame.
    """

    def __init__(self, spec: Spec, trace: Trace) -> None:
        self.spec = spec
        self._trace = trace
        self.timeline = WeatherTimeline.from_spec(spec)
        self._roles = find_conflict_roles(spec)
        self._figures = number_figures(trace.actors)
        self._traced = lru_cache(maxsize=4)(trace.build_frame)
        self._shown = lru_cache(maxsize=4)(self._build_frame)
        self._parked = find_parked_cars(spec)
        self._receivers: dict[tuple[str, SatelliteReceiver], ReceiverInPlace] = {}
        self._origin = find_world_origin(spec.road)

    def load_frame(self, index: int) -> Frame:
        """Load recorded frame `index` with parked cars; lamps and umbrellas follow the weather."""
        return self._shown(index)

    def next_frame(self, frame: Frame) -> Frame | None:
        """Load the frame one tick later; None after the last."""
        last = len(self._trace) - 1
        return self.load_frame(frame.index + 1) if frame.index < last else None

    def _build_frame(self, index: int) -> Frame:
        weather, seed = self.timeline.weather_at(index), self.spec.seeds.traffic
        people = assign_figures(self._traced(index), self._figures)
        shown = raise_umbrellas(people, weather.rain.rate_mm_h, seed=seed)
        lit = apply_lamp_state(shown, weather.lamps)
        if weather.time == "night":
            lit = fit_led_headlamps(lit, weather.lamps.led, self.spec.blueprints, seed=seed)
        if may_use_high_beams(weather, self.spec.road.land_use):
            lit = light_high_beams(lit, weather.lamps.high_beam, seed=seed)
        return replace(lit, states=(*lit.states, *self._parked))

    def build_sensor_frame(
        self,
        agent: Agent,
        frame: Frame,
        *,
        readings: Mapping[str, Sequence[Any]],
        min_points: int = 0,
        fix: GnssFix | None = None,
    ) -> SensorFrame:
        """Add pose, GNSS, IMU, bus and planned path of an agent to what its other sensors saw.

        Args:
            agent: The agent.
            frame: Recorded frame, as `load_frame` returns it.
            readings: What those measured, by the names of their kinds and their numbers.
            min_points: Points that an actor must return to be annotated.
            fix: Fix of a receiver of satellites, as `measure_fix` returns it; others need none.
        """
        world_from_agent = self.world_from_agent(agent, frame.index)
        has_satellites = agent.sensors.gnss.mode == "satellites"
        gnss = fix if has_satellites else self._measure_gnss(agent, frame)
        is_unit = isinstance(agent.place, RoadsideUnit)
        return SensorFrame(
            agent=agent,
            frame=frame,
            world_from_agent=world_from_agent,
            estimated_world_from_agent=(
                self._apply_gnss_position(world_from_agent, gnss)
                if is_unit and gnss is not None
                else world_from_agent
            ),
            readings={
                **readings,
                "gnss": _list_found(None if is_unit and not has_satellites else gnss),
                "imu": _list_found(self._measure_imu(agent, frame)),
                "can": _list_found(self._sample_can_bus(agent, frame.index)),
            },
            min_points=min_points,
            planned_trajectory=() if is_unit else self._load_planned_path(agent, frame.index),
            conflict_roles=self._roles,
            weather=(self.timeline.weather_at(frame.index) if self.timeline.is_changing else None),
        )

    def make_generator(
        self, sensor: str, agent: Agent, frame: Frame, *more: int
    ) -> np.random.Generator:
        """Create the random generator of a sensor of an agent in a frame."""
        spec = self.spec
        return create_generator(spec.seeds.sensors, spec.id, sensor, agent.id, frame.index, *more)

    def world_from_agent(self, agent: Agent, index: int) -> Matrix:
        """Return `world_from_agent` (4, 4): the vehicle's origin, or the roadside unit.

        Raises:
            RunError: The vehicle has left the road.
        """
        place = agent.place
        if isinstance(place, RoadsideUnit):
            return poses.pose_matrix(
                place.position_m,
                yaw=math.radians(place.yaw_deg),
                pitch=math.radians(place.pitch_deg),
                roll=math.radians(place.roll_deg),
            )
        return self._world_from_vehicle(agent, self._traced(index))

    def world_from_lidars(self, agent: Agent, frame: Frame) -> list[Matrix]:
        """Return `world_from_lidar` (4, 4) of each LiDAR of an agent in a frame.

        LiDARs of a roadside unit are level and face east, whatever its cameras face.
        """
        if isinstance(agent.place, RoadsideUnit):
            carrier = poses.pose_matrix(agent.place.position_m)
        else:
            carrier = self._world_from_vehicle(agent, frame)
        return [carrier @ carrier_from_sensor(lidar.mount) for lidar in agent.sensors.lidars]

    def velocity(self, agent: Agent, frame: Frame) -> Float64Array:
        """Return the velocity (3,) of an agent in the world in m/s; zero for a roadside unit."""
        return self._find_motion(agent, frame).velocity

    def find_scan_time(self, lidar: Lidar, frame: Frame) -> ScanTime:
        """Find when a LiDAR takes the scan that ends at a frame's instant."""
        tick_s = self._trace.tick_s
        period_s = lidar.find_scan_period_s(tick_s)
        end_s = frame.index * tick_s + self._find_shift_s(frame)
        return ScanTime(round(end_s / period_s, 9), period_s)

    def rewind_frame(self, frame: Frame, time_s: float) -> Frame:
        """Return the actors some seconds before a frame; before the first, motion goes back."""
        tick_s = self._trace.tick_s
        ticks = round((self._find_shift_s(frame) - time_s) / tick_s, 9)
        index = max(frame.index + math.ceil(ticks), 0)
        shift_s = round((frame.index + ticks - index) * tick_s, 9)
        then = self._traced(index)
        return then.advance(shift_s) if shift_s else then

    def world_from_cameras(
        self, agent: Agent, frame: Frame, *, time_s: float = 0.0
    ) -> list[Matrix]:
        """Return `world_from_camera` (4, 4) of each camera of an agent.

        `time_s` is less than a tick from the frame's instant.
        """
        mounts = [item.mount for item in agent.sensors.cameras]
        shift_s = self._find_shift_s(frame) + time_s
        return self._world_from_mounts(agent, mounts, frame.index, shift_s)

    def find_rolling_camera(self, agent: Agent, camera: int, frame: Frame) -> RollingCamera | None:
        """Find the poses of a camera while its rows are exposed; None if all are at once."""
        kind = agent.sensors.cameras[camera].model
        if not kind.is_rolling:
            return None
        start_s, end_s = compute_row_times(np.array([0.0, 1.0]), kind, 1).tolist()
        upper, lower = (
            self.world_from_cameras(agent, frame, time_s=time_s)[camera]
            for time_s in (start_s, end_s)
        )
        return RollingCamera(end_s - start_s, upper, lower)

    def find_sample(self, agent: Agent, name: str, sensor: Sampled, frame: int) -> SampleMoment:
        """Find the newest sample, not after a frame, of a sensor of an agent by its name."""
        key = *self._build_drive_key(agent), name
        return find_newest_sample(sensor, self._trace.tick_s, frame, key=key)

    def world_from_thermals(self, agent: Agent, frame: Frame) -> list[Matrix]:
        """Return `world_from_camera` (4, 4) of each thermal camera of an agent in a frame."""
        mounts = [item.mount for item in agent.sensors.thermals]
        return self._world_from_mounts(agent, mounts, frame.index, self._find_shift_s(frame))

    def place_radars(self, agent: Agent, frame: Frame) -> list[PlacedRadar]:
        """Place the radars of an agent in a frame."""
        radars, motion = agent.sensors.radars, self._find_motion(agent, frame)
        mounts = [item.mount for item in radars]
        shift_s = self._find_shift_s(frame)
        world_from_radars = self._world_from_mounts(agent, mounts, frame.index, shift_s)
        is_unit = isinstance(agent.place, RoadsideUnit)
        carrier = (
            self.world_from_agent(agent, frame.index)
            if is_unit
            else self._world_from_vehicle(agent, frame)
        )
        turn = carrier[:3, :3] @ motion.angular_rate
        return [
            PlacedRadar(
                radar=item.model,
                mount=item.mount,
                world_from_radar=pose,
                velocity=motion.velocity + np.cross(turn, pose[:3, 3] - carrier[:3, 3]),
                carrier=max(agent.number, 0),
            )
            for item, pose in zip(radars, world_from_radars, strict=True)
        ]

    def _find_shift_s(self, frame: Frame) -> float:
        """Find by how much a frame was advanced since it was recorded."""
        return frame.time_s - self._traced(frame.index).time_s

    def _world_from_mounts(
        self, agent: Agent, mounts: Sequence[Mount], index: int, time_s: float = 0.0
    ) -> list[Matrix]:
        """Return the poses (4, 4) of sensors that look ahead from their mounts.

        Those of a roadside unit turn about the vertical before they tilt, so that all of them look
        down by the pitch of the unit.
        """
        place = agent.place
        if not isinstance(place, RoadsideUnit):
            carrier = self.world_from_agent(agent, index)
            if time_s:
                motion = self._find_motion(agent, self._traced(index))
                carrier = motion.advance_pose(carrier, time_s)
            return [carrier @ carrier_from_sensor(mount) for mount in mounts]
        upright = poses.pose_matrix(place.position_m, yaw=math.radians(place.yaw_deg))
        tilt = poses.pose_matrix(
            (0, 0, 0), pitch=math.radians(place.pitch_deg), roll=math.radians(place.roll_deg)
        )
        return [upright @ carrier_from_sensor(mount) @ tilt for mount in mounts]

    def _world_from_vehicle(self, agent: Agent, frame: Frame) -> Matrix:
        try:
            return frame.get_state(agent.number).world_from_body
        except KeyError:
            raise RunError(
                f"{self.spec.id}: {agent.id} is not on the road in frame {frame.index};"
                " its route ends too early"
            ) from None

    def _find_motion(self, agent: Agent, frame: Frame) -> BodyMotion:
        if isinstance(agent.place, RoadsideUnit):
            return AT_REST
        return frame.get_state(agent.number).motion

    def _travelled_m(self, agent: Agent, index: int) -> float:
        if isinstance(agent.place, RoadsideUnit):
            return 0.0
        return self._traced(index).get_state(agent.number).travelled_m

    def _load_planned_path(
        self, agent: Agent, index: int
    ) -> tuple[tuple[float, float, float], ...]:
        points = extract_planned_trajectory(self._trace, agent.number, index).tolist()
        return tuple((x, y, speed) for x, y, speed in points)

    def measure_fix(self, agent: Agent, frame: Frame, sky: SkyView) -> GnssFix | None:
        """Measure what an agent's receiver of satellites reports since the previous frame."""
        gnss, key = agent.sensors.gnss, self._build_drive_key(agent)
        place = agent.id, gnss.receiver
        if place not in self._receivers:
            self._receivers[place] = ReceiverInPlace(
                gnss.receiver,
                sky,
                self._origin,
                pose_at=partial(self._find_pose, agent),
                key=key,
            )
        receiver = self._receivers[place]
        times = list_sample_times(gnss, self._trace.tick_s, frame.index, key=(*key, "gnss"))
        fixes = [
            receiver.measure(
                (frame.index - 1 + fraction) * self._trace.tick_s,
                velocity=self._find_motion(agent, frame).velocity,
                number=times.first + at,
                step_s=times.step_s,
                stamp_s=frame.time_s + (fraction - 1.0) * self._trace.tick_s,
            )
            for at, fraction in enumerate(times.fractions.tolist())
        ]
        return _join_fixes([fix for fix in fixes if fix is not None])

    def _measure_gnss(self, agent: Agent, frame: Frame) -> GnssFix | None:
        gnss, index, key = agent.sensors.gnss, frame.index, self._build_drive_key(agent)
        tick_s = self._trace.tick_s
        times = list_sample_times(gnss, tick_s, index, key=(*key, "gnss"))
        count = len(times.fractions)
        if not count:
            return None
        slow = sample_gauss_markov(
            create_generator(*key, "gnss wander"),
            times.first,
            times.first + count - 1,
            correlation=math.exp(-times.step_s / gnss.wander_time_s),
            axes=3,
        )
        return _join_fixes(
            [
                measure_gnss(
                    gnss,
                    self._find_pose(agent, (index - 1 + fraction) * tick_s)[:3, 3],
                    origin=self._origin,
                    time_s=frame.time_s + (fraction - 1.0) * tick_s,
                    rng=create_generator(*key, "gnss", times.first + at),
                    slow_error=slow[at],
                )
                for at, fraction in enumerate(times.fractions.tolist())
            ]
        )

    def _find_pose(self, agent: Agent, time_s: float) -> Matrix:
        """Find the pose (4, 4) of an agent at a time since the first frame, which it has before."""
        at = round(time_s / self._trace.tick_s, 9)
        index = max(math.ceil(at), 0)
        now = self.world_from_agent(agent, index)
        if at >= index or index == 0:
            return now
        last = self.world_from_agent(agent, index - 1)
        return poses.interpolate_poses(last, now, [at - index + 1.0])[0]

    def _apply_gnss_position(self, world_from_agent: Matrix, gnss: GnssFix) -> Matrix:
        """Replace the position of a pose by the one that the receiver reports."""
        estimate = world_from_agent.copy()
        place = Geodetic(gnss.latitude_deg, gnss.longitude_deg, gnss.altitude_m)
        estimate[:3, 3] = enu_from_geodetic(place, self._origin)
        return estimate

    def _measure_imu(self, agent: Agent, frame: Frame) -> ImuSample | None:
        """Measure the IMU, if the agent has one; until the first frame nothing has changed."""
        imu, index = agent.sensors.imu, frame.index
        if imu is None:
            return None
        before = max(index - 1, 0)
        return measure_imu(
            imu,
            (self.world_from_agent(agent, before), self.world_from_agent(agent, index)),
            (
                self._find_motion(agent, self._traced(before)),
                self._find_motion(agent, self._traced(index)),
            ),
            self._trace.tick_s,
            key=self._build_drive_key(agent),
            frame=index,
            conditions=ImuConditions(
                air_c=self.timeline.weather_at(index).temperature_c,
                running_s=frame.time_s,
                travelled_m=(self._travelled_m(agent, before), self._travelled_m(agent, index)),
            ),
        )

    def _sample_can_bus(self, agent: Agent, index: int) -> CanSample | None:
        """Sample the bus of a vehicle that has one; until the first frame nothing has changed."""
        if agent.sensors.can is None or isinstance(agent.place, RoadsideUnit):
            return None
        before, now = (
            self._traced(at).get_state(agent.number) for at in (max(index - 1, 0), index)
        )
        return sample_can_bus(
            agent.sensors.can,
            (before, now),
            self._trace.tick_s,
            key=self._build_drive_key(agent),
            frame=index,
        )

    def _build_drive_key(self, agent: Agent) -> tuple[int | str, ...]:
        """Build a key without the weather: the same drive has the same errors under all of them."""
        seeds = self.spec.seeds
        return seeds.sensors, seeds.traffic, self.spec.road.id, agent.id


def _list_found(measured: Any | None) -> tuple[Any, ...]:
    """List the measurement of a sensor, empty without one."""
    return () if measured is None else (measured,)


def _join_fixes(fixes: Sequence[GnssFix]) -> GnssFix | None:
    """Join the fixes of a frame to the last of them with those before it; None if none is."""
    return replace(fixes[-1], earlier=tuple(fixes[:-1])) if fixes else None
