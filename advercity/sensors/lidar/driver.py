"""Scans with the LiDARs of an open scenario."""

from functools import lru_cache

from advercity_dsl import Agent, Lidar

from advercity.frames import Frame
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.annotation import count_lidar_hits
from advercity.sensors.lidar.beams import ScanTime
from advercity.sensors.lidar.conditions import LidarConditions, derive_lidar_conditions
from advercity.sensors.lidar.point_cloud import measure_point_cloud
from advercity.sensors.lidar.scan import ScanHits, cast_scan
from advercity.sensors.sensor_frame import LidarScan
from advercity.sensors.stage import SensorDriver, Stage


class LidarDriver(SensorDriver):
    """Measures with LiDARs."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._derive_once = lru_cache(maxsize=1)(self._derive_conditions)

    def measure(self, agent: Agent, number: int) -> LidarScan:
        """Measure a scan."""
        stage, lidar = self.stage, agent.sensors.lidars[number]
        frame = stage.find_sampled_frame("lidar", agent, number)
        conditions = self._derive_once(stage.weather_state)
        hits = self._cast(agent, number, frame, conditions)
        # The first LiDAR's key has no number, as in datasets of carriers with one.
        rng = stage.poses.make_generator("lidar", agent, frame, *([number] if number else []))
        mount = agent.sensors.list_sensors("lidar")[number].mount
        cloud = measure_point_cloud(
            *(lidar, hits, conditions, rng),
            states=frame.states,
            mount_yaw_deg=mount.yaw_deg,
            window_key=(stage.spec.seeds.sensors, stage.spec.id, "lidar", agent.id, number),
        )
        counted = count_lidar_hits(hits, lidar)
        stamp_s = stage.find_stamp("lidar", agent, number)
        return LidarScan(hits.world_from_lidar, cloud, counted, stamp_s)

    def _derive_conditions(self, state: int) -> LidarConditions:
        weather = self.stage.poses.timeline.weather_at(state)
        return derive_lidar_conditions(self.stage.atmosphere, weather.lens)

    def _cast(
        self, agent: Agent, number: int, frame: Frame, conditions: LidarConditions
    ) -> ScanHits:
        lidar, poses = agent.sensors.lidars[number], self.stage.poses
        time = find_scan_time(lidar, frame, poses)
        previous = poses.rewind_frame(frame, time.period_s) if lidar.motion_distortion else None
        raycaster = self.stage.place_raycaster(frame, agent, previous_frame=previous)
        return cast_scan(
            lidar,
            poses.world_from_sensors("lidar", agent, frame)[number],
            raycaster,
            previous_world_from_lidar=None
            if previous is None
            else poses.world_from_sensors("lidar", agent, previous)[number],
            puddle_coverage=conditions.puddle_coverage,
            time=time,
        )


def find_scan_time(lidar: Lidar, frame: Frame, poses: AgentPoses) -> ScanTime:
    """Find the time of a LiDAR's scan at a frame; the scan ends at the frame's instant."""
    period_s = lidar.find_scan_period_s(poses.tick_s)
    end_s = frame.index * poses.tick_s + poses.find_shift_s(frame)
    return ScanTime(round(end_s / period_s, 9), period_s)
