"""Returns from fog, dust, particles and spray."""

from typing import Any

import numpy as np
import pytest

from advercity.randomness import create_generator
from advercity.sensors.lidar import (
    cast_scan,
    measure_point_cloud,
)
from advercity.sensors.measurements import PointCloud, PointKind
from tests.sensors.lidar.builders import (
    DARK,
    EXACT,
    STAND,
    VACUUM,
    air,
    fraction_of,
    frame_with,
    measure,
    panel,
    raycaster_with,
    sky,
    vary,
)


@pytest.mark.parametrize(("mor_m", "limit_m"), [(50, 8.7), (75, 8.4), (150, 5.7)])
def test_fog_alone_returns_from_close_range(mor_m: float, limit_m: float) -> None:
    found = measure(EXACT, sky(), air={"mor_m": None}, fog={"mor_m": mor_m})
    assert fraction_of(found, PointKind.FOG) == 1.0
    assert found.range_m.max() == pytest.approx(limit_m, abs=0.2)
    assert found.range_m.min() < 0.6
    assert not found.semantic.any()


def test_light_fog_returns_nothing() -> None:
    found = measure(EXACT, sky(), air={"mor_m": None}, fog={"mor_m": 500})
    assert len(found.points) == 0


@pytest.mark.parametrize(("material", "limit_m"), [("sign", 19.2), ("concrete", 29.9)])
def test_fog_hides_distant_targets(material: str, limit_m: float) -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    reflected = 0.10 if material == "sign" else 0.50
    near, far = (panel(limit_m + step, EXACT, "wood") for step in (-1.0, 1.0))
    for hits in (near, far):
        hits.cosine[:] = reflected / 0.5
    assert fraction_of(measure(EXACT, near, **fog), PointKind.SURFACE) == 1.0
    assert fraction_of(measure(EXACT, far, **fog), PointKind.FOG) == 1.0


def test_the_last_return_is_behind_the_fog() -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    scan = panel(28.0, EXACT, "brick")
    strongest, last, dual = (
        measure(vary(EXACT, echoes=report), scan, **fog) for report in ("strongest", "last", "dual")
    )
    assert set(strongest.kind) == {PointKind.FOG}
    assert set(last.kind) == {PointKind.SURFACE}
    assert len(dual.points) == 240_000
    np.testing.assert_array_equal(dual.ring[::2], dual.ring[1::2])
    assert (dual.range_m[::2] < dual.range_m[1::2]).all()


def test_points_of_fog_with_dust_are_of_both_by_their_backscatter() -> None:
    """Of dust twice as thick as fog: (2 x 0.95 / 50) / (2 x 0.95 / 50 + 1 / 18.8) = 0.417."""
    found = measure(DARK, sky(), air={"mor_m": None}, fog={"mor_m": 60}, dust={"mor_m": 30})
    assert set(found.kind) == {PointKind.FOG, PointKind.DUST}
    assert (found.kind == PointKind.DUST).mean() == pytest.approx(0.417, abs=0.03)


def test_dust_has_its_own_kind() -> None:
    found = measure(DARK, sky(), air={"mor_m": None}, dust={"mor_m": 30})
    assert set(found.kind) == {PointKind.DUST}
    assert len(found.points) > 50_000


@pytest.mark.parametrize(
    ("weather", "kind", "share", "median_m"),
    [
        ({"rain": {"rate_mm_h": 50}}, PointKind.RAIN, 0.024, 1.7),
        ({"rain": {"rate_mm_h": 10}}, PointKind.RAIN, 0.0028, 1.4),
        ({"snow": {"rate_mm_h": 1}, "temperature_c": -3}, PointKind.SNOW, 0.32, 4.1),
        ({"snow": {"rate_mm_h": 2.5}, "temperature_c": -3}, PointKind.SNOW, 0.50, 5.6),
    ],
)
def test_particles_return_from_the_sky(
    weather: dict[str, Any], kind: PointKind, share: float, median_m: float
) -> None:
    found = measure(EXACT, sky(), air={"mor_m": None}, **weather)
    assert set(found.kind) == {kind}
    assert fraction_of(found, kind) == pytest.approx(share, rel=0.10)
    assert np.median(found.range_m) == pytest.approx(median_m, rel=0.10)


def test_flakes_are_hit_as_often_as_their_number_says() -> None:
    """Per beam and metre, in snow of 1 mm/h: every flake that passes the threshold."""
    snowy = air(**VACUUM, snow={"rate_mm_h": 1}, temperature_c=-3)
    (table,) = snowy.tabulate_air(EXACT).particles
    _, range_m, power = table.sample(1_000_000, create_generator("test"))
    detected = range_m[power >= 1.0]
    at = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
    rates = [(np.abs(detected - middle) < 0.1).sum() / 1_000_000 / 0.2 for middle in at]
    np.testing.assert_allclose(rates, [0.050, 0.054, 0.054, 0.045, 0.029, 0.010], rtol=0.03)


def test_no_drop_is_detected_behind_a_wall() -> None:
    found = measure(DARK, panel(3.0), rain={"rate_mm_h": 100})
    assert set(found.kind) <= {PointKind.SURFACE, PointKind.RAIN}
    assert found.range_m.max() <= 3.0 + 1e-4


def measure_near_spray(speed_m_s: float, **lidar: float) -> PointCloud:
    """Measure a car 9 m ahead on a wet road."""
    exact = vary(EXACT, **lidar)
    scan = cast_scan(exact, STAND, raycaster_with((9.0, 0.0)))
    states = frame_with((9.0, 0.0), speed_m_s=speed_m_s).states
    wet = air(surface={"wetness": 1, "film_mm": 0.8})
    return measure_point_cloud(exact, scan, wet, create_generator("test"), states=states)


def test_only_fast_vehicles_have_spray() -> None:
    slow, fast = (measure_near_spray(speed_m_s, soft_gain=20) for speed_m_s in (5.0, 25.0))
    spray = fast.kind == PointKind.SPRAY
    assert not (slow.kind == PointKind.SPRAY).any()
    assert spray.sum() > 10
    assert (fast.points[spray, 0] < 8.6).all()
    assert (np.abs(fast.points[spray, 1]) < 2.01).all()


@pytest.mark.parametrize("sub_rays", [1, 7])
def test_spray_dims_what_is_behind_it(sub_rays: int) -> None:
    found = [
        measure_near_spray(speed_m_s, soft_gain=0, sub_rays=sub_rays) for speed_m_s in (5.0, 25.0)
    ]
    low = [(cloud.instance == 1) & (cloud.points[:, 2] < -0.9) for cloud in found]
    behind = [cloud.intensity[rows].mean() for cloud, rows in zip(found, low, strict=True)]
    assert 0 < behind[1] < 0.9 * behind[0]
