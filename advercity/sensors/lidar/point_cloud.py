"""The points that come out of one turn of a LiDAR in the weather."""

import math

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry.arrays import FloatArray
from advercity.sensors.lidar.beams import beam_directions
from advercity.sensors.lidar.conditions import NUM_WINDOW_SECTORS, LidarConditions, LidarWindow
from advercity.sensors.lidar.random_streams import RandomStreams, StreamPurpose
from advercity.sensors.lidar.received_power import apparent_reflectance, range_standard_deviation_m
from advercity.sensors.lidar.return_sources import ReturnSources, receiver_noise_factor
from advercity.sensors.lidar.returns import Returns, select_reported
from advercity.sensors.lidar.scan import ScanHits, scan_fractions
from advercity.sensors.measurements import PointCloud

SCAN_PERIOD_S = 0.1
SUN_BLINDING_ANGLE_RAD = math.radians(1.0)
_CARLA_ATTENUATION_PER_M = 0.004


def measure_point_cloud(
    lidar: Lidar,
    scan: ScanHits,
    air: LidarConditions,
    rng: np.random.Generator,
    *,
    states: tuple[ActorState, ...] = (),
) -> PointCloud:
    """What a LiDAR reports of one turn's `scan` in this air.

    Surfaces, what is behind windows or mirrored in puddles, fog, dust, drops, flakes and spray
    all send light back. Echoes of a beam that overlap are one; those that pass the receiver's
    threshold are candidates, of which the rig has the strongest, the last or both reported.

    Args:
        lidar: The sensor.
        scan: What its rays met.
        air: The weather.
        rng: Of this sensor and frame.
        states: Who may throw up spray.
    """
    draws = RandomStreams(rng)
    window = LidarWindow.from_lidar(lidar, air.window_coverage)
    sources = ReturnSources(lidar, scan, air, draws, window=window, states=states)
    fired = _find_active_beams(lidar, scan, air, draws, window)
    rivals, others = _collect_returns(lidar, sources, fired)
    found = select_reported(rivals, others, lidar.azimuths * lidar.channels, lidar.echoes)
    return _build_point_cloud(lidar, scan, air, draws, found)


def dropoff_survival_fraction(lidar: Lidar, range_m: FloatArray) -> FloatArray:
    """Share (n,) of echoes that the rig's intensity drop-off spares.

    CARLA's rule, on the intensity that CARLA knows: exp(-0.004 R), without target or weather.
    """
    intensity = np.exp(-_CARLA_ATTENUATION_PER_M * range_m)
    weakness = np.maximum(0.0, 1.0 - intensity / max(lidar.dropoff_intensity_limit, 1e-9))
    return 1.0 - lidar.dropoff_zero_intensity * weakness


def _find_active_beams(
    lidar: Lidar,
    scan: ScanHits,
    air: LidarConditions,
    draws: RandomStreams,
    window: LidarWindow | None,
) -> NDArray[np.bool_] | None:
    """Beams (n,) that leave the sensor and are not blinded; None if all do."""
    fired: NDArray[np.bool_] | None = None
    if lidar.dropoff_rate:
        uniform = draws.uniform(StreamPurpose.FIRED, lidar.azimuths * lidar.channels)
        fired = uniform >= lidar.dropoff_rate
    if window is not None:
        clear = window.find_clear_beams(
            draws.open_stream(StreamPurpose.WINDOW).random(NUM_WINDOW_SECTORS, np.float32)
        )
        fired = clear if fired is None else fired & clear
    if air.sun_direction is not None and lidar.sunlight_noise:
        sun = (scan.world_from_lidar[:3, :3].T @ air.sun_direction).astype(np.float32)
        aside = beam_directions(lidar) @ sun < math.cos(SUN_BLINDING_ANGLE_RAD)
        fired = aside if fired is None else fired & aside
    return fired


def _collect_returns(
    lidar: Lidar, sources: ReturnSources, fired: NDArray[np.bool_] | None
) -> tuple[list[Returns], list[Returns]]:
    """Echoes of beams that were fired: of sources with one for every beam, and of the others."""
    surfaces, soft, others = (
        sources.surface_returns(),
        sources.soft_target_returns(),
        list(sources.iterate_other_returns()),
    )
    every = [surfaces] if soft is None else [surfaces, soft]
    if fired is not None:
        surfaces.power[:] *= np.repeat(fired, lidar.sub_rays)
        if soft is not None:
            soft.power[:] *= fired
        others = [echoes.select(fired.take(echoes.beam)) for echoes in others]
    return (every, others) if lidar.sub_rays == 1 else ([], [*every, *others])


def _build_point_cloud(
    lidar: Lidar, scan: ScanHits, air: LidarConditions, draws: RandomStreams, found: Returns
) -> PointCloud:
    """The points of reported echoes."""
    range_m = _measured_range_m(lidar, draws, found)
    if lidar.dropoff_zero_intensity:
        uniform = draws.uniform(StreamPurpose.DROPOFF, lidar.azimuths * lidar.channels)
        kept = np.flatnonzero(uniform.take(found.beam) < dropoff_survival_fraction(lidar, range_m))
        found, range_m = found.select(kept), range_m[kept]
    azimuth = found.beam // np.int32(lidar.channels)
    raw = (beam_directions(lidar).take(found.beam, axis=0) * range_m[:, None]).astype(
        np.float32, copy=False
    )
    intensity = apparent_reflectance(
        found.power * np.float32(receiver_noise_factor(lidar, air)), found.range_m
    )
    points, time_s = _compensate_motion(lidar, scan, raw, azimuth)
    return PointCloud(
        points=points,
        raw=raw,
        intensity=np.minimum(intensity, 1.0).astype(np.float32),
        ring=(found.beam - azimuth * np.int32(lidar.channels)).astype(np.uint16),
        time_s=time_s,
        range_m=range_m.astype(np.float32, copy=False),
        semantic=found.semantic,
        instance=found.instance,
        kind=found.kind,
    )


def _measured_range_m(lidar: Lidar, draws: RandomStreams, found: Returns) -> FloatArray:
    if lidar.range_noise_model == "fixed" and not lidar.range_noise_m:
        return found.range_m
    error = draws.normal(StreamPurpose.RANGE_NOISE, lidar.azimuths * lidar.channels)
    deviation_m = np.float32(lidar.range_noise_m)
    if lidar.range_noise_model == "signal":
        return found.range_m + error.take(found.beam) * range_standard_deviation_m(
            found.power, lidar.range_noise_m
        )
    return found.range_m + error.take(found.beam) * deviation_m


def _compensate_motion(
    lidar: Lidar, scan: ScanHits, raw: FloatArray, azimuth: NDArray[np.int32]
) -> tuple[FloatArray, FloatArray]:
    """Points in the frame of the frame's instant, and when each was measured."""
    if scan.now_from_then is None:
        return raw, np.zeros(len(raw), np.float32)
    motion = scan.now_from_then[azimuth]
    points = np.einsum("nij,nj->ni", motion[:, :3, :3], raw) + motion[:, :3, 3]
    time_s = (scan_fractions(lidar)[azimuth] - 1.0) * SCAN_PERIOD_S
    return points.astype(np.float32), time_s.astype(np.float32)
