"""Measures the fixes of the satellite receivers of an open scenario."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from advercity_dsl import Agent
from advercity_dsl.positioning import SatelliteReceiver

from advercity.frames import Frame
from advercity.geometry.geodesy import Geodetic, enu_from_geodetic
from advercity.geometry.poses import Matrix
from advercity.randomness import create_generator, sample_gauss_markov
from advercity.sensors.gnss.noise_models import measure_gnss
from advercity.sensors.gnss.receiver import ReceiverInPlace
from advercity.sensors.gnss.signal_paths import SkyView
from advercity.sensors.measurements import GnssFix
from advercity.sensors.sample_times import list_sample_times
from advercity.sensors.stage import SensorDriver, Stage


class GnssDriver(SensorDriver):
    """Measures with satellite receivers."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._sky = SkyView(stage.raycaster)
        self._receivers: dict[tuple[str, SatelliteReceiver], ReceiverInPlace] = {}
        self._fixes: dict[str, GnssFix | None] = {}

    def prepare(self) -> None:
        """Measure all fixes by satellites, whose rays are cast into a world without actors."""
        self._fixes = {
            agent.id: self._measure_fix(agent, self.stage.frame)
            for agent in self.stage.spec.recorded_agents
            if agent.sensors.gnss.mode == "satellites"
        }

    def measure(self, agent: Agent, number: int) -> GnssFix | None:
        """Measure the fixes since the previous frame; None without a fix.

        A roadside unit reports fixes by satellites only.
        """
        if agent.id in self._fixes:
            return self._fixes[agent.id]
        return None if agent.place.kind == "roadside_unit" else self._draw_fix(agent)

    def estimate_pose(self, agent: Agent) -> Matrix | None:
        """Estimate the pose (4, 4) of a roadside unit from its receiver's fix."""
        if agent.place.kind != "roadside_unit":
            return None
        is_measured = agent.id in self._fixes
        fix = self._fixes[agent.id] if is_measured else self._draw_fix(agent)
        if fix is None:
            return None
        poses = self.stage.poses
        estimate = poses.world_from_agent(agent, self.stage.frame.index).copy()
        place = Geodetic(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
        estimate[:3, 3] = enu_from_geodetic(place, poses.origin)
        return estimate

    def _measure_fix(self, agent: Agent, frame: Frame) -> GnssFix | None:
        """Measure the fixes of an agent's satellite receiver since the previous frame."""
        poses = self.stage.poses
        gnss, key, tick_s = agent.sensors.gnss, poses.build_drive_key(agent), poses.tick_s
        place = agent.id, gnss.receiver
        if place not in self._receivers:
            self._receivers[place] = ReceiverInPlace(
                gnss.receiver,
                self._sky,
                poses.origin,
                pose_at=partial(poses.find_pose, agent),
                key=key,
            )
        receiver = self._receivers[place]
        times = list_sample_times(gnss, tick_s, frame.index, key=(*key, "gnss"))
        motion = poses.find_motion(agent, frame)
        fixes = [
            receiver.measure(
                (frame.index - 1 + fraction) * tick_s,
                velocity=motion.velocity + (fraction - 1.0) * tick_s * motion.acceleration,
                number=times.first + at,
                step_s=times.step_s,
                stamp_s=frame.time_s + (fraction - 1.0) * tick_s,
            )
            for at, fraction in enumerate(times.fractions.tolist())
        ]
        return _join_fixes([fix for fix in fixes if fix is not None])

    def _draw_fix(self, agent: Agent) -> GnssFix | None:
        """Draw fixes of an error model since the previous frame."""
        frame, poses = self.stage.frame, self.stage.poses
        gnss, index, key = agent.sensors.gnss, frame.index, poses.build_drive_key(agent)
        tick_s = poses.tick_s
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
                    poses.find_pose(agent, (index - 1 + fraction) * tick_s)[:3, 3],
                    origin=poses.origin,
                    time_s=frame.time_s + (fraction - 1.0) * tick_s,
                    rng=create_generator(*key, "gnss", times.first + at),
                    slow_error=slow[at],
                )
                for at, fraction in enumerate(times.fractions.tolist())
            ]
        )


def _join_fixes(fixes: Sequence[GnssFix]) -> GnssFix | None:
    """Return the last fix of a frame, with the others as `earlier`; None if there is none."""
    return replace(fixes[-1], earlier=tuple(fixes[:-1])) if fixes else None
