"""Accelerometer, gyroscope and compass at a vehicle's origin, in its body frame.

Noise is white plus a first-order Gauss-Markov bias, with the figures that gnss-ins-sim takes from
data sheets.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Imu
from numpy.typing import NDArray

from advercity.poses import Matrix, angles
from advercity.randomness import generator

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
BIAS_TIME_S = 100.0
"""Correlation time of the biases."""


@dataclass(frozen=True, eq=False)
class ImuSample:
    """What an inertial unit reports.

    Attributes:
        specific_force: (3,) m/s², body frame; (0, 0, 9.81) at rest on level ground.
        angular_rate: (3,) rad/s, body frame.
        compass_rad: Heading clockwise from north, from 0 to 2 pi.
    """

    specific_force: Array
    angular_rate: Array
    compass_rad: float


@dataclass(frozen=True)
class _Grade:
    """Densities per sqrt(Hz) and standard deviations of the biases, SI."""

    gyro_density: float
    gyro_bias: float
    accelerometer_density: float
    accelerometer_bias: float


_UP = np.array([0.0, 0.0, GRAVITY_M_S2])
_GRADES = {
    "ideal": _Grade(0.0, 0.0, 0.0, 0.0),
    "low": _Grade(2.18e-4, math.radians(10.0 / 3600.0), 8.33e-4, 2.0e-4),
    "mid": _Grade(7.27e-5, math.radians(3.5 / 3600.0), 5.0e-4, 5.0e-5),
    "high": _Grade(5.8e-7, math.radians(0.1 / 3600.0), 4.2e-7, 3.6e-6),
}


def measure(
    imu: Imu,
    world_from_body: tuple[Matrix, Matrix, Matrix],
    tick_s: float,
    *,
    key: tuple[int | str, ...],
    frame: int,
) -> ImuSample:
    """The sample at the middle one of three consecutive poses.

    Args:
        imu: Its grade.
        world_from_body: Poses (4, 4) one tick before, now and one tick after.
        tick_s: Time between them.
        key: What the noise is for: seed, agent; the same for all frames.
        frame: Counts from 0; the bias has wandered that many ticks.
    """
    before, now, after = world_from_body
    acceleration = (after[:3, 3] - 2.0 * now[:3, 3] + before[:3, 3]) / tick_s**2
    force = now[:3, :3].T @ (acceleration + _UP)
    rate = rotation_vector(before[:3, :3].T @ after[:3, :3]) / (2.0 * tick_s)
    error = _error(_GRADES[imu.grade], tick_s, key, frame)
    yaw, _, _ = angles(now)
    return ImuSample(
        specific_force=force + error[:3],
        angular_rate=rate + error[3:],
        compass_rad=(math.pi / 2.0 - yaw) % (2.0 * math.pi),
    )


def rotation_vector(rotation: Matrix) -> Array:
    """Axis times angle in rad (3,) of a rotation (3, 3) of less than half a turn."""
    twice_sine = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    angle = np.arctan2(np.linalg.norm(twice_sine), np.trace(rotation) - 1.0)
    return twice_sine / (2.0 * np.sinc(angle / np.pi))


def _error(grade: _Grade, tick_s: float, key: tuple[int | str, ...], frame: int) -> Array:
    """White noise plus bias (6,): accelerometer, then gyroscope."""
    density = np.repeat([grade.accelerometer_density, grade.gyro_density], 3)
    bias = np.repeat([grade.accelerometer_bias, grade.gyro_bias], 3)
    white = generator(*key, "imu noise", frame).standard_normal(6)
    wander = _wander(generator(*key, "imu bias"), frame, math.exp(-tick_s / BIAS_TIME_S))
    return density / math.sqrt(tick_s) * white + bias * wander


def _wander(rng: np.random.Generator, frame: int, memory: float) -> Array:
    """Gauss-Markov process (6,) of variance 1 at `frame`, the sum of all steps up to it."""
    steps = rng.standard_normal((frame + 1, 6))
    steps[1:] *= math.sqrt(1.0 - memory**2)
    return memory ** np.arange(frame, -1, -1) @ steps
