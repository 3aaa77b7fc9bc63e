"""The point cloud of one scan, from surfaces, air and receiver."""

import math

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry.arrays import FloatArray
from advercity.sensors.lidar.beams import beam_directions, channel_efficiencies
from advercity.sensors.lidar.conditions import LidarConditions, LidarWindow
from advercity.sensors.lidar.random_streams import RandomStreams, StreamPurpose
from advercity.sensors.lidar.received_power import (
    range_standard_deviation_m,
    reflectivity_fraction,
)
from advercity.sensors.lidar.return_sources import ReturnSources, receiver_noise_factor
from advercity.sensors.lidar.returns import Returns, select_reported
from advercity.sensors.lidar.scan import ScanHits, scan_fractions
from advercity.sensors.measurements import PointCloud

SUN_BLINDING_ANGLE_RAD = math.radians(1.0)
"""Angle to the sun within which a beam is blind."""
_CARLA_ATTENUATION_PER_M = 0.004
"""Default `atmosphere_attenuation_rate` of CARLA's LiDAR; it defines the drop-off rule."""


def measure_point_cloud(
    lidar: Lidar,
    scan: ScanHits,
    air: LidarConditions,
    rng: np.random.Generator,
    *,
    states: tuple[ActorState, ...] = (),
    mount_yaw_deg: float = 0.0,
    window_key: tuple[int | str, ...] = (),
) -> PointCloud:
    """Measure the points of one scan by a sensor that its mount turns by a yaw.

    Surfaces, surfaces behind windows or mirrored in puddles, fog, dust, drops, flakes and the
    spray of `states` all return light. Overlapping returns of a beam merge. Among the returns above
    the receiver's threshold, the rig reports the strongest, the last or both. `window_key` is the
    random key of the drops on its window, the same in all frames.
    """
    streams = RandomStreams(rng)
    window = LidarWindow.from_lidar(
        lidar, scan.time, air.window_coverage, window_key, mount_yaw_deg
    )
    sources = ReturnSources(lidar, scan, air, streams, window, states)
    is_active = _find_active_beams(lidar, scan, air, streams, window)
    per_beam, others = _collect_returns(lidar, sources, is_active)
    found = select_reported(
        per_beam,
        others,
        lidar.azimuths * lidar.channels,
        lidar.echoes,
        sources.receiver.pulse_length_m,
    )
    return _build_point_cloud(sources, found)


def dropoff_survival_fraction(lidar: Lidar, range_m: FloatArray) -> FloatArray:
    """Compute the fraction (n,) of returns left by the rig's intensity drop-off.

    This is CARLA's rule on CARLA's intensity, exp(-0.004 R), which ignores target and weather.
    """
    intensity = np.exp(-_CARLA_ATTENUATION_PER_M * range_m)
    weakness = np.maximum(0.0, 1.0 - intensity / max(lidar.dropoff_intensity_limit, 1e-9))
    return 1.0 - lidar.dropoff_zero_intensity * weakness


def _find_active_beams(
    lidar: Lidar,
    scan: ScanHits,
    air: LidarConditions,
    streams: RandomStreams,
    window: LidarWindow | None,
) -> NDArray[np.bool_] | None:
    """Find the fired beams (n,), neither blocked nor blinded; None for all beams."""
    is_active: NDArray[np.bool_] | None = None
    if lidar.dropoff_rate:
        uniform = streams.uniform(StreamPurpose.FIRED, lidar.azimuths * lidar.channels)
        is_active = uniform >= lidar.dropoff_rate
    if window is not None:
        is_active = window.is_clear if is_active is None else is_active & window.is_clear
    if air.sun_direction is not None and lidar.sunlight_noise:
        sun = (scan.world_from_lidar[:3, :3].T @ air.sun_direction).astype(np.float32)
        off_sun = beam_directions(lidar, scan.time) @ sun < math.cos(SUN_BLINDING_ANGLE_RAD)
        is_active = off_sun if is_active is None else is_active & off_sun
    return is_active


