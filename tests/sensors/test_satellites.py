"""Receivers of satellites: orbits, paths, errors and positions, against formulas and SciPy."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from advercity_dsl.positioning import ConstellationName, SatelliteReceiver
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from advercity.geometry.geodesy import Geodetic, enu_from_ecef, enu_from_geodetic
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.gnss import ReceiverInPlace, SkyView
from advercity.sensors.gnss.constellations import CONSTELLATIONS, compute_satellites
from advercity.sensors.gnss.receiver import (
    CHIP_M,
    compute_code_noise,
    compute_multipath,
    compute_phase_noise,
)
from advercity.sensors.gnss.signal_paths import (
    WALL_PERMITTIVITY,
    WAVELENGTH_M,
    Reflections,
    compute_reflection,
)
from advercity.sensors.gnss.solution import compute_dilution, solve_position
from advercity.sensors.measurements import GnssFix, GnssSolution
from advercity.testing import build_box, build_flat_world
from advercity.world import World

ORIGIN = Geodetic(49.0, 8.0, 110.0)
NOON = datetime(2024, 6, 21, 12, tzinfo=UTC)
STREET = (build_box((300, 10, 25), (0, 15, 12.5)), build_box((300, 10, 25), (0, -15, 12.5)))


def test_gps_turns_twice_in_a_sidereal_day_and_comes_back() -> None:
    sidereal_s = 86_164.0905
    assert CONSTELLATIONS["gps"].period_s == pytest.approx(sidereal_s / 2, rel=2e-4)
    now, later = (
        compute_satellites(["gps"], NOON + timedelta(seconds=after), ORIGIN)
        for after in (0.0, sidereal_s)
    )
    assert np.linalg.norm(later - now, axis=1).max() < 0.005 * CONSTELLATIONS["gps"].radius_m


@given(
    name=st.sampled_from(sorted(CONSTELLATIONS)),
    since_h=st.floats(-24 * 3650, 24 * 3650),
    latitude_deg=st.floats(-89, 89),
    longitude_deg=st.floats(-180, 180),
)
def test_planes_of_orbits_stand_still_while_the_earth_turns_east(
    name: ConstellationName, since_h: float, latitude_deg: float, longitude_deg: float
) -> None:
    epoch = datetime(2000, 1, 1, 12, tzinfo=UTC)
    origin = Geodetic(latitude_deg, longitude_deg, 0.0)
    earth_from_plan = Rotation.from_euler(
        "ZYX", [90 + longitude_deg, 0, 90 - latitude_deg], degrees=True
    )
    places: list[NDArray[np.float64]] = []
    for hour in (since_h, since_h + 0.5):
        found = compute_satellites([name], epoch + timedelta(hours=hour), origin)
        ecef = earth_from_plan.apply(found - enu_from_ecef(np.zeros(3), origin))
        # Meeus, Astronomical Algorithms, 12.4, in days since noon of 2000-01-01.
        turned_deg = 280.46061837 + 360.98564736629 * hour / 24
        places.append(Rotation.from_euler("z", turned_deg % 360, degrees=True).apply(ecef))

    walker = CONSTELLATIONS[name]
    normals = np.cross(places[0], places[1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    np.testing.assert_allclose(
        np.degrees(np.arccos(normals[:, 2])), walker.inclination_deg, atol=1e-4
    )
    nodes_deg = np.degrees(np.arctan2(normals[:, 0], -normals[:, 1])) % 360
    expected = np.repeat(np.arange(walker.planes), walker.satellites // walker.planes)
    off = (nodes_deg - expected * 360 / walker.planes + 180) % 360 - 180
    np.testing.assert_allclose(off, 0, atol=0.05)
    np.testing.assert_allclose(np.linalg.norm(places[0], axis=1), walker.radius_m, rtol=1e-9)


def test_galileo_turns_seventeen_times_in_ten_days() -> None:
    assert CONSTELLATIONS["galileo"].period_s == pytest.approx(861_640.905 / 17, rel=2e-4)


def test_as_many_satellites_are_in_view_as_at_a_real_place() -> None:
    """24 GPS satellites: 4 to 12 above 5 degrees, on average the sky's part of their sphere."""
    counts: list[int] = []
    for hour in range(24):
        satellites = compute_satellites(["gps"], NOON + timedelta(hours=hour), ORIGIN)
        up = satellites[:, 2] / np.linalg.norm(satellites, axis=1)
        counts.append(int((up > math.sin(math.radians(5))).sum()))
    assert min(counts) >= 4
    assert max(counts) <= 12
    assert np.mean(counts) == pytest.approx(8.0, abs=1.0)


