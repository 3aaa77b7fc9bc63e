"""Gain and link budget of a radar, from its declaration."""

import math

import numpy as np
from advercity_dsl import Radar
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.microwaves import SPEED_OF_LIGHT_M_S, WAVELENGTH_M

ARRAY_GAIN = 16.0
"""Gain by adding up the receivers; transmitters take turns."""
LOSS_DB = 12.0
"""Windows in four dimensions, and the losses of circuits and antenna: an assumption."""
BOLTZMANN_J_K, TEMPERATURE_K = 1.380649e-23, 290.0
_GAIN_BEAM_DEG2 = 30_000.0
"""Gain times both beam widths, of practical antennas (Balanis, Antenna Theory, 2005, 2.9)."""


def compute_gain(radar: Radar, directions: FloatArray) -> FloatArray:
    """Compute the gain (n,) of one antenna along unit vectors (n, 3): -3 dB at the edges."""
    half_azimuth, half_elevation = (
        math.radians(angle) / 2.0 for angle in (radar.azimuth_fov_deg, radar.elevation_fov_deg)
    )
    azimuth, elevation = compute_angles(directions)
    off_axis = (azimuth / half_azimuth) ** 2 + (elevation / half_elevation) ** 2
    peak = _GAIN_BEAM_DEG2 / (radar.azimuth_fov_deg * radar.elevation_fov_deg)
    return peak * np.exp2(-off_axis)


def compute_two_way_gain(radar: Radar, out: FloatArray, home: FloatArray) -> FloatArray:
    """Compute the gain of transmitter and receiver together; 0 outside the field of view.

    Args:
        radar: The sensor.
        out: (n, 3) unit vectors along the waves sent, radar frame.
        home: (n, 3) unit vectors towards the arriving waves, radar frame.

    Returns:
        (n,) product of both gains.
    """
    gain = compute_gain(radar, out) * compute_gain(radar, home)
    return gain * (is_in_view(radar, out) & is_in_view(radar, home))


def is_in_view(radar: Radar, directions: FloatArray) -> NDArray[np.bool_]:
    """Find which unit vectors (n, 3) are in the field of view."""
    azimuth, elevation = np.degrees(compute_angles(directions))
    return (np.abs(azimuth) < radar.azimuth_fov_deg / 2.0) & (
        np.abs(elevation) < radar.elevation_fov_deg / 2.0
    )


def build_directions(azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
    """Build unit vectors (..., 3) from angles in radians; both broadcast to (...)."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    level = np.cos(elevation)
    parts = (level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation))
    return np.stack(parts, axis=-1)


def compute_angles(directions: FloatArray) -> FloatArray:
    """Compute azimuth and elevation (2, n) of unit vectors (n, 3) in radians."""
    x, y, z = directions.T
    return np.stack([np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))])


def compute_range_cell_m(radar: Radar) -> float:
    """Compute the range resolution of the bandwidth."""
    return SPEED_OF_LIGHT_M_S / (2e6 * radar.bandwidth_mhz)


def compute_echo_factor(radar: Radar) -> float:
    """Compute the signal-to-noise ratio of a path per unit of gain², m² and 1/m⁴.

    The radar equation has the energy of one measurement; its time follows from the velocity cell.
    """
    time_s = WAVELENGTH_M / (2.0 * radar.speed_cell_m_s)
    energy_j = 10.0 ** (radar.transmit_dbm / 10.0 - 3.0) * time_s * ARRAY_GAIN
    spreading = WAVELENGTH_M**2 / (4.0 * math.pi) ** 3
    return energy_j * spreading / compute_noise_w_hz(radar) / 10.0 ** (LOSS_DB / 10.0)


def compute_noise_w_hz(radar: Radar) -> float:
    """Compute the power density of the receiver's noise."""
    return BOLTZMANN_J_K * TEMPERATURE_K * 10.0 ** (radar.noise_figure_db / 10.0)
