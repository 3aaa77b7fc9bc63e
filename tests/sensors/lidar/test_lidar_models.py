"""The LiDAR models that ship, against the figures that their makers publish."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Lidar, LidarModel, Rig

from advercity.geometry.mesh import Mesh
from advercity.physics.extinction import extinction_from_mor
from advercity.sensors.lidar import ScanTime, beam_directions, cast_scan
from advercity.sensors.lidar.received_power import (
    BRIGHTEST_REFLECTANCE,
    Receiver,
    daylight_noise_factor,
    detection_margin_sigma,
    reflectivity_fraction,
)
from advercity.sensors.measurements import PointCloud, PointKind
from tests.sensors.lidar.builders import (
    EXACT,
    STAND,
    WALL_AHEAD,
    air,
    measure,
    misses,
    panel,
    raycaster_of,
    raycaster_with,
    sky,
    upright,
    vary,
)
from tests.shipped import LIBRARY

MODELS = {name: model.lidar for name, model in LIBRARY.get_declarations(LidarModel).items()}
FEW = {"motion_distortion": False, "sub_rays": 1}
"""Of a model, what tests with one ray a beam and no motion need."""


def ideal(name: str, **receiver: float | None) -> Lidar:
    """A model without noise, with some other figures of its receiver."""
    lidar = MODELS[name]
    figures = lidar.receiver.model_dump() | receiver
    plain = {"range_noise_m": 0, "range_noise_model": "fixed", "detection": "step"}
    return vary(lidar, **FEW, **plain, sunlight_noise=False, receiver=figures)


def detected_fraction(
    lidar: Lidar, range_m: float, *, lux: float, extinction_per_m: float
) -> float:
    """Fraction of beams onto a target of 10 % that return, in an air and daylight."""
    receiver, clear = Receiver.from_lidar(lidar), extinction_per_m
    power = receiver.received_power(np.array([range_m], float), np.array([0.1]), clear)
    margin = detection_margin_sigma(power / daylight_noise_factor(lux))[0]
    return 0.5 * math.erfc(-margin / math.sqrt(2))


@pytest.mark.parametrize(
    ("name", "range_m", "probability", "lux"),
    [
        ("hdl_64e", 59, 0.9, 100_000),
        ("vls_128", 220, 0.5, 0),
        ("os1_64", 40, 0.9, 100_000),
        ("mid_40", 90, 0.5, 0),
    ],
)
def test_a_target_of_ten_per_cent_is_detected_as_far_as_published(
    name: str, range_m: float, probability: float, lux: float
) -> None:
    clear = extinction_from_mor(20_000)
    found = detected_fraction(MODELS[name], range_m, lux=lux, extinction_per_m=clear)
    assert found == pytest.approx(probability, abs=1e-6)
    lidar = vary(MODELS[name], **FEW, sunlight_noise=False)
    hits = panel(range_m, lidar, "wood")
    hits.cosine[:] = 0.1 / 0.5
    # Of all beams of a scan in the dark.
    points = len(measure(lidar, hits).points)
    expected = detected_fraction(lidar, range_m, lux=0, extinction_per_m=air().extinction_per_m)
    assert points / len(hits.range_m) == pytest.approx(expected, abs=0.015)


@pytest.mark.parametrize(
    ("name", "points_per_s"),
    [
        ("hdl_32e", 0.694e6),
        ("hdl_64e", 1.33e6),
        ("vls_128", 2_401_497.6),
        ("os1_64", 1_310_720),
        ("os1_128", 2_621_440),
        ("mid_40", 100_000),
    ],
)
def test_models_fire_as_often_as_published(name: str, points_per_s: float) -> None:
    lidar = MODELS[name]
    assert 10 * lidar.azimuths * lidar.channels == pytest.approx(points_per_s, rel=3e-3)


@pytest.mark.parametrize(
    ("name", "lowest_deg", "highest_deg"),
    [("vls_128", -25, 15), ("os1_128", -22.5, 22.5), ("hdl_64e", -23.95, 2.81)],
)
def test_channels_span_the_published_field_of_view(
    name: str, lowest_deg: float, highest_deg: float
) -> None:
    up = np.degrees(np.arcsin(beam_directions(MODELS[name])[: MODELS[name].channels, 2]))
    assert (np.diff(up) >= 0).all()
    assert (up[0], up[-1]) == pytest.approx((lowest_deg, highest_deg), abs=1e-3)


def test_the_128_channels_fire_at_eight_azimuths_a_ninth_of_a_degree_apart() -> None:
    lidar = MODELS["vls_128"]
    first = beam_directions(lidar)[:128].astype(float)
    azimuths = np.round(np.degrees(np.arctan2(first[:, 1], first[:, 0])), 3)
    assert sorted(set(azimuths)) == [-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354]
    up = np.degrees(np.arcsin(first[:, 2]))
    assert np.diff(up)[np.abs(up[1:]) < 2].max() == pytest.approx(0.11, abs=0.005)


def test_prisms_draw_the_sum_of_two_turning_vectors() -> None:
    lidar = MODELS["mid_40"]
    found = beam_directions(lidar, ScanTime(3)).astype(float)
    time_s = 0.3 + np.arange(10_000) * 1e-5
    turns = [2 * math.pi * rpm / 60 * time_s for rpm in (7294, -4664)]
    offset = sum(math.radians(9.6) * np.exp(1j * turn) for turn in turns)
    off_axis = np.arcsin(np.hypot(found[:, 1], found[:, 2]))
    np.testing.assert_allclose(off_axis, np.abs(offset), atol=1e-6)
    bearing = np.angle((found[:, 1] + 1j * found[:, 2]) * np.conj(offset))
    assert np.abs(bearing[off_axis > 0.01]).max() < 1e-3
    assert np.degrees(2 * off_axis.max()) == pytest.approx(38.4, abs=0.05)


def test_prisms_fill_their_disc_from_scan_to_scan() -> None:
    lidar = MODELS["mid_40"]
    cells = [
        {*map(tuple, np.round(beam_directions(lidar, ScanTime(scan))[:, 1:] / 0.005).astype(int))}
        for scan in range(4)
    ]
    covered = [len(set().union(*cells[: count + 1])) for count in range(4)]
    assert all(more > 1.1 * fewer for fewer, more in pairwise(covered[:3]))
    np.testing.assert_array_equal(
        beam_directions(MODELS["os1_64"]), beam_directions(MODELS["os1_64"], ScanTime(3))
    )


def test_prisms_are_cast_at_their_times() -> None:
    lidar = vary(ideal("mid_40"), motion_distortion=True)
    caster = raycaster_with(walls=[WALL_AHEAD])
    seen = cast_scan(lidar, STAND, caster, time=ScanTime(2))
    found = measure(lidar, seen, air={"mor_m": None})
    assert found.time_s[0] == pytest.approx(-0.1, abs=1e-4)
    assert (np.diff(found.time_s) >= 0).all()
    on_wall = found.points[:, 2] > -1.8
    assert on_wall.sum() > 5_000
    np.testing.assert_allclose(found.points[on_wall, 0], 20.0, atol=0.02)


@pytest.mark.parametrize(
    ("white_level", "reflectance", "level"),
    [
        (110, 0.0, 0),
        (110, 0.5, 55),
        (110, 1.0, 110),
        (110, 1.2, 114),
        (110, BRIGHTEST_REFLECTANCE, 255),
        (110, 1e5, 255),
        (150, 0.8, 120),
        (100, 300.0, 228),
    ],
)
def test_reflectivity_has_a_band_for_retroreflectors(
    white_level: int, reflectance: float, level: int
) -> None:
    found = reflectivity_fraction(np.array([reflectance], np.float32), white_level)
    assert found[0] * 255 == pytest.approx(level, abs=1e-3)


def test_reported_reflectivity_is_that_of_the_target_at_any_range() -> None:
    lidar = ideal("vls_128")
    for range_m in (5.0, 30.0, 150.0):
        found = measure(lidar, panel(range_m, lidar, "plaster"), air={"mor_m": None})
        assert set(np.rint(found.intensity * 255)) == {66}  # 110 levels times 60 %
    signs = vary(ideal("vls_128", stray_light_db=None), azimuths=100)
    sign = measure(signs, panel(30.0, signs, "sign_red"), air={"mor_m": None})
    assert (sign.intensity * 255 > 111).all()


def test_weak_channels_see_less_far_and_report_the_same_reflectivity() -> None:
    efficiency = [1.0, 0.25]
    lidar = vary(EXACT, channels=2, lower_deg=-1, upper_deg=1, channel_efficiency=efficiency)
    found = measure(lidar, panel(100.0, lidar), air={"mor_m": None})
    assert set(found.ring) == {0}
    near = measure(lidar, panel(20.0, lidar), air={"mor_m": None})
    assert np.ptp(near.intensity) < 1e-6
    assert set(near.ring) == {0, 1}


def test_ranges_have_the_published_step() -> None:
    lidar = vary(MODELS["hdl_64e"], **FEW)
    steps = measure(lidar, panel(20.0, lidar)).range_m / np.float32(0.002)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-2)


def test_ranges_scatter_as_published_where_the_signal_is_strong() -> None:
    lidar = vary(MODELS["mid_40"], **FEW)
    found = measure(lidar, panel(20.0, lidar, "plaster"))
    assert found.range_m.std() == pytest.approx(0.02, rel=0.05)
    assert found.range_m.mean() == pytest.approx(20.0, abs=0.002)


def test_a_beam_over_an_edge_reports_both_surfaces_or_a_mixed_point() -> None:
    far, near = upright(20.0, 40.0, 20.0), upright(15.0, 0.5, 20.0)
    close = upright(19.7, 0.5, 20.0)
    lidar = vary(ideal("hdl_64e"), sub_rays=7, echoes="dual")
    one_ray = vary(lidar, sub_rays=1)

    def ranges_at_edge(lidar: Lidar, front: Mesh) -> PointCloud:
        caster = raycaster_of(far, front)
        return measure(lidar, cast_scan(lidar, STAND, caster), air={"mor_m": None})

    both = ranges_at_edge(lidar, near)
    assert len(both.points) > len(ranges_at_edge(one_ray, near).points) + 20
    mixed = ranges_at_edge(lidar, close).points[:, 0]
    between = (mixed > 19.72) & (mixed < 19.98)
    assert between.sum() > 20
    single = ranges_at_edge(one_ray, close).points[:, 0]
    assert not ((single > 19.72) & (single < 19.98)).any()


def sign_ahead(lidar: Lidar, material: str) -> PointCloud:
    caster = raycaster_of(upright(30.0, 0.6, 4.0, material))
    return measure(lidar, cast_scan(lidar, STAND, caster), air={"mor_m": None})


def test_signs_bloom_and_walls_do_not() -> None:
    lidar = ideal("vls_128")
    sign, wall = (sign_ahead(lidar, material) for material in ("sign_red", "plaster_white"))
    halo = sign.kind == PointKind.STRAY
    assert set(wall.kind) == {PointKind.SURFACE}
    assert (~halo).sum() == len(wall.points)
    assert halo.sum() > 20
    np.testing.assert_allclose(sign.range_m[halo], 30.0, atol=0.1)
    assert set(sign.instance[halo]) == {0}
    clean = sign_ahead(ideal("vls_128", stray_light_db=None), "sign_red")
    assert set(clean.kind) == {PointKind.SURFACE}


def test_a_halo_ends_where_stray_light_falls_below_the_threshold() -> None:
    """One beam on a sign: its light falls with the square of the angle."""
    lidar = ideal("vls_128", stray_light_db=-50)
    hits, beam = misses(lidar.azimuths * lidar.channels), 1000 * 128 + 64
    bright = panel(60.0, lidar, "sign_red")
    for name in ("range_m", "normal", "cosine", "material", "semantic"):
        getattr(hits, name)[beam] = getattr(bright, name)[beam]
    found = measure(lidar, hits, air={"mor_m": None})
    power = Receiver.from_lidar(lidar).received_power(np.array([60.0]), np.array([300.9]), 0.0)[0]
    limit_deg = math.sqrt(power * 1e-5)
    directions = beam_directions(lidar)
    chord = np.linalg.norm(directions - directions[beam], axis=1)
    assert len(found.points) == (np.degrees(chord) < limit_deg).sum()
    assert len(found.points) > 15


def test_returns_from_too_near_are_discarded() -> None:
    lidar = ideal("vls_128")
    assert not len(measure(lidar, panel(0.9, lidar)).points)
    assert len(measure(lidar, panel(1.1, lidar)).points) == lidar.azimuths * 128


@pytest.mark.parametrize("wall_m", [1.0, 60.0])
@pytest.mark.parametrize("weather", [{}, {"fog": {"mor_m": 30}}])
def test_no_reported_range_is_outside_the_limits(wall_m: float, weather: dict[str, Any]) -> None:
    """Noise moves returns from either end over it, and they are not reported."""
    lidar = vary(MODELS["os1_64"], **FEW, range_m=60, soft_gain=1)
    limits = lidar.receiver.model_dump() | {"min_range_m": 1.0}
    found = measure(vary(lidar, receiver=limits), panel(wall_m, lidar, "plaster"), **weather)
    assert found.range_m.min(initial=1.0) >= 1.0
    assert found.range_m.max(initial=60.0) <= 60.0
    if not weather:
        # Half of them are on either side.
        returned = len(found.points) / (lidar.azimuths * lidar.channels)
        assert 0.3 < returned < 0.7


def test_a_longer_near_field_keeps_the_range_and_suppresses_fog() -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 63}}
    long = vary(EXACT, receiver={"near_field_m": 30})
    clear = extinction_from_mor(20_000)
    ranges_m = [Receiver.from_lidar(lidar).detection_range_m(0.1, clear) for lidar in (EXACT, long)]
    assert ranges_m == pytest.approx([80.0, 80.0], abs=0.1)
    assert len(measure(EXACT, sky(), **fog).points) == 120_000
    assert len(measure(long, sky(), **fog).points) == 0
    dark = panel(3.0, long, "rubber")
    assert len(measure(long, dark, **fog).points) == 120_000


RIGS = LIBRARY.get_declarations(Rig)


@pytest.mark.parametrize("name", ["nuscenes_like", "robotaxi", "roadside"])
def test_fog_only_takes_points_from_rigs_of_real_sensors(name: str) -> None:
    """Walls all around: fog hides them, and its own points do not make up for that."""
    sensors = RIGS[name].vehicle or RIGS[name].roadside_unit
    assert sensors is not None
    lidar = vary(sensors.lidars[0], motion_distortion=False)
    caster = raycaster_with((10.0, 0.0), walls=[WALL_AHEAD])
    scan = cast_scan(lidar, STAND, caster)
    clear, thin, dense = (measure(lidar, scan, fog={"mor_m": mor}) for mor in (990, 120, 60))
    assert len(clear.points) > len(thin.points) > len(dense.points)
    air_fractions = [(cloud.kind == PointKind.FOG).mean() for cloud in (clear, thin, dense)]
    assert max(air_fractions) < 0.02


def test_the_original_rig_stays_ideal() -> None:
    vehicle = RIGS["adver_city"].vehicle
    assert vehicle is not None
    lidar = vehicle.lidars[0]
    assert (lidar.model, lidar.sub_rays, lidar.range_noise_m) == (None, 1, 0)
    assert lidar.beam == Lidar().beam
    assert lidar.receiver == Lidar().receiver
