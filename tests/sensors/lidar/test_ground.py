"""The ground that LiDARs see, against figures of real scans.

nuScenes: LIDAR_TOP of n015-2018-07-24-11-22-45, an HDL-32E 1.84 m above a dry road by day; medians
of points within 2.5 m of its axis. KITTI: sequence 00, scans 0 to 4, an HDL-64E. RADIATE: fog_6_0,
60 scans of an HDL-32E above a wet road.
"""

from typing import Any

import numpy as np
import pytest
from advercity_dsl import Lidar, LidarModel

from advercity.geometry.poses import pose_matrix
from advercity.materials import MATERIALS
from advercity.rendering.raycaster import MATERIAL_NAMES
from advercity.sensors.lidar import beam_directions, cast_scan
from advercity.sensors.lidar.received_power import compute_rough_lobe, effective_reflectance
from advercity.sensors.measurements import PointCloud
from tests.sensors.lidar.builders import ground, measure, panel, raycaster_of, vary
from tests.shipped import LIBRARY

MODELS = {
    name: vary(model.lidar, motion_distortion=False, sub_rays=1)
    for name, model in LIBRARY.get_declarations(LidarModel).items()
}
DAY = {"time": "day", "sun": {"elevation_deg": 60}}


def scan_ground(lidar: Lidar, height_m: float, **weather: Any) -> PointCloud:
    scan = cast_scan(lidar, pose_matrix((0, 0, height_m)), raycaster_of(ground("asphalt")))
    return measure(lidar, scan, **weather)


def level_at(cloud: PointCloud, distance_m: float) -> float:
    along = np.hypot(cloud.points[:, 0], cloud.points[:, 1])
    return float(np.median(cloud.intensity[np.abs(along - distance_m) < 0.2 * distance_m]) * 255)


def ring_fill(
    lidar: Lidar, cloud: PointCloud, height_m: float, nearest_m: float, last_m: float
) -> float:
    """Least fraction of beams that return, of the rings that meet the ground between distances."""
    down = -beam_directions(lidar)[: lidar.channels, 2]
    along = height_m * np.sqrt(1 - down**2) / np.where(down > 0, down, np.nan)
    rings = np.flatnonzero((along > nearest_m) & (along < last_m))
    assert len(rings) >= 3
    return min(float((cloud.ring == ring).mean() * len(cloud.ring)) for ring in rings) / (
        lidar.azimuths
    )


@pytest.mark.parametrize(("distance_m", "level"), [(5.0, 11.0), (7.0, 10.0), (10.0, 10.4)])
def test_a_dry_road_is_as_bright_as_in_real_scans(distance_m: float, level: float) -> None:
    cloud = scan_ground(MODELS["hdl_32e"], 1.84, **DAY)
    assert level_at(cloud, distance_m) == pytest.approx(level, rel=0.2)


@pytest.mark.parametrize(("name", "height_m"), [("hdl_32e", 1.84), ("hdl_64e", 1.73)])
def test_a_dry_road_fades_no_more_with_distance_than_in_real_scans(
    name: str, height_m: float
) -> None:
    """From 5 to 15 m by 0.8 in KITTI and 1.8 in nuScenes."""
    cloud = scan_ground(MODELS[name], height_m, **DAY)
    assert 0.8 < level_at(cloud, 5.0) / level_at(cloud, 15.0) < 2.0


@pytest.mark.parametrize(
    ("name", "height_m", "last_m"),
    [("hdl_32e", 1.84, 40), ("vls_128", 1.84, 60), ("hdl_64e", 1.73, 46), ("os1_128", 1.8, 30)],
)
def test_rings_on_a_dry_road_are_as_full_as_in_real_scans(
    name: str, height_m: float, last_m: float
) -> None:
    """From 5 to 40 m, 0.83 to 0.96 of the beams return in nuScenes, 0.94 up to 46 m in KITTI."""
    lidar = MODELS[name]
    assert ring_fill(lidar, scan_ground(lidar, height_m, **DAY), height_m, 5, last_m) > 0.83


def test_rings_of_an_hdl_64e_empty_beyond_the_road_of_kitti() -> None:
    """Rings at 54, 64 and 84 m; half of KITTI's points of the second are not of the road."""
    lidar = MODELS["hdl_64e"]
    cloud = scan_ground(lidar, 1.73, **DAY)
    along = np.hypot(cloud.points[:, 0], cloud.points[:, 1])
    near, middle, far = (
        ((first < along) & (along < last)).sum() / lidar.azimuths
        for first, last in ((52, 58), (60, 70), (80, 90))
    )
    assert near > 0.6
    assert 0.1 < middle < 0.6
    assert far < 0.05


def test_the_road_looks_alike_to_spinning_and_solid_state_sensors() -> None:
    spinning, rosette = (
        level_at(scan_ground(vary(MODELS[name], soft_gain=0), 1.8), 14.0) / white
        for name, white in (("vls_128", 110), ("mid_40", 150))
    )
    assert rosette == pytest.approx(spinning, rel=0.1)


def test_a_wet_road_returns_from_near_and_not_from_afar() -> None:
    """0.85 of the beams at 10 m, 0.74 at 14 m and 0.13 at 28 m return in RADIATE, of level 1."""
    lidar = MODELS["hdl_32e"]
    wet = scan_ground(lidar, 1.98, **DAY, surface={"wetness": 1.0})
    assert ring_fill(lidar, wet, 1.98, 4, 11) > 0.83
    assert np.hypot(*wet.points[:, :2].T).max() < 28
    assert level_at(wet, 10.0) == pytest.approx(1.0, abs=1.0)
    dry = scan_ground(lidar, 1.98, **DAY)
    assert level_at(wet, 10.0) < 0.25 * level_at(dry, 10.0)


@pytest.mark.parametrize(
    ("slope_deg", "lobe"),
    # B / A of Oren and Nayar, by hand.
    [(0.0, 0.0), (10.0, 0.1188), (30.0, 0.4382), (90.0, 0.7767)],
)
def test_rough_surfaces_return_what_oren_and_nayar_say(slope_deg: float, lobe: float) -> None:
    assert compute_rough_lobe(slope_deg) == pytest.approx(lobe, abs=1e-4)


@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.1])
@pytest.mark.parametrize("name", ["asphalt", "plaster", "cloth_grey"])
def test_only_rough_surfaces_return_more_than_lambert_says(name: str, cosine: float) -> None:
    hits = panel(10.0, Lidar(azimuths=16, channels=1), name)
    hits.cosine[:] = cosine
    material = MATERIALS[name]
    lobe = compute_rough_lobe(material.facet_slope_deg)
    expected = material.reflectance_905nm * (cosine + lobe * (1 - cosine**2))
    np.testing.assert_allclose(effective_reflectance(hits), expected, rtol=1e-5)
    assert (expected > 1.001 * material.reflectance_905nm * cosine) == (
        name != "cloth_grey" and cosine < 1
    )


def test_what_hits_nothing_returns_nothing() -> None:
    hits = panel(np.inf, Lidar(azimuths=16, channels=1), MATERIAL_NAMES[0])
    hits.cosine[:] = 0.0
    assert not effective_reflectance(hits).any()
    assert not effective_reflectance(hits, wetness=1.0).any()
