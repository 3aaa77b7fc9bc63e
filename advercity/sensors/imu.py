"""Accelerometer, gyroscope and compass at a vehicle's origin, in its body frame.

They measure the derivatives of the vehicle's pose, as given in annotations.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Imu

from advercity.frames import BodyMotion
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.physics.constants import GRAVITY_M_S2
from advercity.randomness import create_generator
from advercity.sensors.imu_errors import apply_errors
from advercity.sensors.measurements import ImuSample
from advercity.sensors.road_vibration import compute_vibration
from advercity.sensors.sample_times import list_sample_times

_REST_SPECIFIC_FORCE = np.array([0.0, 0.0, GRAVITY_M_S2])


@dataclass(frozen=True)
class ImuConditions:
    """Conditions of a unit, apart from its motion.

    Attributes:
        air_c: Temperature of the air.
        running_s: Time since the unit was started.
        travelled_m: Distance of its vehicle at the previous tick and at this one.
    """

    air_c: float = 15.0
    running_s: float = 0.0
    travelled_m: tuple[float, float] = (0.0, 0.0)


def measure_imu(
    imu: Imu,
    world_from_body: tuple[Matrix, Matrix],
    motions: tuple[BodyMotion, BodyMotion],
    tick_s: float,
    *,
    key: tuple[int | str, ...],
    frame: int,
    conditions: ImuConditions | None = None,
) -> ImuSample | None:
    """Measure the samples between two successive ticks, including the second.

    Acceleration is interpolated linearly between the ticks, as along a cubic spline.

    Args:
        imu: Grade and rate of the unit.
        world_from_body: Poses (4, 4) at the previous tick and at this one.
        motions: Motions at the same ticks.
        tick_s: Time between the ticks.
        key: Key of the unit and its noise, such as seed and agent; the same for all frames.
        frame: Number of the frame from 0, which is the number of ticks of the bias's drift.
        conditions: Conditions of the unit; by default, it has just been started.

    Returns:
        The last sample, with the others as `earlier`; None if there is none.
    """
    conditions = conditions or ImuConditions()
    times = list_sample_times(imu, tick_s, frame, key=(*key, "imu"))
    fractions = times.fractions
    count = len(fractions)
    if not count:
        return None
    now = fractions[:, None]
    places = poses.interpolate_poses(*world_from_body, fractions)
    last, current = motions
    acceleration = (1.0 - now) * last.acceleration + now * current.acceleration
    rate = (1.0 - now) * last.angular_rate + now * current.angular_rate
    pushed = zip(places, acceleration + _REST_SPECIFIC_FORCE, strict=True)
    force = np.array([place[:3, :3].T @ push for place, push in pushed])
    if imu.vibration is not None:
        force = force + compute_vibration(
            imu.vibration,
            np.interp(fractions, [0.0, 1.0], conditions.travelled_m),
            np.linalg.norm((1.0 - now) * last.velocity + now * current.velocity, axis=1),
            rate_hz=1.0 / times.step_s,
            key=key,
        )
    errors = imu.instrument
    running_s = np.maximum(conditions.running_s + (fractions - 1.0) * tick_s, 0.0)
    warming = 1.0 - np.exp(-running_s / errors.warm_up_s)
    force, rate = apply_errors(
        errors,
        force,
        rate,
        times,
        temperature_c=conditions.air_c + errors.self_heating_c * warming,
        key=key,
        frame=frame,
    )
    yaw_errors = create_generator(*key, "compass", frame).standard_normal(count)
    yaw_errors *= math.radians(imu.compass_noise_deg)
    samples = [
        ImuSample(
            specific_force=force[at],
            angular_rate=rate[at],
            compass_rad=_compute_compass(places[at], float(yaw_errors[at])),
            time_s=(fractions[at] - 1.0) * tick_s,
        )
        for at in range(count)
    ]
    return replace(samples[-1], earlier=tuple(samples[:-1]))


def _compute_compass(world_from_body: Matrix, error: float) -> float:
    """Compute the heading clockwise from north, with an error added."""
    yaw, _, _ = poses.to_yaw_pitch_roll(world_from_body)
    return (math.pi / 2.0 - yaw + error) % (2.0 * math.pi)
