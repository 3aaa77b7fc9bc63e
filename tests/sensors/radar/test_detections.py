"""What a radar detects: actors in weather, velocities, clutter, other radars."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Mount, Weather

from advercity.assets.bodies import build_body
from advercity.frames import ActorState
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.semantics import Semantic
from advercity.sensors.measurements import PointKind, RadarDetections
from advercity.sensors.radar import RadarConditions, derive_radar_conditions
from advercity.sensors.radar.cfar import compute_clutter_chance
from advercity.testing import (
    CAR,
    build_box,
    build_flat_world,
    load_example_spec,
    make_actor_state,
    make_frame,
)
from advercity.world import Body
from tests.sensors.radar.builders import (
    CLEAR,
    NARROW,
    WIDE,
    place,
    plate,
    rows_of,
    scan,
    triangles,
    trihedral,
    vary,
)

ROAD = build_flat_world().static
BUMPER = pose_matrix((0, 0, 0.6))
FACING = math.pi


def derive_air(parts: dict[str, Any]) -> RadarConditions:
    clear = {"id": "tried", "time": "day", "air": {"mor_m": 20_000}}
    weather = Weather.model_validate(clear | parts)
    atmosphere = compute_atmosphere(weather, "rural")
    return derive_radar_conditions(atmosphere, weather.lens)


@pytest.fixture(scope="module")
def rain() -> RadarConditions:
    return derive_air({"rain": {"rate_mm_h": 50}})


@cache
def load_person() -> Body:
    return build_body("pedestrian_0001", load_example_spec().blueprints["pedestrian_0001"])


def make_person(range_m: float, *, azimuth_m: float = 0.4, travelled_m: float = 0.0) -> ActorState:
    body = load_person()
    state = make_actor_state(
        *(9, range_m, azimuth_m),
        yaw_rad=FACING,
        speed_m_s=1.4,
        actor_class="pedestrian",
        blueprint="person",
        paint="cloth_grey",
        size=body.size,
    )
    return replace(state, travelled_m=travelled_m)


def detect(*states: ActorState, **given: Any) -> RadarDetections:
    bodies = {"car": CAR, "person": load_person()}
    return scan(
        WIDE, *ROAD, frame=make_frame(*states), bodies=bodies, pose=BUMPER, **given
    ).detections


def strongest_snr_db(found: RadarDetections, actor: int) -> float:
    rows = rows_of(found, actor)
    return float(found.snr_db[rows].max()) if len(rows) else -math.inf


def test_rain_takes_at_most_4_db_of_a_car_at_100_m_and_fog_of_63_m_at_most_02(
    rain: RadarConditions,
) -> None:
    car = make_actor_state(7, 100.0, 0.4, yaw_rad=FACING)
    clear = strongest_snr_db(detect(car), 7)
    assert clear > 13
    assert clear - 4.2 < strongest_snr_db(detect(car, air=rain), 7) < clear - 3
    fog = derive_air({"fog": {"mor_m": 63}})
    assert clear - 0.2 < strongest_snr_db(detect(car, air=fog), 7) <= clear


def test_weathers_differ_in_the_power_of_echoes_and_not_in_their_places() -> None:
    cars = [make_actor_state(7, 40.0, 0.4, yaw_rad=FACING), make_actor_state(8, 60.0, -6.0)]
    clear = detect(*cars)
    fog = detect(*cars, air=derive_air({"fog": {"mor_m": 63}}))
    for actor in (7, 8):
        before, after = (rows_of(found, actor) for found in (clear, fog))
        assert len(before) > 0
        np.testing.assert_allclose(fog.points[after], clear.points[before], atol=0.01)
        np.testing.assert_allclose(fog.snr_db[after], clear.snr_db[before], atol=0.2)
        assert (fog.snr_db[after] < clear.snr_db[before]).all()


def test_a_pedestrian_is_detected_up_to_somewhere_between_45_and_70_m() -> None:
    def fraction_detected(range_m: float) -> float:
        found = [
            detect(make_person(range_m + 0.7 * step, travelled_m=0.3 * step), key=step)
            for step in range(6)
        ]
        return float(np.mean([len(rows_of(one, 9)) > 0 for one in found]))

    # Here and there the road's mirror image cancels the echo.
    assert fraction_detected(40) > 0.8
    assert fraction_detected(85) < 0.5


def test_the_legs_of_a_pedestrian_spread_its_velocity() -> None:
    found = [detect(make_person(12, travelled_m=0.2 * step)) for step in range(4)]
    velocities = np.concatenate([one.velocity_m_s[rows_of(one, 9)] for one in found])
    assert np.median(velocities) == pytest.approx(-1.4, abs=0.5)
    # A leg swings at about twice the speed of the body, and rests on the ground.
    assert velocities.min() < -2.0
    assert velocities.max() > -0.7


def test_an_approaching_car_folds_as_the_unambiguous_interval_says() -> None:
    car = make_actor_state(7, 60.0, 0.4, yaw_rad=FACING, speed_m_s=20)
    found = detect(car, velocity=(20, 0, 0))
    # -40 m/s is 20 m/s in an interval from -30 to 30.
    assert found.velocity_m_s[rows_of(found, 7)] == pytest.approx(20.0, abs=0.3)
    slow = detect(replace(car, motion=replace(car.motion, velocity=np.array([-5.0, 0, 0]))))
    assert slow.velocity_m_s[rows_of(slow, 7)] == pytest.approx(-5.0, abs=0.3)


def test_a_still_scene_has_no_velocity_for_a_still_sensor() -> None:
    wall = build_box((1, 20, 4), (30, 0, 2))
    found = scan(WIDE, *ROAD, wall, pose=BUMPER).detections
    still = found.kind != PointKind.NOISE
    assert still.sum() > 20
    assert np.abs(found.velocity_m_s[still]).max() < WIDE.speed_cell_m_s


def test_the_ground_recedes_behind_a_moving_sensor_and_comes_closer_ahead() -> None:
    wall = build_box((1, 20, 4), (30, 0, 2))
    found = scan(WIDE, wall, pose=BUMPER, velocity=(10, 0, 0)).detections
    ahead = (found.kind == PointKind.SURFACE) & (np.abs(found.points[:, 1]) < 2)
    assert found.velocity_m_s[ahead] == pytest.approx(-10.0, abs=0.3)


def test_two_radars_face_to_face_raise_their_noise_by_the_duty_cycle() -> None:
    target = trihedral(0.3, 40)
    quiet = scan(WIDE, target).detections
    loss_db: list[float] = []
    for duty in (0.25, 0.5):
        other = place(vary(WIDE, duty_cycle=duty), pose_matrix((20, 5, 0), yaw=math.pi))
        disturbed = scan(WIDE, target, others=[other]).detections
        loss_db.append(float(quiet.snr_db.max() - disturbed.snr_db.max()))
    # Friis' formula by hand: 12 dBm, 9.2 dBi on both sides less the fall-off at 14 deg, 20.6 m.
    rise = [10 ** (loss / 10) - 1 for loss in loss_db]
    assert rise[1] / rise[0] == pytest.approx(2.0, rel=0.1)
    off_axis = 2 ** (-((math.degrees(math.atan(5 / 20)) / 60) ** 2))
    received_w = 0.01585 * (30_000 / 3600 * off_axis) ** 2 * (0.003893 / (4 * math.pi * 20.6)) ** 2
    noise_w_hz = 1.381e-23 * 290 * 10**1.2
    assert rise[1] == pytest.approx(received_w * 0.5 / 375e6 / noise_w_hz, rel=0.15)


def test_a_radar_that_looks_away_or_is_hidden_disturbs_no_other() -> None:
    target, wall = trihedral(0.3, 40), build_box((0.2, 3, 3), (15, 5, 0))
    quiet = scan(WIDE, target, wall).detections
    facing, away = (place(WIDE, pose_matrix((20, 5, 0), yaw=yaw)) for yaw in (math.pi, 0.0))
    for others in ([away], [facing]):
        found = scan(WIDE, target, wall, others=others).detections
        assert found.snr_db.max() == quiet.snr_db.max()


def test_radars_on_one_mount_do_not_disturb_each_other() -> None:
    target = trihedral(0.2, 50)
    alone, beside = (
        scan(WIDE, target, others=others).detections for others in ((), [place(WIDE, np.eye(4))])
    )
    assert np.array_equal(alone.snr_db, beside.snr_db)


def test_rain_is_clutter_near_the_sensor_that_falls_and_drifts(rain: RadarConditions) -> None:
    found = scan(WIDE, *ROAD, pose=BUMPER, air=rain, velocity=(10, 0, 0)).detections
    drops = found.kind == PointKind.RAIN
    assert drops.sum() > 20
    assert np.median(np.linalg.norm(found.points[drops], axis=1)) < 20
    assert np.median(found.velocity_m_s[drops & (found.points[:, 0] > 3)]) == pytest.approx(
        -10, abs=3
    )
    assert not (scan(WIDE, *ROAD, pose=BUMPER).detections.kind == PointKind.RAIN).any()


def test_no_rain_is_clutter_under_a_deck(rain: RadarConditions) -> None:
    """The deck is 5 m up, from 4 to 12 m ahead and as wide as what the radar sees of it."""
    deck = build_box((8, 80, 1), (8, 0, 5.5), material="concrete", semantic=Semantic.BRIDGE)

    def count_drops(*static: Mesh) -> tuple[int, int]:
        clouds = [scan(WIDE, *ROAD, *static, pose=BUMPER, air=rain, key=key) for key in range(4)]
        points = np.concatenate(
            [item.detections.points[item.detections.kind == PointKind.RAIN] for item in clouds]
        )
        # A cell of 0.4 m at an edge of the deck may lie on either side of it.
        under = (points[:, 0] > 4.3) & (points[:, 0] < 11.7) & (points[:, 2] < 4)
        return int(under.sum()), int((points[:, 0] < 3.7).sum())

    (open_under, open_before), (under, before) = count_drops(), count_drops(deck)
    assert open_under > 20
    assert under == 0
    assert before == pytest.approx(open_before, rel=0.3)


def test_a_mirror_shows_a_ghost_of_a_car_behind_it() -> None:
    car = make_actor_state(7, 20.0, -3.0, yaw_rad=FACING)
    rail = build_box((60, 0.1, 3), (30, 5, 1.5), material="sign_blue")
    found = scan(
        WIDE, *ROAD, rail, frame=make_frame(car), bodies={"car": CAR}, pose=BUMPER
    ).detections
    ghosts = (found.instance == 7) & (found.kind == PointKind.GHOST)
    assert ghosts.any()
    # Seen in the mirror at y = 5, the car at y = -3 is at y = 13.
    behind = found.points[ghosts & (found.points[:, 1] > 6)]
    assert np.abs(behind[:, 1] - 12.5).min() < 2.5
    assert np.abs(behind[:, 0] - 18.5).min() < 3


@pytest.mark.parametrize("seed", range(4))
def test_every_detection_is_in_view_and_no_larger_than_a_lorry(seed: int) -> None:
    """In a yard of metal, whose walls and cars mirror each other's echoes from all sides."""
    draw = np.random.default_rng(seed)
    walls = [
        build_box(
            (30, 0.1, 4),
            (draw.uniform(-20, 30), side * draw.uniform(3, 12), 2),
            material="sign_blue",
        )
        for side in (-1, -1, 1, 1)
    ]
    walls += [
        build_box((0.1, 40, 4), (x, 0, 2), material="sign_blue")
        for x in (draw.uniform(-9, -2), draw.uniform(20, 40))
    ]
    cars = [
        make_actor_state(number, *draw.uniform((4, -8), (40, 8)), yaw_rad=draw.uniform(-3, 3))
        for number in range(1, 9)
    ]

    found = scan(
        *(WIDE, *ROAD, *walls),
        frame=make_frame(*cars),
        bodies={"car": CAR},
        pose=BUMPER,
        air=derive_air({"rain": {"rate_mm_h": 50}}),
        key=seed,
    ).detections

    x, y, z = found.points.T.astype(float)
    azimuth_deg, elevation_deg = (
        np.degrees(np.arctan2(y, x)),
        np.degrees(np.arctan2(z, np.hypot(x, y))),
    )
    assert (found.kind == PointKind.GHOST).sum() > 10
    assert np.abs(azimuth_deg).max() <= WIDE.azimuth_fov_deg / 2 + 1e-3
    assert np.abs(elevation_deg).max() <= WIDE.elevation_fov_deg / 2 + 1e-3
    assert found.rcs_dbsm.max() < 60


