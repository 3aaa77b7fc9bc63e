"""Forward scattering against a simulation of rays and its limits."""

import math

import numpy as np
import pytest

from advercity.physics.extinction import extinction_from_mor
from advercity.sensors.lidar.forward_scattering import DIFFRACTED_FRACTION, Diffraction
from tests.sensors.lidar.builders import EXACT, air, measure, panel, vary

FOG = Diffraction(extinction_from_mor(50.0), 16e-6)


def simulate_kept(field_of_view_rad: float, range_m: float) -> tuple[float, float]:
    """Power that small-angle scattering adds on one way, and the mean detour of that power.

    Rays are scattered any number of times by the diffraction lobe; those that end within the field
    of view of the point aimed at count. Powers are relative to the light that is never scattered.
    """
    rng, rays = np.random.default_rng(1), 400_000
    rate = DIFFRACTED_FRACTION * FOG.extinction_per_m
    count = rng.poisson(rate * range_m, rays)
    position, slope = np.zeros((2, rays)), np.zeros((2, rays))
    at, detour = np.zeros(rays), np.zeros(rays)
    # Places of the scatterings of each ray, in order.
    steps = rng.random((rays, count.max())) * range_m
    steps[np.arange(count.max()) >= count[:, None]] = range_m
    for step in [*np.sort(steps, axis=1).T, np.full(rays, range_m)]:
        length = step - at
        position += slope * length
        detour += (slope**2).sum(axis=0) * length / 2.0
        turned = rng.normal(scale=FOG.lobe_rad / math.sqrt(2), size=(2, rays))
        slope += turned * (step < range_m)
        at = step
    seen = np.hypot(*position) < field_of_view_rad / 2.0 * range_m
    scattered = seen & (count > 0)
    return float(seen.mean() / (count == 0).mean()), float(detour[scattered].sum() / seen.sum())


@pytest.mark.parametrize("view_rad", [0.003, 0.02, 0.1])
def test_a_field_of_view_keeps_as_much_light_as_a_simulation(view_rad: float) -> None:
    kept, _ = simulate_kept(view_rad, 20.0)
    expected = math.exp(20.0 * FOG.kept_extinction_per_m(view_rad))
    assert expected == pytest.approx(kept, rel=0.02)


@pytest.mark.parametrize("view_rad", [0.02, 0.1])
def test_scattered_light_is_as_late_as_in_a_simulation(view_rad: float) -> None:
    _, detour_m = simulate_kept(view_rad, 20.0)
    # One way each: the range is half of the path.
    assert FOG.delay_per_m(view_rad) * 400.0 == pytest.approx(detour_m, rel=0.35)


def test_without_a_field_of_view_nothing_is_kept_and_with_an_open_one_half() -> None:
    assert FOG.kept_extinction_per_m(0.0) == FOG.delay_per_m(0.0) == 0.0
    half = FOG.extinction_per_m / 2.0
    assert FOG.kept_extinction_per_m(3.0) == pytest.approx(half, rel=1e-6)


def test_a_narrow_receiver_gains_little_in_fog_and_half_in_rain() -> None:
    """Droplets of 16 um diffract into 36 mrad, drops of a millimetre into less than 1 mrad."""
    assert FOG.lobe_rad == pytest.approx(0.036, rel=0.01)
    assert FOG.kept_extinction_per_m(0.003) / FOG.extinction_per_m < 0.04
    drop = Diffraction(4e-3, 1.5e-3)
    assert drop.kept_extinction_per_m(0.003) / drop.extinction_per_m > 0.45


def test_an_open_receiver_measures_targets_in_fog_too_far_and_brighter() -> None:
    open_view = vary(EXACT, soft_gain=0, receiver={"field_of_view_mrad": 200})
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 60, "droplet_um": 16}}
    narrow, wide = (
        measure(lidar, panel(25.0), **fog) for lidar in (vary(EXACT, soft_gain=0), open_view)
    )
    assert np.ptp(narrow.range_m) == 0.0
    excess_m = float(wide.range_m[0]) - 25.0
    particles = Diffraction(air(**fog).extinction["fog"].at_905nm, 16e-6)
    assert excess_m == pytest.approx(particles.delay_per_m(0.2) * 625, rel=0.01)
    assert 0.001 < excess_m < 0.02
    assert wide.intensity.mean() > 1.5 * narrow.intensity.mean()
