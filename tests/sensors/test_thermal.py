"""Thermal images of walls, roads, people and cars under sun, sky and fog."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Mount, ThermalCamera, Weather
from numpy.typing import NDArray
from scipy import stats

from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics import water
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.infrared import STEFAN_BOLTZMANN, band_radiance, brightness_temperature
from advercity.randomness import create_generator
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster
from advercity.semantics import Semantic
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import KELVIN_PER_COUNT
from advercity.sensors.thermal import (
    ThermalConditions,
    ThermalView,
    cast_thermal,
    derive_thermal_conditions,
    take_thermal_image,
)
from advercity.sensors.thermal.surface_heat import compute_temperatures, find_warmth
from advercity.testing import CAR, build_box, build_flat_world, make_actor_state, make_frame
from advercity.world import World

NIGHT: dict[str, Any] = {
    "id": "tried",
    "time": "night",
    "sun": {"elevation_deg": -30},
    "sky": {"oktas": 0},
    "air": {"mor_m": None},
    "temperature_c": 10,
}
DAY = NIGHT | {"time": "day", "sun": {"elevation_deg": 60, "azimuth_deg": 90}, "temperature_c": 22}
IDEAL = ThermalCamera(netd_mk=0, fixed_pattern_mk=0, blur_px=0, mounts=(Mount(),))
EYE = pose_matrix((0.0, 0.0, 1.5))
MODEL = CameraModel(80, 60, 100.0)


def derive(weather: dict[str, Any]) -> ThermalConditions:
    declared = Weather.model_validate(weather)
    return derive_thermal_conditions(compute_atmosphere(declared, "urban"), declared)


def look(
    weather: dict[str, Any],
    *meshes: Mesh,
    frame: Frame | None = None,
    world: World | None = None,
    camera: ThermalCamera = IDEAL,
    noise: str = "noise",
) -> tuple[NDArray[np.float64], ThermalView]:
    """Take an image (h, w) in degrees Celsius of a world."""
    frame, conditions = frame or make_frame(), derive(weather)
    raycaster = Raycaster(world or build_flat_world(*meshes))
    view = cast_thermal(MODEL, EYE, frame, raycaster, conditions)
    rng = create_generator(noise)
    counts = take_thermal_image(camera, view, conditions, frame.states, rng, seed=1, name="cav1 0")
    return counts.astype(np.float64) * KELVIN_PER_COUNT - 273.15, view


def test_a_road_in_the_sun_is_as_warm_as_the_sol_air_temperature_says() -> None:
    celsius, _ = look(DAY)
    conditions = derive(DAY)
    transfer = 5.7 + 3.8 + 4 * STEFAN_BOLTZMANN * 295.15**3
    assert conditions.transfer_w_m2_k == pytest.approx(transfer)
    absorbed = 1 - (0.1003 + 0.20) / 2
    level = conditions.diffuse_w_m2 + conditions.sun_w_m2 * math.sin(math.radians(60))
    assert 700 < level < 1000
    by_sun = 0.55 * absorbed * level / transfer
    kept = 0.4 * absorbed * 190 / transfer
    lost = 0.6 * 0.95 * conditions.air.longwave_loss_w_m2 / transfer
    # Facing the camera, 5 % of what arrives is from the cold sky.
    assert celsius[-1, 40] == pytest.approx(22 + by_sun + kept - lost, abs=2.5)


def test_a_shadow_of_what_stands_stays_and_one_of_what_moves_does_not() -> None:
    roof = build_box((4.0, 4.0, 0.1), (8.0, 0.0, 4.0), material="metal")
    open_c, shaded_c = (look(DAY, *more)[0] for more in ((), (roof,)))
    # The sun is in the east, 60 degrees high: the shadow of the roof is 2.3 m further west.
    row = round(30 + 100 * 1.5 / (8.0 - 4.0 / math.tan(math.radians(60))))
    assert open_c[row, 40] - shaded_c[row, 40] > 15
    car = make_actor_state(1, 9.0)
    moving, parked = (
        look(DAY, frame=make_frame(replace(car, is_parked=at_rest)))[1] for at_rest in (False, True)
    )
    on_road = moving.hits.semantic == Semantic.ROAD
    assert moving.sun_fraction[on_road].min() == 1.0
    assert parked.sun_fraction[parked.hits.semantic == Semantic.ROAD].min() == 0.0


def test_panes_mirror_the_cold_sky_and_a_wet_road_has_no_contrast() -> None:
    slanted = build_box((1.0, 40.0, 40.0), (20.0, 0.0, 0.0), material="glass")
    wall = replace(slanted, material="brick")
    glass_c, brick_c = (look(NIGHT, mesh)[0][5, 40] for mesh in (slanted, wall))
    assert glass_c < brick_c - 2
    grass = build_box((400.0, 2.0, 0.2), (0.0, -2.0, -0.09), material="grass")
    dry, wet = (look(DAY | {"surface": {"wetness": wetness}}, grass)[0][-1] for wetness in (0, 1))
    assert np.ptp(wet) < 0.3 * np.ptp(dry)


def test_puddles_are_found_once_an_image(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []
    is_in_puddle = water.is_in_puddle

    def record(points: NDArray[np.floating[Any]], coverage: float) -> NDArray[np.bool_]:
        counts.append(len(points))
        return is_in_puddle(points, coverage)

    monkeypatch.setattr(water, "is_in_puddle", record)
    _, view = look(DAY | {"surface": {"wetness": 1, "puddle_coverage": 0.3}})
    assert len(counts) == 1
    on_road = view.hits.semantic == Semantic.ROAD
    assert view.is_water[on_road].any() and not view.is_water.all()


def test_panes_mirror_by_schlick_whatever_the_angle() -> None:
    """Schlick 1994: F + (1 - F) (1 - cos)^5, with F of glass that faces the camera."""
    pane = build_box((60.0, 8.0, 0.02), (31.0, 0.0, 0.0), material="glass")
    celsius, view = look(NIGHT, pane)
    conditions = derive(NIGHT)
    is_pane = (view.hits.material == MATERIAL_NAMES.index("glass")) & (
        view.hits.normal[:, 2] > 0.99
    )
    kelvin, emissivity = compute_temperatures(
        view.hits, conditions, view.sun_fraction, view.sky_fraction
    )
    facing = 1.0 - emissivity[is_pane]
    down = -view.directions[view.seen][is_pane][:, 2].astype(float)
    mirrored = facing + (1.0 - facing) * (1.0 - down) ** 5
    sky = conditions.air.sky_radiance(down)
    expected = (1 - mirrored) * band_radiance(kelvin[is_pane]) + mirrored * sky
    found = celsius.ravel()[view.seen][is_pane]
    near = view.hits.range_m[is_pane] < 12
    assert np.ptp(down[near]) > 0.1
    np.testing.assert_allclose(
        found[near], brightness_temperature(expected)[near] - 273.15, atol=0.4
    )


def see_person(x_m: float, **weather: Any) -> float:
    """Find by how much a clothed person looks warmer than the air."""
    cloth = build_box((0.4, 0.6, 1.7), (0.0, 0.0, 0.85), material="cloth_dark")
    world = build_flat_world(bodies={"person": replace(CAR, parts=(cloth,))})
    person = make_actor_state(7, x_m, actor_class="pedestrian", blueprint="person")
    celsius, view = look(NIGHT | weather, frame=make_frame(person), world=world)
    return float(celsius[view.instance == person.actor.id].mean()) - 10.0


def test_a_person_at_40_m_glows_at_night_and_in_haze_and_not_in_dense_fog() -> None:
    # 90 W/m2 through the clothes, less what the clear sky takes.
    assert 4.0 < see_person(40.0) < 8.0
    assert see_person(40.0) > 0.95 * see_person(5.0)
    assert see_person(40.0, air={"mor_m": 1000}) > 0.95 * see_person(5.0, air={"mor_m": 1000})
    assert see_person(40.0, fog={"mor_m": 50}) < 0.3 * see_person(5.0, fog={"mor_m": 50})


def test_a_car_that_drives_is_warm_and_a_parked_one_cools() -> None:
    driving = make_actor_state(1, 8.0)
    parked = [
        replace(driving, is_parked=True, actor=replace(driving.actor, id=number))
        for number in range(1, 200)
    ]
    assert find_warmth(driving, seed=1) == 1.0
    warmths = [find_warmth(state, seed=1) for state in parked]
    assert warmths == [find_warmth(state, seed=1) for state in parked]
    # Parked for 3 hours on average and cooling within 0.7: the mean is 0.7 / 3.7.
    assert np.mean(warmths) == pytest.approx(0.7 / 3.7, abs=0.06)
    cold = parked[int(np.argmin(warmths))]
    hot_c, cold_c = (look(NIGHT, frame=make_frame(state))[0].max() for state in (driving, cold))
    assert hot_c > cold_c + 5


def test_noise_is_as_declared_and_the_pattern_of_a_camera_stays() -> None:
    wall = build_box((1.0, 100.0, 100.0), (3.0, 0.0, 0.0), material="wood")
    overcast = DAY | {"sky": {"oktas": 8}, "temperature_c": 26}
    noisy = replace_camera(netd_mk=60)
    first, second = (look(overcast, wall, camera=noisy, noise=name)[0] for name in "ab")
    # Of two images; steps of 0.04 K add 12 mK to each.
    assert (first - second).std() == pytest.approx(0.061 * math.sqrt(2), rel=0.06)
    patterned = replace_camera(fixed_pattern_mk=200)
    first, second = (look(overcast, wall, camera=patterned, noise=name)[0] for name in "ab")
    np.testing.assert_array_equal(first, second)
    assert (first - np.median(first)).std() == pytest.approx(0.2 * math.sqrt(2), rel=0.2)
    assert first.mean(axis=0).std() == pytest.approx(0.2, rel=0.3)


def test_noise_in_time_is_normal_and_independent_of_pixels_and_of_the_pattern() -> None:
    wall = build_box((1.0, 100.0, 100.0), (3.0, 0.0, 0.0), material="wood")
    overcast = DAY | {"sky": {"oktas": 8}, "temperature_c": 26}
    camera = replace_camera(netd_mk=300, fixed_pattern_mk=300)
    images = np.array([look(overcast, wall, camera=camera, noise=name)[0] for name in "abcdef"])
    pattern, noise = images.mean(axis=0), (images - images.mean(axis=0))[0]
    alone = abs(np.corrcoef(noise.ravel(), pattern.ravel())[0, 1])
    beside = abs(np.corrcoef(noise[:, :-1].ravel(), noise[:, 1:].ravel())[0, 1])
    assert max(alone, beside) < 5 / math.sqrt(noise.size)
    # The mean of six takes a sixth of the variance.
    values = noise.ravel() / (0.3 * math.sqrt(5 / 6))
    assert stats.kstest(values - values.mean(), "norm").pvalue > 1e-4


def replace_camera(**changes: float) -> ThermalCamera:
    return IDEAL.model_copy(update=changes)


def test_snow_hides_the_warmth_of_the_ground() -> None:
    cold = NIGHT | {"temperature_c": -3, "sky": {"oktas": 8}}
    bare = look(cold)[0][-1, 40]
    snowy = look(cold | {"snow": {"depth_mm": 50, "road_coverage": 1}})[0][-1, 40]
    conditions = derive(cold)
    cooled = -3 - 0.95 * conditions.air.longwave_loss_w_m2 / conditions.transfer_w_m2_k
    assert snowy == pytest.approx(cooled, abs=0.1)
    assert bare > cooled + 1


def test_a_semitrailer_has_no_engine() -> None:
    """Seen from behind it, the exhaust of a car is warm, and a semi-trailer's rear is not."""
    car = make_actor_state(1, 9.0)
    towed = replace(car, actor=replace(car.actor, towed_by=7))
    car_c, towed_c = (look(NIGHT, frame=make_frame(state))[0] for state in (car, towed))
    assert (car_c - towed_c).max() > 5
    assert (towed_c - car_c).max() < 1