def test_the_road_lets_a_target_fade_with_its_height() -> None:
    def section_dbsm(height_m: float, *ground: Mesh) -> float:
        target = build_box((0.2, 1.0, 0.05), (60, 0.4, height_m), material="car_paint_red")
        found = scan(NARROW, *ground, target, pose=BUMPER).detections
        near = np.flatnonzero(np.abs(found.points[:, 0] - 60) < 2)
        return float(found.rcs_dbsm[near].max(initial=-40.0))

    # The interference has a period of lambda R / (2 h), 0.19 m at 60 m.
    heights = 0.5 + 0.195 / 6 * np.arange(7)
    gains = [section_dbsm(height, *ROAD) - section_dbsm(height) for height in heights]
    assert 4 < max(gains) < 12
    assert max(gains) - min(gains) > 7
    # A period apart the echo is the same, and the weakest is in between.
    assert gains[0] == pytest.approx(gains[6], abs=3)
    assert 1 <= int(np.argmin(gains)) <= 5


def test_water_and_ice_on_the_radome_cost_what_they_should() -> None:
    lens = {"enabled": True, "kind": "water", "coverage": {"front": 1.0}}
    wet = derive_air({"lens": lens})
    assert 2 <= wet.select_radome_db(Mount()) <= 4
    assert wet.select_radome_db(Mount(yaw_deg=180)) == 0
    icy = derive_air({"temperature_c": -2, "surface": {"ice_mm": 1.0}})
    assert 5 <= icy.select_radome_db(Mount()) <= 15
    clear, covered = (scan(WIDE, plate(0.3, 30), air=item).detections for item in (CLEAR, wet))
    assert clear.snr_db.max() - covered.snr_db.max() == pytest.approx(6.0, abs=0.1)


