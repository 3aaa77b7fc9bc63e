"""Where a LiDAR's beams point: channels, azimuths and the rays that stand for a beam."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIVERGENCE_RAD = (3.0e-3, 1.5e-3)
"""Full opening of a beam across and along the sensor's axis, as a VLP-32C has it."""
APERTURE_M = (12e-3, 9e-3)
"""Size of a beam where it leaves the sensor."""
RING_RADIUS = 0.65
"""Of the six outer sub-rays, in half-widths of the beam."""

_HDL_32E_DEG = np.linspace(-30.67, 10.67, 32)
_VLP_32C_DEG = np.array(
    [
        -25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843,
        -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4.0,
        -4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667,
        -3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333, -1.333,
    ]
)  # fmt: skip
_VLP_32C_OFFSET_DEG = np.array(
    [
        1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
        1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4,
    ]
)  # fmt: skip
"""Both by laser, as its manual lists them."""


@dataclass(frozen=True)
class Head:
    """What turns: all that the directions of its rays depend on.

    Attributes:
        azimuths: Steps of a turn.
        elevations_rad: Of every channel, from the lowest up.
        offsets_rad: How far to the left of the head each channel looks.
        sub_rays: Rays that stand for one beam.
    """

    azimuths: int
    elevations_rad: tuple[float, ...]
    offsets_rad: tuple[float, ...]
    sub_rays: int = 1


def head_of(lidar: Lidar) -> Head:
    """The head of a sensor."""
    elevations, offsets = elevations_rad(lidar), offsets_rad(lidar)
    return Head(lidar.azimuths, tuple(elevations), tuple(offsets), lidar.sub_rays)


def elevations_rad(lidar: Lidar) -> Array:
    """Elevation of every channel (channels,), from the lowest up."""
    if lidar.channel_table == "hdl_32e":
        return np.radians(_HDL_32E_DEG)
    if lidar.channel_table == "vlp_32c":
        return np.radians(np.sort(_VLP_32C_DEG))
    return np.radians(np.linspace(lidar.lower_deg, lidar.upper_deg, lidar.channels))


def offsets_rad(lidar: Lidar) -> Array:
    """How far to the left of the turning head each channel (channels,) looks."""
    if lidar.channel_table == "vlp_32c":
        # Velodyne counts azimuth clockwise.
        return -np.radians(_VLP_32C_OFFSET_DEG[np.argsort(_VLP_32C_DEG)])
    return np.zeros(lidar.channels)


def beams(lidar: Lidar) -> NDArray[np.float32]:
    """Directions (azimuths * channels, 3) of one turn, unit vectors in the LiDAR frame.

    They turn counter-clockwise from straight ahead, all channels at each azimuth. Read-only.
    """
    return directions(replace(head_of(lidar), sub_rays=1))


def bearings_rad(azimuths: int) -> NDArray[np.float32]:
    """Azimuth of the head (azimuths,) in its turn, ascending."""
    turn = np.arange(azimuths) * (2.0 * math.pi / azimuths)
    return turn.astype(np.float32)


def weights(lidar: Lidar) -> NDArray[np.float32]:
    """Share of a beam's power (sub_rays,) that each of its rays stands for: a Gaussian profile."""
    profile = np.exp(-2.0 * np.array([0.0, *[RING_RADIUS] * (lidar.sub_rays - 1)]) ** 2)
    return (profile / profile.sum()).astype(np.float32)


@lru_cache(maxsize=8)
def directions(head: Head) -> NDArray[np.float32]:
    """Directions (azimuths * channels * sub_rays, 3) of the rays that stand for the beams.

    Those of a beam are side by side, the one along its axis first. Read-only.
    """
    turn = np.arange(head.azimuths)[:, None] * (2.0 * math.pi / head.azimuths)
    azimuth = turn + np.array(head.offsets_rad)
    elevation = np.broadcast_to(np.array(head.elevations_rad), azimuth.shape)
    cos_az, sin_az = np.cos(azimuth), np.sin(azimuth)
    cos_el, sin_el = np.cos(elevation), np.sin(elevation)
    axis = np.stack([cos_el * cos_az, cos_el * sin_az, sin_el], axis=-1)
    left = np.stack([-sin_az, cos_az, np.zeros_like(azimuth)], axis=-1)
    up = np.stack([-sin_el * cos_az, -sin_el * sin_az, cos_el], axis=-1)
    spread = np.stack([axis + y * left + z * up for y, z in _spread_rad(head.sub_rays)], axis=-2)
    spread /= np.linalg.norm(spread, axis=-1, keepdims=True)
    table = spread.reshape(-1, 3).astype(np.float32)
    table.flags.writeable = False
    return table


def _spread_rad(sub_rays: int) -> list[tuple[float, float]]:
    """Leftward and upward angle of each of a beam's rays: its axis and a hexagon around it."""
    wide, high = (RING_RADIUS * opening / 2.0 for opening in DIVERGENCE_RAD)
    turn = [corner * math.pi / 3.0 for corner in range(sub_rays - 1)]
    return [(0.0, 0.0), *((wide * math.cos(angle), high * math.sin(angle)) for angle in turn)]
