"""Single scattering by droplets, and where every verification case of weather physics is tested.

| case | subject | tests |
| --- | --- | --- |
| 1, 2 | contrast and airlight of cards in fog, rendered | `test_weather_cases.py` of the backend |
| 3, 4 | 5 % remain at the optical range; components add | `test_extinction.py` |
| 5 | furnace: white objects in white fog, rendered | `test_weather_cases.py` of the backend |
| 6 | illuminance by the fog dome | `test_fog_transfer.py` |
| 7 | equiangular quadrature against a brute-force march | here |
| 8 | fog that thins with height | none: fog is homogeneous |
| 9 | phase functions | here |
| 10 | halo of a lamp in fog | here; rendered in `test_lamps.py` of the backend |
| 11 | extinction of rain | `test_extinction.py` |
| 12, 13, 14 | numbers, speed, streaks and slant of drops | `test_camera_falling_particles.py` |
| 15, 16 | water films and Fresnel | `test_water.py` |
| 17, 18 | illuminance by skies; a white card under one | `test_sky.py`, `test_atmosphere.py` |
| 19, 20, 21 | automatic exposure, saturation, photon transfer | `test_camera_electronics.py` |
| 22, 23 | stray light keeps energy; veil of the sun | `test_camera_optics.py` |
| 24 to 34 | LiDAR | `tests/sensors/lidar` |
| 35 to 38 | positioning and motion | `test_gnss.py`, `test_imu.py`, `test_geodesy.py` |
| 39 | snow lies on level surfaces | `lidar/test_point_cloud.py` |
| 40 | order of the presets | `test_weather_cases.py` of the backend, `test_point_cloud.py` |
"""

import math
from functools import partial

import numpy as np
import pytest

from advercity.geometry.arrays import FloatArray
from advercity.physics.extinction import extinction_from_mor
from advercity.physics.scattering import PhaseFunction, PhaseLobes, henyey_greenstein

MOR_75 = extinction_from_mor(75.0)
NODE, WEIGHT = np.polynomial.legendre.leggauss(300)


def lamp_airlight(
    intensity_cd: float,
    *,
    closest_approach_m: float,
    closest_along_ray_m: float,
    distance_m: float,
    extinction: float,
    phase: PhaseFunction,
) -> float:
    """Luminance in cd/m² of air along a ray that a lamp lights, scattered once.

    Steps are equal in the angle at the lamp (equiangular, Kulla and Fajardo 2012), as in the
    renderer's shaders.
    """
    first = math.atan(-closest_along_ray_m / closest_approach_m)
    last = math.atan((distance_m - closest_along_ray_m) / closest_approach_m)
    node, weight = np.polynomial.legendre.leggauss(64)
    angle = (first + last + (last - first) * node) / 2.0
    along_m = closest_along_ray_m + closest_approach_m * np.tan(angle)
    transmittance = np.exp(-extinction * (along_m + closest_approach_m / np.cos(angle)))
    # The measure of the angle cancels the square of the distance from the lamp.
    integral = float(np.sum(weight * phase(-np.sin(angle)) * transmittance)) * (last - first) / 2.0
    return intensity_cd * extinction * integral / closest_approach_m


def isotropic_phase(cosine: FloatArray) -> FloatArray:
    return np.full_like(cosine, 1.0 / (4.0 * math.pi))


def droplet_phase(cosine: FloatArray, diameter_um: float = 12.0) -> FloatArray:
    lobes = PhaseLobes.from_diameter_um(diameter_um)
    narrow = henyey_greenstein(cosine, lobes.narrow_g)
    return lobes.narrow_fraction * narrow + lobes.wide_fraction * lobes.wide_phase(cosine)


def test_equiangular_steps_find_what_a_brute_force_march_finds() -> None:
    found = lamp_airlight(
        1000.0,
        closest_approach_m=2.0,
        closest_along_ray_m=10.0,
        distance_m=60.0,
        extinction=MOR_75,
        phase=isotropic_phase,
    )
    along_m = (np.arange(600_000) + 0.5) * 1e-4
    from_lamp_m = np.hypot(2.0, along_m - 10.0)
    left = np.exp(-MOR_75 * (along_m + from_lamp_m))
    marched = 1000.0 * MOR_75 / (4.0 * math.pi) * np.sum(left / from_lamp_m**2) * 1e-4
    assert found == pytest.approx(2.6266, rel=0.01)
    assert found == pytest.approx(marched, rel=1e-4)


def over_sphere(phase: PhaseFunction) -> tuple[float, float]:
    """Integral and mean cosine; nodes are dense near forward scattering."""
    turn = math.pi * ((NODE + 1.0) / 2.0) ** 3
    weight = WEIGHT / 2.0 * math.pi * 3.0 * ((NODE + 1.0) / 2.0) ** 2
    value = 2.0 * math.pi * weight * np.sin(turn) * phase(np.cos(turn))
    return float(np.sum(value)), float(np.sum(value * np.cos(turn)))


@pytest.mark.parametrize("g", [-0.3, 0.0, 0.7, 0.87])
def test_henyey_and_greensteins_function_has_the_mean_cosine_of_its_name(g: float) -> None:
    assert over_sphere(partial(henyey_greenstein, g=g)) == pytest.approx((1.0, g), abs=1e-3)