def test_the_same_key_gives_the_same_detections_and_another_one_others() -> None:
    car = make_actor_state(7, 30.0, yaw_rad=FACING)
    first, again, other = (detect(car, key=key) for key in (1, 1, 2))
    for name in vars(first):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert len(first.points) != len(other.points) or not np.array_equal(first.points, other.points)


def test_weather_leaves_the_echo_of_a_surface_what_it_was(rain: RadarConditions) -> None:
    car = make_actor_state(7, 30.0, yaw_rad=FACING)
    dry, wet = detect(car), detect(car, air=replace(rain, wetness=0.0))
    cells = [{tuple(np.round(one.points[row], 0)) for row in rows_of(one, 7)} for one in (dry, wet)]
    assert cells[0] & cells[1]


def test_order_statistics_detect_next_to_a_strong_neighbour_what_the_mean_does_not() -> None:
    pair = [trihedral(0.3, 50), trihedral(0.05, 53, 0.6)]
    counts = {}
    for detector in ("ca", "os"):
        found = scan(vary(NARROW, detector=detector), *pair).detections
        counts[detector] = int((np.abs(found.points[:, 0] - 53) < 0.5).sum())
    assert counts == {"ca": 0, "os": 1}


def test_false_alarms_are_as_many_as_the_threshold_lets_pass() -> None:
    counts = [
        int((scan(vary(WIDE, rays=100), key=key).detections.kind == PointKind.NOISE).sum())
        for key in range(10)
    ]
    # (1 + 20 / 32)^-32 of 400 velocities, 80 azimuths, 15 elevations and 376 ranges.
    assert np.mean(counts) == pytest.approx(180e6 * (1 + 10**1.3 / 32) ** -32, rel=0.3)


