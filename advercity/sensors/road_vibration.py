"""Vertical acceleration of a vehicle's body on a rough road.

The road is a sum of waves with the spectrum of ISO 8608; its phases are drawn once, so the
acceleration is a function of place and speed. The body is the sprung mass of the quarter car of
the International Roughness Index (Sayers, Transportation Research Record 1501, 1995), taken as
steady at the speed of the moment.
"""

import numpy as np
from advercity_dsl.inertial import RoadVibration
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator

ROUGHNESS_M3 = {"a": 16e-6, "b": 64e-6, "c": 256e-6, "d": 1024e-6, "e": 4096e-6}
"""Spectral density of the road's height at 0.1 cycles per metre: geometric means of ISO 8608."""
REFERENCE_CYCLES_M = 0.1
WAVES_CYCLES_M = np.geomspace(0.011, 10.0, 240)
"""Waves per metre, over a little more than the range of ISO 8608."""
SPRING_1_S2, TYRE_1_S2, DAMPER_1_S, UNSPRUNG_RATIO = 63.3, 653.0, 6.0, 0.15
"""The quarter car's suspension, tyre, damper and wheel, over the mass of the body."""


def compute_vibration(
    vibration: RoadVibration,
    travelled_m: Float64Array,
    speed_m_s: Float64Array,
    *,
    rate_hz: float,
    key: tuple[int | str, ...],
) -> Float64Array:
    """Compute accelerations (n, 3), m/s², forward, to the left and up.

    Args:
        vibration: Class of the road.
        travelled_m: (n,) distance of each sample along the road.
        speed_m_s: (n,) speed at each sample.
        rate_hz: Rate of the samples; the unit filters out frequencies above half of it.
        key: Key of the road's phases, the same for all samples.
    """
    frequency = WAVES_CYCLES_M * np.asarray(speed_m_s)[:, None]
    seen = frequency < rate_hz / 2.0
    response = np.where(seen, _compute_response(2.0 * np.pi * frequency), 0.0)
    spectrum = ROUGHNESS_M3[vibration.road] * (WAVES_CYCLES_M / REFERENCE_CYCLES_M) ** -2.0
    height_m = np.sqrt(2.0 * spectrum * np.gradient(WAVES_CYCLES_M))
    phases = create_generator(*key, "road").uniform(0.0, 2.0 * np.pi, (3, len(WAVES_CYCLES_M)))
    turn = 2.0 * np.pi * WAVES_CYCLES_M * np.asarray(travelled_m)[:, None]
    waves = height_m * response * np.exp(1j * turn)
    accelerations = np.real(waves @ np.exp(1j * phases).T)
    fraction = vibration.horizontal_fraction
    return accelerations * np.array([fraction, fraction, 1.0])


def _compute_response(rate: Float64Array) -> NDArray[np.complex128]:
    """Compute the body's acceleration over the road's height, 1/s², at rates in rad/s."""
    suspension = SPRING_1_S2 + 1j * DAMPER_1_S * rate
    body, wheel = suspension - rate**2, suspension + TYRE_1_S2 - UNSPRUNG_RATIO * rate**2
    return -(rate**2) * TYRE_1_S2 * suspension / (body * wheel - suspension**2)