@pytest.mark.parametrize(("diameter_um", "mean"), [(10, 0.864), (12, 0.869), (16, 0.876)])
def test_droplets_scatter_all_light_and_mostly_forwards(diameter_um: float, mean: float) -> None:
    found = over_sphere(partial(droplet_phase, diameter_um=diameter_um))
    assert found == pytest.approx((1.0, mean), abs=1e-3)


@pytest.mark.parametrize(("angle_deg", "value"), [(1, 100), (5, 1.71), (30, 0.184), (150, 0.0102)])
def test_droplets_of_12_micrometres_scatter_as_mie_says(angle_deg: float, value: float) -> None:
    cosine = np.cos(np.radians([angle_deg]))
    assert float(droplet_phase(cosine)[0]) == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize(
    ("mor_m", "angle_deg", "expected"),
    [
        *((100, angle, value) for angle, value in [(2, 6.3), (5, 1.20), (10, 0.40), (20, 0.11)]),
        *((50, angle, value) for angle, value in [(2, 5.1), (5, 0.96), (10, 0.32)]),
        *((200, angle, value) for angle, value in [(2, 5.0), (5, 0.95), (10, 0.32)]),
    ],
)
def test_a_lamp_30_metres_away_has_its_halo(
    mor_m: float, angle_deg: float, expected: float
) -> None:
    angle = math.radians(angle_deg)
    found = lamp_airlight(
        1000.0,
        closest_approach_m=30.0 * math.sin(angle),
        closest_along_ray_m=30.0 * math.cos(angle),
        distance_m=1000.0,
        extinction=extinction_from_mor(mor_m),
        phase=droplet_phase,
    )
    assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("depth", [0.5, 2.0, 4.0])
def test_a_target_keeps_of_its_light_what_single_photons_bring_to_the_eye(depth: float) -> None:
    """Photons from the eye, deflected wherever they are scattered, that still meet a disc."""
    lobes, photons = PhaseLobes.from_diameter_um(12.0), 40_000
    random, distance_m = np.random.default_rng(5), 40.0
    narrow_depth = lobes.narrow_fraction * depth
    counts = random.poisson(narrow_depth, photons)
    offset = np.zeros((photons, 2))
    for step in range(int(counts.max())):
        number = random.random(photons)
        g = lobes.narrow_g
        cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * number)) ** 2) / (2 * g)
        beyond_m = distance_m * random.random(photons)
        turn = random.random(photons) * 2.0 * math.pi
        off = np.tan(np.arccos(np.clip(cosine, 0.02, 1.0))) * beyond_m * (step < counts)
        offset += off[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for radius_m in (0.2, 0.6, 2.0):
        met = np.mean(np.hypot(*offset.T) < radius_m) * math.exp(-lobes.wide_fraction * depth)
        kept = lobes.fraction_kept(np.array(depth), np.array(radius_m / distance_m))
        assert kept == pytest.approx(met, rel=0.06)


def test_specks_keep_direct_light_and_walls_all_that_is_deflected_little() -> None:
    lobes = PhaseLobes.from_diameter_um(12.0)
    speck, wall = lobes.fraction_kept(np.array(2.0), np.array([1e-7, 1.5]))
    assert speck == pytest.approx(math.exp(-2.0), rel=1e-3)
    assert wall == pytest.approx(math.exp(-2.0 * lobes.wide_fraction), rel=0.02)


def test_deflections_within_an_angle_add_up_to_what_a_disc_keeps() -> None:
    lobes, depth = PhaseLobes.from_diameter_um(12.0), np.array(1.5)
    spread = lobes.forward_spread_rad(lobes.narrow_fraction * depth)
    edge = np.linspace(0.0, 0.2, 20_001)
    within = lobes.deflection_density((edge[1:] + edge[:-1]) / 2.0, spread).sum() * 0.2 / 20_000
    unscattered = math.exp(-lobes.narrow_fraction * 1.5)
    kept = lobes.fraction_kept(depth, np.array(0.2)) / math.exp(-lobes.wide_fraction * 1.5)
    assert unscattered + (1.0 - unscattered) * within == pytest.approx(kept, rel=1e-4)


def test_halos_gain_by_repeated_deflections_what_depth_and_angle_say() -> None:
    lobes = PhaseLobes.from_diameter_um(12.0)
    near, far = np.array(1e-4), np.array(0.5)
    assert lobes.deflection_gain(far, np.array(1e-3)) == pytest.approx(1.0, abs=2e-3)
    # Straight on, what other turns widen is missing; far to the side it is what comes.
    assert lobes.deflection_gain(near, np.array(2.0)) < lobes.deflection_gain(far, np.array(2.0))
    # All deflected light, once or more often, is e^depth - 1 of what is not deflected.
    angle = np.geomspace(1e-7, 1e4, 40_001)
    middle, width = np.sqrt(angle[1:] * angle[:-1]), np.diff(angle)
    once = 2.0 * lobes.deflection_density(middle, np.asarray(lobes.narrow_scale_rad))
    often = (once * lobes.deflection_gain(middle, np.array(2.0)) * width).sum()
    assert often == pytest.approx(math.expm1(2.0), rel=1e-3)