def _collect_returns(
    lidar: Lidar, sources: ReturnSources, is_active: NDArray[np.bool_] | None
) -> tuple[list[Returns], list[Returns]]:
    """Collect the returns of active beams: sources with one return per beam, and all others.

    With sub-rays a surface has several returns per beam, so all sources count as others.
    """
    surfaces, soft = sources.surface_returns(), sources.soft_target_returns()
    others = list(sources.iterate_other_returns())
    per_beam = [surfaces] if soft is None else [surfaces, soft]
    if lidar.receiver.min_range_m:
        for item in (*per_beam, *others):
            item.power[:] *= item.range_m >= lidar.receiver.min_range_m
    if is_active is not None:
        surfaces.power[:] *= np.repeat(is_active, lidar.sub_rays)
        if soft is not None:
            soft.power[:] *= is_active
    stray = sources.stray_light_returns(surfaces)
    if stray is not None:
        others.append(stray)
    if is_active is not None:
        others = [item.select(is_active.take(item.beam)) for item in others]
    return (per_beam, others) if lidar.sub_rays == 1 else ([], [*per_beam, *others])


def _build_point_cloud(sources: ReturnSources, found: Returns) -> PointCloud:
    """Build the points of reported returns."""
    lidar, scan, streams = sources.lidar, sources.scan, sources.streams
    range_m = _measure_range_m(sources, found)
    is_kept = (range_m >= lidar.receiver.min_range_m) & (range_m <= lidar.range_m)
    if lidar.dropoff_zero_intensity:
        uniform = streams.uniform(StreamPurpose.DROPOFF, lidar.azimuths * lidar.channels)
        is_kept &= uniform.take(found.beam) < dropoff_survival_fraction(lidar, range_m)
    if not is_kept.all():
        found, range_m = found.select(is_kept), range_m[is_kept]
    azimuth = found.beam // np.int32(lidar.channels)
    ring = found.beam - azimuth * np.int32(lidar.channels)
    directions = beam_directions(lidar, scan.time)
    raw = (directions.take(found.beam, axis=0) * range_m[:, None]).astype(np.float32, copy=False)
    points, time_s = _compensate_motion(lidar, scan, raw, azimuth)
    return PointCloud(
        points=points,
        raw=raw,
        intensity=_measure_intensity(sources, found, ring),
        ring=ring.astype(np.uint16),
        time_s=time_s,
        range_m=range_m.astype(np.float32, copy=False),
        semantic=found.semantic,
        instance=found.instance,
        kind=found.kind,
    )


def _measure_intensity(
    sources: ReturnSources, found: Returns, ring: NDArray[np.int32]
) -> FloatArray:
    """Compute the reported intensity (n,), from 0 to 1."""
    lidar = sources.lidar
    power = found.power * np.float32(receiver_noise_factor(lidar, sources.air))
    efficiency = channel_efficiencies(lidar)
    if efficiency is not None:
        power /= efficiency.take(ring)
    reflectance = sources.receiver.apparent_reflectance(power, found.range_m)
    white_level = lidar.receiver.white_level
    if white_level is None:
        return np.minimum(reflectance, 1.0).astype(np.float32)
    return reflectivity_fraction(reflectance, white_level).astype(np.float32)


def _measure_range_m(sources: ReturnSources, found: Returns) -> FloatArray:
    lidar, step_m = sources.lidar, sources.lidar.receiver.range_step_m
    range_m = found.range_m
    # Adding zero noise would still cost a draw for every beam.
    if lidar.range_noise_model == "signal" or lidar.range_noise_m:
        count = lidar.azimuths * lidar.channels
        error = sources.streams.normal(StreamPurpose.RANGE_NOISE, count)
        deviation_m = (
            range_standard_deviation_m(lidar, found.power)
            if lidar.range_noise_model == "signal"
            else np.float32(lidar.range_noise_m)
        )
        range_m = range_m + error.take(found.beam) * deviation_m
    return np.rint(range_m / np.float32(step_m)) * np.float32(step_m) if step_m else range_m


def _compensate_motion(
    lidar: Lidar, scan: ScanHits, raw: FloatArray, azimuth: NDArray[np.int32]
) -> tuple[FloatArray, FloatArray]:
    """Transform points to the LiDAR frame at the frame's instant; also return their times."""
    if scan.now_from_then is None:
        return raw, np.zeros(len(raw), np.float32)
    motion = scan.now_from_then[azimuth]
    points = np.einsum("nij,nj->ni", motion[:, :3, :3], raw) + motion[:, :3, 3]
    time_s = (scan_fractions(lidar)[azimuth] - 1.0) * scan.time.period_s
    return points.astype(np.float32), time_s.astype(np.float32)