def test_errors_of_range_angles_and_velocity_are_independent_and_as_wide_as_their_cells() -> None:
    radar = vary(NARROW, elevation_cell_deg=1)
    found = [scan(radar, trihedral(0.04, 60), key=key).detections for key in range(24)]
    strongest = [int(one.snr_db.argmax()) for one in found]
    points = np.array([one.points[row] for one, row in zip(found, strongest, strict=True)], float)
    velocities = [float(one.velocity_m_s[row]) for one, row in zip(found, strongest, strict=True)]
    range_m = np.linalg.norm(points, axis=1)
    angles = np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / range_m)
    errors = np.array([range_m, *angles, velocities])
    # Of 24, a correlation of 0.65 is 3.5 standard deviations.
    np.testing.assert_allclose(np.corrcoef(errors), np.eye(4), atol=0.65)
    azimuth, elevation = errors[1:3].std(axis=1)
    assert azimuth / elevation == pytest.approx(3.0, rel=0.5)


def test_a_target_leaks_into_its_neighbours_as_a_hann_window_does() -> None:
    # In the middle of a range cell of 0.4 m.
    found = scan(vary(NARROW, output="cube"), trihedral(0.5, 50.5 * 0.39972)).cube
    assert found is not None
    power_db = found.power_db.astype(float).ravel()
    peak = int(power_db.argmax())
    spectrum = np.abs(np.fft.fft(0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)))
    beside_db = 20 * math.log10(spectrum[1] / spectrum[0])
    assert max(power_db[peak - 1], power_db[peak + 1]) - power_db[peak] == pytest.approx(
        beside_db, abs=0.3
    )


