"""Accelerometer, gyroscope and compass at a vehicle's origin, in its body frame.

They measure the derivatives of the vehicle's pose, which annotations have, too.
Noise is white plus a first-order Gauss-Markov bias, with the data-sheet values of gnss-ins-sim.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Imu

from advercity.frames import BodyMotion
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix
from advercity.physics.constants import GRAVITY_M_S2
from advercity.randomness import create_generator, sample_gauss_markov
from advercity.sensors.measurements import ImuSample

BIAS_CORRELATION_TIME_S = 100.0
"""Correlation time of the biases."""


@dataclass(frozen=True)
class _ImuGrade:
    """Noise densities per sqrt(Hz) and standard deviations of the biases, in m/s² and rad/s."""

    gyro_density: float
    gyro_bias: float
    accelerometer_density: float
    accelerometer_bias: float


_REST_SPECIFIC_FORCE = np.array([0.0, 0.0, GRAVITY_M_S2])
_IMU_GRADES = {
    "ideal": _ImuGrade(0.0, 0.0, 0.0, 0.0),
    "low": _ImuGrade(2.18e-4, math.radians(10.0 / 3600.0), 8.33e-4, 2.0e-4),
    "mid": _ImuGrade(7.27e-5, math.radians(3.5 / 3600.0), 5.0e-4, 5.0e-5),
    "high": _ImuGrade(5.8e-7, math.radians(0.1 / 3600.0), 4.2e-7, 3.6e-6),
}


def measure_imu(
    imu: Imu,
    world_from_body: tuple[Matrix, Matrix],
    motions: tuple[BodyMotion, BodyMotion],
    tick_s: float,
    *,
    key: tuple[int | str, ...],
    frame: int,
) -> ImuSample:
    """Measure the sample at the second of two successive ticks.

    A unit with more than one sample per tick measures between the ticks, too, where acceleration
    is interpolated linearly, as that of a cubic spline.

    Args:
        imu: Grade and rate of the unit.
        world_from_body: Poses (4, 4) at the previous tick and at this one.
        motions: The motions that go with them.
        tick_s: Time between them.
        key: Key of the noise, such as seed and agent; the same for all frames.
        frame: Number of the frame from 0; the bias has drifted that many ticks.
    """
    count = imu.samples_per_tick
    fractions = [(step + 1) / count for step in range(count)]
    places = poses.interpolate_poses(*world_from_body, fractions)
    errors = _draw_errors(imu, tick_s / count, key, frame)
    samples = [
        _compute_sample(place, motions, fraction, error, tick_s)
        for place, fraction, error in zip(places, fractions, errors, strict=True)
    ]
    return replace(samples[-1], earlier=tuple(samples[:-1]))


def _compute_sample(
    world_from_body: Matrix,
    motions: tuple[BodyMotion, BodyMotion],
    fraction: float,
    error: Float64Array,
    tick_s: float,
) -> ImuSample:
    """Compute the sample at a fraction of the tick; error (7,) as `_draw_errors` returns it."""
    last, now = motions
    acceleration = (1.0 - fraction) * last.acceleration + fraction * now.acceleration
    rate = (1.0 - fraction) * last.angular_rate + fraction * now.angular_rate
    yaw, _, _ = poses.to_yaw_pitch_roll(world_from_body)
    return ImuSample(
        specific_force=world_from_body[:3, :3].T @ (acceleration + _REST_SPECIFIC_FORCE)
        + error[:3],
        angular_rate=rate + error[3:6],
        compass_rad=(math.pi / 2.0 - yaw + float(error[6])) % (2.0 * math.pi),
        time_s=(fraction - 1.0) * tick_s,
    )


def _draw_errors(imu: Imu, step_s: float, key: tuple[int | str, ...], frame: int) -> Float64Array:
    """Draw white noise plus bias (samples, 7): accelerometer, gyroscope, compass."""
    grade, count = _IMU_GRADES[imu.grade], imu.samples_per_tick
    density = np.repeat([grade.accelerometer_density, grade.gyro_density], 3)
    bias = np.repeat([grade.accelerometer_bias, grade.gyro_bias], 3)
    white = create_generator(*key, "imu noise", frame).standard_normal((count, 6))
    first = frame * count
    slow = sample_gauss_markov(
        create_generator(*key, "imu bias"),
        first,
        first + count - 1,
        correlation=math.exp(-step_s / BIAS_CORRELATION_TIME_S),
        axes=6,
    )
    compass = create_generator(*key, "compass", frame).standard_normal((count, 1))
    return np.concatenate(
        [
            density / math.sqrt(step_s) * white + bias * slow,
            math.radians(imu.compass_noise_deg) * compass,
        ],
        axis=1,
    )
