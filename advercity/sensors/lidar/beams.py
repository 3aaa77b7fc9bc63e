"""Directions of a LiDAR's beams and their sub-rays, and the beams towards a box.

Angles are in the LiDAR frame (x forward, y left, z up), azimuths counterclockwise from x.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from advercity_dsl import Lidar
from advercity_dsl.lidar import PrismScan
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.geometry.poses import Matrix, invert_pose, transform_points

SUB_RAY_RADIUS = 0.65
"""Distance of the six outer sub-rays from the axis, in half-widths of the beam."""

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
"""Elevations and azimuth offsets in the manual's order of lasers."""


@dataclass(frozen=True)
class BeamShape:
    """Width of a beam in metres by range, from its aperture and divergence.

    Attributes:
        divergence_rad: Full divergence, horizontal and vertical.
        aperture_m: Width and height at the sensor.
    """

    divergence_rad: tuple[float, float] = (3.0e-3, 1.5e-3)
    aperture_m: tuple[float, float] = (12e-3, 9e-3)

    @staticmethod
    def from_lidar(lidar: Lidar) -> "BeamShape":
        """Build the shape of a sensor's beams."""
        beam = lidar.beam
        return BeamShape(
            (beam.horizontal_mrad * 1e-3, beam.vertical_mrad * 1e-3),
            (beam.width_mm * 1e-3, beam.height_mm * 1e-3),
        )

    def cross_section_m2(self, range_m: Float64Array) -> Float64Array:
        """Compute the cross-section (n,) of a beam, an ellipse."""
        wide, high = (
            size + opening * range_m
            for size, opening in zip(self.aperture_m, self.divergence_rad, strict=True)
        )
        return math.pi / 4.0 * wide * high


@dataclass(frozen=True)
class ScanTime:
    """Time of a scan.

    Attributes:
        index: Scans since the start; a fraction, if the scenario starts within a scan.
        period_s: Duration of a scan.
    """

    index: float = 0
    period_s: float = 0.1


FIRST_SCAN = ScanTime()


@dataclass(frozen=True)
class ScanPattern:
    """All inputs of the ray directions of a scan; hashable, as the key of a cache.

    Attributes:
        azimuths: Firings per scan.
        elevations_rad: Elevation of every channel, from the lowest up.
        offsets_rad: Azimuth of each channel relative to the head, to the left.
        divergence_rad: Full divergence of a beam, horizontal and vertical.
        sub_rays: Rays in one beam.
        prisms: Prisms in place of a spinning head.
        azimuth_deg: First and last azimuth of a sensor facing ahead; None for a whole turn.
        time: Time of the scan; without prisms always the first, as all scans are alike.
    """

    azimuths: int
    elevations_rad: tuple[float, ...]
    offsets_rad: tuple[float, ...]
    divergence_rad: tuple[float, float]
    sub_rays: int = 1
    prisms: PrismScan | None = None
    azimuth_deg: tuple[float, float] | None = None
    time: ScanTime = FIRST_SCAN


def build_scan_pattern(lidar: Lidar, time: ScanTime = FIRST_SCAN) -> ScanPattern:
    """Build the pattern of a sensor's scan; without prisms it is the same for all scans."""
    return ScanPattern(
        lidar.azimuths,
        tuple(channel_elevations_rad(lidar)),
        tuple(channel_azimuth_offsets_rad(lidar)),
        BeamShape.from_lidar(lidar).divergence_rad,
        lidar.sub_rays,
        lidar.prisms,
        lidar.azimuth_deg,
        time if lidar.prisms else FIRST_SCAN,
    )


def channel_elevations_rad(lidar: Lidar) -> Float64Array:
    """Look up the elevation of every channel (channels,), from the lowest up."""
    if lidar.elevations_deg:
        return np.radians(np.sort(lidar.elevations_deg))
    if lidar.channel_table == "hdl_32e":
        return np.radians(_HDL_32E_DEG)
    if lidar.channel_table == "vlp_32c":
        return np.radians(np.sort(_VLP_32C_DEG))
    return np.radians(np.linspace(lidar.lower_deg, lidar.upper_deg, lidar.channels))