def test_speckle_is_that_of_two_looks() -> None:
    """A mean of two exponentials has half the variance of one, and leakage averages more.

    With a quarter of both neighbours: 0.5 (1 + 2/16) / 1.5² of the squared mean.
    """
    strip = triangles(
        [[4, -2, -0.5], [30, -2, 0.5], [30, 2, 0.5], [4, 2, -0.5]],
        [[0, 1, 2], [0, 2, 3]],
        "asphalt",
    )
    scans = [scan(vary(NARROW, output="cube"), strip, key=key).cube for key in range(24)]
    power = np.array(
        [10 ** (one.power_db.astype(float).ravel()[26:70] / 10) for one in scans if one]
    )
    variance = power.var(axis=0, ddof=1) / power.mean(axis=0) ** 2
    assert variance.mean() == pytest.approx(0.25, abs=0.07)


def test_a_cube_has_every_cell_and_the_targets_stand_out() -> None:
    found = scan(vary(WIDE, output="cube"), trihedral(1.5, 50))
    assert found.cube is not None
    assert found.cube.power_db.shape == (376, 80, 15)
    peak = np.unravel_index(found.cube.power_db.argmax(), found.cube.power_db.shape)
    assert peak[0] == pytest.approx(50 / 0.4, abs=1)
    assert peak[1] in (39, 40)
    assert abs(float(found.cube.velocity_m_s[peak])) < 0.15
    assert scan(WIDE).cube is None


@pytest.mark.parametrize("clutter", [0.0, 1.0, 100.0])
def test_uneven_clutter_raises_more_alarms_as_the_integral_over_its_texture_has_it(
    clutter: float,
) -> None:
    """Exponential noise on log-normal clutter of mean 1, by Gauss-Hermite quadrature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    local = (1.0 + clutter * np.exp(nodes - 0.5)) / (1.0 + clutter)
    expected = weights @ np.exp(-3.0 / local) / weights.sum()
    found = compute_clutter_chance(np.array([clutter]), 3.0)
    assert found == pytest.approx([expected], rel=0.012)


def test_rain_in_a_cube_ends_at_a_wall(rain: RadarConditions) -> None:
    wall = triangles(
        [[5, -60, -30], [5, 60, -30], [5, 60, 30], [5, -60, 30]],
        [[0, 1, 2], [0, 2, 3]],
        "asphalt",
    )
    cube = vary(WIDE, output="cube")
    open_air, walled, dry = (
        found.power_db.astype(float)
        for found in (scan(cube, air=rain).cube, scan(cube, wall, air=rain).cube, scan(cube).cube)
        if found is not None
    )
    ahead, before, behind = slice(36, 44), slice(5, 10), slice(18, 30)  # cells of 0.4 m
    assert walled[before, ahead].mean() == pytest.approx(open_air[before, ahead].mean(), abs=1.0)
    assert open_air[behind, ahead].mean() > dry[behind, ahead].mean() + 1.2
    assert walled[behind, ahead].mean() == pytest.approx(dry[behind, ahead].mean(), abs=0.2)


def test_a_cell_of_a_cube_has_the_velocity_of_the_stronger_echo(rain: RadarConditions) -> None:
    """A target far below the noise leaves the noise's velocity; a strong one brings its own."""
    moving = (8.0, 0.0, 0.0)
    weak, strong = (
        scan(vary(NARROW, output="cube"), trihedral(size_m, 60), velocity=moving).cube
        for size_m in (0.002, 0.5)
    )
    assert weak is not None
    assert strong is not None
    at = round(60 / 0.39972)
    rates = [cube.velocity_m_s[at - 1 : at + 2].astype(float).ravel() for cube in (weak, strong)]
    assert np.abs(rates[1] + 8.0).min() < 0.3
    assert np.abs(rates[0] + 8.0).min() > 0.3