def test_positions_are_those_of_scipy_s_least_squares() -> None:
    rng = np.random.default_rng(1)
    satellites = compute_satellites(["gps"], NOON, ORIGIN)
    satellites = satellites[satellites[:, 2] > 5e6]
    place, clock_m = np.array([120.0, -80.0, 15.0]), 3e5
    exact = np.linalg.norm(satellites - place, axis=1) + clock_m
    sd_m = rng.uniform(1, 5, len(satellites))
    found = solve_position(satellites, exact, sd_m)
    assert found is not None
    np.testing.assert_allclose(found, place, atol=1e-6)

    noisy = exact + sd_m * rng.standard_normal(len(satellites))

    def compute_residuals(unknown: np.ndarray) -> np.ndarray:
        distances = np.linalg.norm(satellites - unknown[:3], axis=1)
        return (distances + unknown[3] - noisy) / sd_m

    def derive(unknown: np.ndarray) -> np.ndarray:
        away = unknown[:3] - satellites
        unit = away / np.linalg.norm(away, axis=1)[:, None]
        return np.column_stack([unit, np.ones(len(unit))]) / sd_m[:, None]

    expected = least_squares(
        compute_residuals,
        np.zeros(4),
        derive,  # pyright: ignore[reportArgumentType]  (stubs know names of methods only)
        x_scale="jac",
        gtol=1e-12,
    ).x
    found = solve_position(satellites, noisy, sd_m)
    assert found is not None
    np.testing.assert_allclose(found, expected[:3], atol=1e-3)


def test_three_satellites_are_no_position_nor_are_four_in_one_direction() -> None:
    satellites = compute_satellites(["gps"], NOON, ORIGIN)[:3]
    assert solve_position(satellites, np.linalg.norm(satellites, axis=1), np.ones(3)) is None
    same = np.repeat(satellites[:1], 5, axis=0)
    assert solve_position(same, np.linalg.norm(same, axis=1), np.ones(5)) is None


def test_the_best_four_satellites_have_the_dilution_of_textbooks() -> None:
    """One at the zenith and three around the horizon: 1.15 both ways (Kaplan and Hegarty)."""
    turns = np.radians([0, 120, 240])
    around = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(3)])
    found = compute_dilution(np.vstack([around, [0, 0, 1]]))
    assert found.horizontal == pytest.approx(math.sqrt(4 / 3))
    assert found.vertical == pytest.approx(math.sqrt(4 / 3))
    assert found.position == pytest.approx(math.sqrt(8 / 3))


def build_sky(*meshes: object) -> SkyView:
    return SkyView(Raycaster(build_flat_world(*meshes)))  # type: ignore[arg-type]