def channel_azimuth_offsets_rad(lidar: Lidar) -> Float64Array:
    """Look up the azimuth of each channel (channels,) relative to the head, to the left."""
    if lidar.azimuth_offsets_deg:
        return np.radians(np.take(lidar.azimuth_offsets_deg, _order_channels(lidar)))
    if lidar.channel_table == "vlp_32c":
        # Velodyne counts azimuth clockwise.
        return -np.radians(_VLP_32C_OFFSET_DEG[np.argsort(_VLP_32C_DEG)])
    return np.zeros(lidar.channels)


def channel_efficiencies(lidar: Lidar) -> FloatArray | None:
    """Look up the relative power of each channel (channels,), from the lowest up; None if equal."""
    if not lidar.channel_efficiency:
        return None
    return np.take(lidar.channel_efficiency, _order_channels(lidar)).astype(np.float32)


def _order_channels(lidar: Lidar) -> IndexArray:
    """Find the order (channels,) of the declared channels from the lowest up."""
    if not lidar.elevations_deg:
        return np.arange(lidar.channels)
    return np.argsort(lidar.elevations_deg, kind="stable")


def beam_directions(lidar: Lidar, time: ScanTime = FIRST_SCAN) -> NDArray[np.float32]:
    """Build the beam directions (azimuths * channels, 3) of one scan, unit, LiDAR frame.

    Beams go counterclockwise from straight ahead or from the first azimuth, with all channels at
    each azimuth; with prisms, in the order of time. The array is read-only.
    """
    return build_ray_directions(replace(build_scan_pattern(lidar, time), sub_rays=1))


def scan_azimuths_rad(lidar: Lidar) -> NDArray[np.float32]:
    """Compute the azimuths (azimuths,) of the axis during a scan, ascending."""
    return _spread_columns(lidar.azimuths, lidar.azimuth_deg).astype(np.float32)


def _spread_columns(count: int, azimuth_deg: tuple[float, float] | None) -> Float64Array:
    """Compute the azimuths (count,) of a turn from 0, or of a field of view including its ends."""
    if azimuth_deg is None:
        return np.arange(count, dtype=np.float64) * (2.0 * math.pi / count)
    return np.radians(np.linspace(*azimuth_deg, count))


def sub_ray_weights(lidar: Lidar) -> NDArray[np.float32]:
    """Compute the fraction of a beam's power (sub_rays,) in each sub-ray: a Gaussian profile."""
    profile = np.exp(-2.0 * np.array([0.0, *[SUB_RAY_RADIUS] * (lidar.sub_rays - 1)]) ** 2)
    return (profile / profile.sum()).astype(np.float32)


@lru_cache(maxsize=8)
def build_ray_directions(pattern: ScanPattern) -> NDArray[np.float32]:
    """Build the directions (azimuths * channels * sub_rays, 3) of all rays of a scan, unit.

    The sub-rays of a beam are adjacent, with the axis first. The array is read-only.
    """
    head, tilt = _aim_columns(pattern)
    azimuth = head[:, None] + np.array(pattern.offsets_rad)
    elevation = tilt[:, None] + np.array(pattern.elevations_rad)
    cos_az, sin_az = np.cos(azimuth), np.sin(azimuth)
    cos_el, sin_el = np.cos(elevation), np.sin(elevation)
    axis = np.stack([cos_el * cos_az, cos_el * sin_az, sin_el], axis=-1)
    left = np.stack([-sin_az, cos_az, np.zeros_like(azimuth)], axis=-1)
    up = np.stack([-sin_el * cos_az, -sin_el * sin_az, cos_el], axis=-1)
    spread = np.stack([axis + y * left + z * up for y, z in _sub_ray_offsets_rad(pattern)], axis=-2)
    spread /= np.linalg.norm(spread, axis=-1, keepdims=True)
    table = spread.reshape(-1, 3).astype(np.float32)
    table.flags.writeable = False
    return table


