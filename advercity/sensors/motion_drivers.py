"""Samples the inertial units and buses of an open scenario."""

from advercity_dsl import Agent, RoadsideUnit

from advercity.sensors.can_bus import sample_can_bus
from advercity.sensors.imu import ImuConditions, measure_imu
from advercity.sensors.measurements import CanSample, ImuSample
from advercity.sensors.stage import SensorDriver


class ImuDriver(SensorDriver):
    """Measures with inertial units; they have no state before the first frame."""

    def measure(self, agent: Agent, number: int) -> ImuSample | None:
        """Measure the samples since the previous frame; None if there is none."""
        frame, poses = self.stage.frame, self.stage.poses
        index, before = frame.index, max(frame.index - 1, 0)
        imu = agent.sensors.imu
        assert imu is not None, f"{agent.id} has no inertial unit"
        return measure_imu(
            imu,
            (poses.world_from_agent(agent, before), poses.world_from_agent(agent, index)),
            (
                poses.find_motion(agent, poses.load_traced_frame(before)),
                poses.find_motion(agent, poses.load_traced_frame(index)),
            ),
            poses.tick_s,
            key=poses.build_drive_key(agent),
            frame=index,
            conditions=ImuConditions(
                air_c=poses.timeline.weather_at(index).temperature_c,
                running_s=frame.time_s,
                travelled_m=(
                    poses.find_travelled_m(agent, before),
                    poses.find_travelled_m(agent, index),
                ),
            ),
        )


class CanDriver(SensorDriver):
    """Samples buses of vehicles; they have no state before the first frame."""

    def measure(self, agent: Agent, number: int) -> CanSample | None:
        """Sample the signals since the previous frame; None if there is none."""
        index, poses, bus = self.stage.frame.index, self.stage.poses, agent.sensors.can
        if bus is None or isinstance(agent.place, RoadsideUnit):
            return None
        before, now = (
            poses.load_traced_frame(at).get_state(agent.number) for at in (max(index - 1, 0), index)
        )
        return sample_can_bus(
            bus,
            (before, now),
            poses.tick_s,
            key=poses.build_drive_key(agent),
            frame=index,
        )