def make_direction(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """A direction by its azimuth clockwise from north."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return np.array([[level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)]])


ANTENNA = np.array([0.0, 0.0, 1.5])


def test_a_wall_hides_what_is_behind_it_and_foliage_weakens() -> None:
    crown = build_box((20, 20, 6), (0, 60, 10), semantic=Semantic.VEGETATION)
    pole = build_box((0.3, 0.3, 9), (60, 0, 4.5), semantic=Semantic.POLE)
    sky = build_sky(STREET[1], crown, pole)
    seen = [(180, 30), (180, 80), (0, 80), (0, 8.7), (90, 2)]
    directions = np.vstack([make_direction(*one) for one in seen])
    blocked, loss_db = sky.look(np.repeat(ANTENNA[None], 5, axis=0), directions)
    np.testing.assert_array_equal(blocked, [True, False, False, False, False])
    np.testing.assert_array_equal(loss_db[[0, 1, 2, 4]], 0)
    # The hollow box has two leaves in 20 m; a crown has many.
    assert loss_db[3] == pytest.approx(2 * 0.5 * 1.6)


def test_a_wall_reflects_by_the_path_over_its_mirror_image() -> None:
    """The street's southern wall is at y = -10; the satellite is in the north."""
    sky, towards = build_sky(STREET[1]), make_direction(20, 40)
    found = sky.find_reflections(ANTENNA, towards, cross_polar_db=10)
    cosine = math.cos(math.radians(40)) * math.cos(math.radians(20))
    mirror = ANTENNA - [0, 20, 0]
    assert found.excess_m[0] == pytest.approx(2 * 10 * cosine, abs=1e-3)
    assert found.excess_m[0] == pytest.approx(float((ANTENNA - mirror) @ towards[0]), abs=1e-3)
    expected = compute_reflection(np.array([cosine]), cross_polar_db=10)
    assert found.amplitude[0] == pytest.approx(expected[0], rel=1e-4)
    # Too high: the foot of the reflection would be above the wall.
    above = sky.find_reflections(ANTENNA, make_direction(0, 80), cross_polar_db=10)
    assert above.amplitude[0] == 0.0
    behind = sky.find_reflections(ANTENNA, make_direction(180, 40), cross_polar_db=10)
    assert behind.amplitude[0] == 0.0


def test_walls_turn_polarisation_head_on_and_keep_it_when_grazing() -> None:
    head_on = compute_reflection(np.array([1.0]), cross_polar_db=0.0)
    root = np.sqrt(WALL_PERMITTIVITY)
    smooth = math.exp(-2 * (2 * math.pi * 0.01 / WAVELENGTH_M) ** 2)
    assert head_on[0] == pytest.approx(abs((1 - root) / (1 + root)) * smooth)
    suppressed = compute_reflection(np.array([1.0]), cross_polar_db=20.0)
    assert suppressed[0] == pytest.approx(head_on[0] / 10)
    grazing = compute_reflection(np.array([0.0]), cross_polar_db=20.0)
    assert grazing[0] == pytest.approx(1.0)


def find_multipath(excess_m: float, *, spacing: float = 1.0, speed: float = 0.0) -> float:
    reflected = Reflections(np.array([0.5]), np.array([excess_m]), np.array([[1.0, 0, 0]]))
    code_m, _ = compute_multipath(
        np.array([0.5]),
        reflected,
        np.array([[1.0, 0, 0]]),
        np.array([speed, 0, 0]),
        correlator_chips=spacing,
        loop_hz=1.0,
    )
    return float(code_m[0])


def test_multipath_has_the_envelope_of_its_correlator() -> None:
    """Half a chip times the amplitude at most with a wide one, and none beyond 1.5 chips."""
    whole = math.floor(100 / WAVELENGTH_M)
    out_of_phase, in_phase = whole * WAVELENGTH_M, (whole + 0.5) * WAVELENGTH_M
    assert find_multipath(in_phase) == pytest.approx(0.5 * in_phase / 1.5)
    assert find_multipath(out_of_phase) == pytest.approx(-0.5 * CHIP_M / 2)
    assert find_multipath(in_phase, spacing=0.1) == pytest.approx(0.5 * 0.05 * CHIP_M)
    assert find_multipath(1.51 * CHIP_M) == 0.0
    # At 10 m/s towards the wall, 105 fringes a second pass a loop of one hertz.
    moving = find_multipath(in_phase, speed=10.0)
    assert moving == pytest.approx(find_multipath(in_phase) / 105, rel=0.01)


def test_thermal_noise_is_that_of_the_loops() -> None:
    """45 dB-Hz, one chip, 1 Hz: 1.2 m of code; 15 Hz: a degree and a quarter of carrier."""
    receiver = SatelliteReceiver(correlator_chips=1.0, loop_hz=1.0)
    assert compute_code_noise(np.array([45.0]), receiver)[0] == pytest.approx(1.167, rel=2e-3)
    phase_deg = compute_phase_noise(np.array([45.0]))[0] / WAVELENGTH_M * 360
    assert phase_deg == pytest.approx(1.249, rel=2e-3)
    # At 20 dB-Hz the loop loses a quarter: sqrt(15 / 100 * (1 + 1 / (2 * 0.02 * 100))) rad.
    weak_deg = compute_phase_noise(np.array([20.0]))[0] / WAVELENGTH_M * 360
    assert weak_deg == pytest.approx(24.81, rel=1e-3)


@given(cn0_db_hz=st.floats(15, 55), spacing=st.floats(0.02, 1), loop_hz=st.floats(0.05, 20))
def test_noise_of_the_code_follows_spacing_and_bandwidth(
    cn0_db_hz: float, spacing: float, loop_hz: float
) -> None:
    receiver = SatelliteReceiver(correlator_chips=spacing, loop_hz=loop_hz)
    cn0 = 10 ** (cn0_db_hz / 10)
    # Betz and Kolodziejski (2009): early minus late power, 20 ms of integration, in squared chips.
    variance = loop_hz * spacing / (2 * cn0) + loop_hz * spacing / ((2 - spacing) * 0.02 * cn0**2)
    found_m = compute_code_noise(np.array([cn0_db_hz]), receiver)[0]
    assert found_m == pytest.approx(293.052 * math.sqrt(variance), rel=1e-4)


def make_receiver(
    world: World,
    pose_at: Callable[[float], Matrix] = lambda time_s: pose_matrix((0, 0, 0)),
    **fields: object,
) -> Callable[[int], GnssFix | None]:
    """A receiver by the numbers of its fixes, ten a second."""
    place = ReceiverInPlace(
        SatelliteReceiver.model_validate(fields),
        SkyView(Raycaster(world)),
        ORIGIN,
        pose_at=pose_at,
        key=("test",),
    )

    def measure(number: int) -> GnssFix | None:
        time_s = number / 10
        return place.measure(
            time_s, velocity=np.zeros(3), number=number, step_s=0.1, stamp_s=time_s
        )

    return measure


def find_errors(measure: Callable[[int], GnssFix | None], numbers: range) -> np.ndarray:
    """Errors (n, 3) of fixes at the origin."""
    fixes = [measure(number) for number in numbers]
    return np.array(
        [
            enu_from_geodetic(Geodetic(fix.latitude_deg, fix.longitude_deg, fix.altitude_m), ORIGIN)
            for fix in fixes
            if fix is not None
        ]
    )


def test_errors_in_the_open_are_noise_times_dilution() -> None:
    """With a drop of 0 dB all satellites have the same noise."""
    measure = make_receiver(
        build_flat_world(), signal_error_m=0, atmosphere_m=0, cn0_drop_db=0, cn0_zenith_db_hz=40
    )
    errors = find_errors(measure, range(400))
    first = measure(0)
    assert first is not None
    assert first.quality is not None
    noise_m = compute_code_noise(np.array([40.0]), SatelliteReceiver())[0]
    spread = errors.std(axis=0)
    assert math.hypot(*spread[:2]) == pytest.approx(first.quality.hdop * noise_m, rel=0.07)
    assert spread[2] == pytest.approx(first.quality.vdop * noise_m, rel=0.07)
    assert np.abs(errors.mean(axis=0)).max() < 0.1


def test_a_street_hides_satellites_and_lengthens_ranges() -> None:
    street, field = (
        make_receiver(world) for world in (build_flat_world(*STREET), build_flat_world())
    )
    in_street, in_field = street(50), field(50)
    assert in_street is not None and in_street.quality is not None
    assert in_field is not None and in_field.quality is not None
    assert in_street.quality.visible <= 0.6 * in_field.quality.visible
    assert in_street.quality.satellites > in_street.quality.visible  # some only by reflection
    off = np.linalg.norm(find_errors(street, range(40, 80)), axis=1).mean()
    assert off > 3 * np.linalg.norm(find_errors(field, range(40, 80)), axis=1).mean()


def test_a_tunnel_has_no_fix() -> None:
    roof = build_box((300, 40, 1), (0, 0, 6))
    assert make_receiver(build_flat_world(roof))(0) is None


def test_a_fix_depends_on_its_number_alone() -> None:
    world = build_flat_world(*STREET)
    one, other = make_receiver(world), make_receiver(world)
    before = [one(number) for number in range(5)]
    assert other(4) == before[4] != before[3]


def test_a_fix_takes_the_orbits_once(monkeypatch: pytest.MonkeyPatch) -> None:
    times: list[datetime] = []

    def record(names: Any, time: datetime, origin: Geodetic) -> np.ndarray:
        times.append(time)
        return compute_satellites(names, time, origin)

    monkeypatch.setattr("advercity.sensors.gnss.receiver.compute_satellites", record)
    measure = make_receiver(build_flat_world())
    assert all(measure(number) for number in range(3))
    assert len(times) == len(set(times)) == 3


def drive_out(time_s: float) -> Matrix:
    """In a tunnel for ten seconds, then in the open."""
    return pose_matrix((0.0 if time_s < 10 else 100.0, 0, 0))


def test_corrections_fix_within_centimetres_after_a_while_in_the_open() -> None:
    roof = build_box((60, 40, 1), (0, 0, 6))
    measure = make_receiver(
        build_flat_world(roof), drive_out, corrections="rtk", time_to_fix_s=5, heading_baseline_m=2
    )
    assert measure(99) is None
    fixes = [measure(number) for number in range(100, 180, 5)]
    solutions = [fix.quality.solution for fix in fixes if fix is not None and fix.quality]
    assert solutions[:10] == [GnssSolution.FLOAT] * 10
    assert solutions[11:] == [GnssSolution.FIXED] * 5
    errors = find_errors(measure, range(160, 200)) - [100, 0, 0]
    assert np.abs(errors[:, :2]).max() < 0.03
    floating = find_errors(measure, range(100, 140)) - [100, 0, 0]
    assert 0.03 < np.linalg.norm(floating, axis=1).max() < 1.0


@pytest.mark.parametrize("yaw_deg", np.random.default_rng(7).uniform(-180, 180, 6).round(2))
def test_headings_are_clockwise_from_north(yaw_deg: float) -> None:
    def stand(time_s: float) -> Matrix:
        return pose_matrix((0, 0, 0), yaw=math.radians(yaw_deg))

    fix = make_receiver(build_flat_world(), stand, heading_baseline_m=2.0)(0)
    assert fix is not None
    assert fix.heading_rad is not None
    wanted = math.radians(90.0 - yaw_deg)
    assert abs(math.remainder(fix.heading_rad - wanted, 2 * math.pi)) < 0.01


def test_two_antennas_give_a_heading_as_good_as_their_distance() -> None:
    """East is 90 degrees; twice the distance is half the error."""
    spread: list[float] = []
    for baseline_m in (0.5, 1.0):
        measure = make_receiver(build_flat_world(), heading_baseline_m=baseline_m)
        fixes = [measure(number) for number in range(150)]
        headings = [fix.heading_rad for fix in fixes if fix is not None and fix.heading_rad]
        assert np.mean(headings) == pytest.approx(math.pi / 2, abs=2e-3)
        spread.append(float(np.degrees(np.std(headings))))
    assert spread[0] == pytest.approx(2 * spread[1], rel=0.01)
    assert 0.02 < spread[1] < 0.3


@dataclass(frozen=True)
class EchoingSky(SkyView):
    """A sky that reflects signals from the east, or from everywhere, with one amplitude."""

    amplitude: float
    excess_m: float = 2.0
    blocked: bool = False
    everywhere: bool = True

    def look(
        self, antennas: np.ndarray, directions: np.ndarray
    ) -> tuple[NDArray[np.bool_], np.ndarray]:
        return np.full(len(directions), self.blocked), np.zeros(len(directions))

    def find_reflections(
        self, antenna: np.ndarray, directions: np.ndarray, *, cross_polar_db: float
    ) -> Reflections:
        reflected = self.everywhere | (directions[:, 0] > 0)
        return Reflections(
            np.where(reflected, self.amplitude, 0.0),
            np.full(len(directions), self.excess_m),
            np.tile([1.0, 0.0, 0.0], (len(directions), 1)),
        )


def receive(sky: SkyView, **fields: object) -> GnssFix | None:
    """The first fix of a receiver at rest at the origin."""
    receiver = SatelliteReceiver.model_validate({"cn0_drop_db": 0, "cn0_zenith_db_hz": 45} | fields)
    place = ReceiverInPlace(receiver, sky, ORIGIN, pose_at=lambda time_s: np.eye(4), key=("test",))
    return place.measure(0.0, velocity=np.zeros(3), number=0, step_s=0.1, stamp_s=0.0)


def test_carriers_are_lost_where_a_reflection_has_seven_tenths_of_the_amplitude() -> None:
    for ratio in np.random.default_rng(3).uniform(0.3, 0.99, 12):
        fix = receive(EchoingSky(float(ratio)), corrections="rtk", heading_baseline_m=1.0)
        assert fix is not None and fix.quality is not None
        assert (fix.heading_rad is None) == (ratio >= 0.7)
        assert (fix.quality.solution is GnssSolution.SINGLE) == (ratio >= 0.7)
    for ratio, kept in ((0.695, True), (0.705, False)):
        fix = receive(EchoingSky(ratio), heading_baseline_m=1.0)
        assert fix is not None
        assert (fix.heading_rad is not None) == kept


def test_a_reflection_is_tracked_where_it_is_the_stronger_signal() -> None:
    """Its path is beyond the reach of a correlator that tracks the straight one."""
    for amplitude, is_off in ((0.98, False), (1.02, True)):
        sky = EchoingSky(amplitude, excess_m=600.0, everywhere=False)
        fix = receive(sky, signal_error_m=0, atmosphere_m=0)
        assert fix is not None
        place = Geodetic(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
        assert (np.linalg.norm(enu_from_geodetic(place, ORIGIN)) > 50) == is_off


def test_reflections_alone_are_tracked_down_to_the_limit_of_the_receiver() -> None:
    for limit_db_hz in np.random.default_rng(4).uniform(22, 40, 4):
        weakest = 10 ** ((limit_db_hz - 45) / 20)
        for amplitude, is_tracked in ((weakest * 0.98, False), (weakest * 1.02, True)):
            sky = EchoingSky(float(amplitude), blocked=True)
            fields = {"tracking_db_hz": limit_db_hz, "carrier_db_hz": limit_db_hz}
            assert (receive(sky, **fields) is not None) == is_tracked


def test_walls_reflect_from_satellites_more_than_a_degree_before_their_plane() -> None:
    wall = build_box((2000, 10, 1200), (0, -7, 0))
    sky, antenna = build_sky(wall), np.array([0.0, 0.0, 1.5])
    for cosine, reflects in ((0.018, False), (0.022, True), (0.1, True)):
        level = math.sqrt(1 - cosine**2 - 0.3**2)
        found = sky.find_reflections(antenna, np.array([[level, cosine, 0.3]]), cross_polar_db=10)
        assert (found.amplitude[0] > 0) == reflects