def _aim_columns(pattern: ScanPattern) -> tuple[Float64Array, Float64Array]:
    """Compute azimuth and elevation (azimuths,) of the axis at every firing of a scan."""
    column = np.arange(pattern.azimuths, dtype=np.float64)
    if pattern.prisms is None:
        return _spread_columns(pattern.azimuths, pattern.azimuth_deg), np.zeros(pattern.azimuths)
    prisms, time = pattern.prisms, pattern.time
    minutes = (time.index + column / pattern.azimuths) * (time.period_s / 60.0)
    first = 2.0 * math.pi * (prisms.first_rpm * minutes % 1.0)
    second = 2.0 * math.pi * (prisms.second_rpm * minutes % 1.0)
    by_first, by_second = math.radians(prisms.first_deg), math.radians(prisms.second_deg)
    left = by_first * np.cos(first) + by_second * np.cos(second)
    up = by_first * np.sin(first) + by_second * np.sin(second)
    off_axis = np.hypot(left, up)
    # sinc: a beam along the axis has no direction off it.
    scale = np.sinc(off_axis / math.pi)
    return np.arctan2(scale * left, np.cos(off_axis)), np.arcsin(scale * up)


def _sub_ray_offsets_rad(pattern: ScanPattern) -> list[tuple[float, float]]:
    """Compute the angles, left and up, of a beam's rays: its axis and a hexagon around it."""
    wide, high = (SUB_RAY_RADIUS * divergence / 2.0 for divergence in pattern.divergence_rad)
    hexagon = [corner * math.pi / 3.0 for corner in range(pattern.sub_rays - 1)]
    return [(0.0, 0.0), *((wide * math.cos(angle), high * math.sin(angle)) for angle in hexagon)]


_FULL_CIRCLE_RAD = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class BeamGrid:
    """Beams in vertical columns around a sensor, all channels at each azimuth.

    Attributes:
        world_from_lidar: (4, 4) pose of the sensor.
        azimuth_rad: (m,) float32 azimuth of every column, ascending.
        elevation_rad: (c,) float32 elevations of the beams of each column, ascending.
        max_offset_rad: Greatest deviation of a beam from its column's azimuth; inf for prisms,
            whose columns have no order.
    """

    world_from_lidar: Matrix
    azimuth_rad: FloatArray
    elevation_rad: FloatArray
    max_offset_rad: float

    @staticmethod
    def from_lidar(lidar: Lidar, world_from_lidar: Matrix) -> "BeamGrid":
        """Build the grid of a LiDAR's beams."""
        return BeamGrid(
            world_from_lidar,
            scan_azimuths_rad(lidar),
            channel_elevations_rad(lidar).astype(np.float32),
            max_offset_rad=math.inf
            if lidar.prisms
            else float(np.abs(channel_azimuth_offsets_rad(lidar)).max()),
        )

    def find_beams_towards(self, corners: Matrix) -> IndexArray:
        """Find the beams (n,) that may hit the convex hull of world points (c, 3), ascending.

        The result is conservative: some beams in it may miss.
        """
        own = transform_points(invert_pose(self.world_from_lidar), corners)
        bearing = math.atan2(*own.mean(axis=0)[1::-1])
        ahead = own[:, 0] * math.cos(bearing) + own[:, 1] * math.sin(bearing)
        near = float(ahead.min())
        # A hull around the sensor has no bearing.
        if near <= 0.0 or math.isinf(self.max_offset_rad):
            return np.arange(len(self.azimuth_rad) * len(self.elevation_rad))
        lateral = np.arctan2(own[:, 1] * math.cos(bearing) - own[:, 0] * math.sin(bearing), ahead)
        far = float(np.hypot(own[:, 0], own[:, 1]).max())
        low, high = float(own[:, 2].min()), float(own[:, 2].max())
        bottom = math.atan2(low, near if low < 0.0 else far) - self.max_offset_rad
        top = math.atan2(high, near if high > 0.0 else far) + self.max_offset_rad
        first = (bearing + float(lateral.min()) - self.max_offset_rad) % _FULL_CIRCLE_RAD
        span = float(np.ptp(lateral)) + 2.0 * self.max_offset_rad
        columns = np.flatnonzero((self.azimuth_rad - first) % _FULL_CIRCLE_RAD <= span)
        channels = np.flatnonzero((self.elevation_rad >= bottom) & (self.elevation_rad <= top))
        return (columns[:, None] * len(self.elevation_rad) + channels).ravel()
