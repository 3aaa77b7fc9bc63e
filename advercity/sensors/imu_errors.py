"""Errors of accelerometers and gyroscopes.

The model is the usual one of strapdown navigation (Groves, Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems, 2nd edition, 4.4): scale, misalignment, white noise, and
a bias. The bias has a constant part, depends on temperature and specific force, and drifts. Noise
terms follow IEEE Std 952.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl.inertial import AccelerometerErrors, GyroscopeErrors, ImuErrors

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator, sample_gauss_markov, sample_random_walk
from advercity.sensors.sample_times import SampleTimes

BIAS_CORRELATION_TIME_S = 100.0
"""Correlation time of the drifting biases, as in gnss-ins-sim."""
ALLAN_FLOOR = 0.6174
"""Largest Allan deviation of a Gauss-Markov process over its standard deviation (IEEE Std 952)."""
STANDARD_GRAVITY_M_S2 = 9.80665
"""The unit g of data sheets."""
_UG_M_S2 = STANDARD_GRAVITY_M_S2 * 1e-6
_DEG_H_RAD_S = math.radians(1.0) / 3600.0
_ROOT_HOUR = 60.0
"""Square root of an hour, in root seconds."""


@dataclass(frozen=True, eq=False)
class _Triad:
    """Three instruments of one kind in SI units; `unit` is m/s² or rad/s.

    Attributes:
        noise_density: White noise, unit per root hertz.
        bias_sd: Standard deviation of the drifting bias.
        walk_density: Random walk of the bias, unit per root second.
        bias: (3,) constant bias.
        bias_per_c: (3,) per degree.
        gain: (3, 3) of input, less the identity.
        scale_per_c: (3,) per degree.
        per_force: (3,) bias per specific force.
        per_squared_force: (3,) bias per squared specific force.
    """

    noise_density: float
    bias_sd: float
    walk_density: float
    bias: Float64Array
    bias_per_c: Float64Array
    gain: Float64Array
    scale_per_c: Float64Array
    per_force: Float64Array
    per_squared_force: Float64Array


def apply_errors(
    errors: ImuErrors,
    force: Float64Array,
    rate: Float64Array,
    times: SampleTimes,
    *,
    temperature_c: Float64Array,
    key: tuple[int | str, ...],
    frame: int,
) -> tuple[Float64Array, Float64Array]:
    """Apply the errors of a unit to true values.

    Args:
        errors: Errors of its kind.
        force: (n, 3) specific force, m/s², body frame.
        rate: (n, 3) angular rate, rad/s, body frame.
        times: Times of the samples.
        temperature_c: (n,) of the unit.
        key: Key of the noise, the same for all frames.
        frame: Number of the frame from 0.

    Returns:
        (n, 3) measured specific force and (n, 3) measured angular rate.
    """
    count = len(force)
    if errors == ImuErrors() or count == 0:
        return force, rate
    triads = _draw_unit(errors, key)
    white = create_generator(*key, "imu noise", frame).standard_normal((count, 6))
    segment = times.first, times.first + count - 1
    slow = sample_gauss_markov(
        create_generator(*key, "imu bias"),
        *segment,
        correlation=math.exp(-times.step_s / BIAS_CORRELATION_TIME_S),
        axes=6,
    )
    walk = sample_random_walk(create_generator(*key, "imu walk"), *segment, axes=6)
    warmer_c = (temperature_c - errors.calibrated_at_c)[:, None]
    measured: list[Float64Array] = []
    for triad, values, axes in zip(triads, (force, rate), (slice(0, 3), slice(3, 6)), strict=True):
        drift = triad.bias_sd * slow[:, axes]
        drift += triad.walk_density * math.sqrt(times.step_s) * walk[:, axes]
        noise = triad.noise_density / math.sqrt(times.step_s) * white[:, axes]
        scaled = values + values @ triad.gain.T + values * triad.scale_per_c * warmer_c
        by_force = triad.per_force * force + triad.per_squared_force * force**2
        biased = triad.bias + triad.bias_per_c * warmer_c + by_force
        measured.append(scaled + biased + drift + noise)
    return measured[0], measured[1]


def _draw_unit(errors: ImuErrors, key: tuple[int | str, ...]) -> tuple[_Triad, _Triad]:
    """Draw accelerometers and gyroscopes of one unit from the errors of its kind."""
    rng = create_generator(*key, "imu unit")
    return (
        _draw_accelerometers(errors.accelerometer, rng.standard_normal((8, 3))),
        _draw_gyroscopes(errors.gyroscope, rng.standard_normal((8, 3))),
    )


def _draw_accelerometers(errors: AccelerometerErrors, drawn: Float64Array) -> _Triad:
    return _Triad(
        noise_density=errors.noise_m_s_rth / _ROOT_HOUR,
        bias_sd=errors.bias_instability_ug * _UG_M_S2 / ALLAN_FLOOR,
        walk_density=errors.bias_walk_ug_rth * _UG_M_S2 / _ROOT_HOUR,
        bias=errors.turn_on_bias_ug * _UG_M_S2 * drawn[0],
        bias_per_c=errors.bias_ug_per_c * _UG_M_S2 * drawn[1],
        gain=_build_gain(errors.scale_ppm, errors.misalignment_mrad, drawn),
        scale_per_c=errors.scale_ppm_per_c * 1e-6 * drawn[6],
        per_force=np.zeros(3),
        per_squared_force=errors.rectification_ug_g2
        * _UG_M_S2
        / STANDARD_GRAVITY_M_S2**2
        * drawn[7],
    )


def _draw_gyroscopes(errors: GyroscopeErrors, drawn: Float64Array) -> _Triad:
    per_force = errors.g_sensitivity_deg_h_g * _DEG_H_RAD_S / STANDARD_GRAVITY_M_S2
    return _Triad(
        noise_density=math.radians(errors.noise_deg_rth) / _ROOT_HOUR,
        bias_sd=errors.bias_instability_deg_h * _DEG_H_RAD_S / ALLAN_FLOOR,
        walk_density=errors.bias_walk_deg_h_rth * _DEG_H_RAD_S / _ROOT_HOUR,
        bias=errors.turn_on_bias_deg_h * _DEG_H_RAD_S * drawn[0],
        bias_per_c=errors.bias_deg_h_per_c * _DEG_H_RAD_S * drawn[1],
        gain=_build_gain(errors.scale_ppm, errors.misalignment_mrad, drawn),
        scale_per_c=errors.scale_ppm_per_c * 1e-6 * drawn[6],
        per_force=per_force * drawn[7],
        per_squared_force=np.zeros(3),
    )


def _build_gain(scale_ppm: float, misalignment_mrad: float, drawn: Float64Array) -> Float64Array:
    """Build a matrix (3, 3) of errors of scale, and of angles between the axes."""
    off_axis = misalignment_mrad * 1e-3 * drawn[3:6]
    return np.where(np.eye(3) > 0, scale_ppm * 1e-6 * drawn[2], off_axis)
