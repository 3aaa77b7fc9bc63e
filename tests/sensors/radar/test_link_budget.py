"""The radar equation and its cells, by numbers computed by hand for the default radar."""

import math
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Mount

from advercity.frames import ActorState
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar import PlacedRadar
from advercity.sensors.radar.antenna import (
    compute_echo_factor,
    compute_gain,
    compute_noise_w_hz,
    compute_range_cell_m,
    is_in_view,
)
from advercity.sensors.radar.cells import CellGrid
from advercity.sensors.radar.cfar import (
    compute_alarm_chance,
    compute_threshold,
    estimate_noise,
    list_window_steps,
)
from advercity.sensors.radar.clutter import FallingClutter
from advercity.sensors.radar.conditions import FallingEcho, RadarConditions
from advercity.sensors.radar.rays import RayFan, aim_rays, build_ray_fan
from advercity.testing import CAR, build_box, make_actor_state, make_frame
from advercity.world import World
from tests.sensors.radar.builders import WIDE, place, vary

AHEAD = np.array([[1.0, 0.0, 0.0]])
CELL_M = 299_792_458 / 750e6
"""Of 375 MHz: 0.4 m."""
PEAK_GAIN = 30_000 / (120 * 30)


def towards(azimuth_deg: float, elevation_deg: float) -> Float64Array:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return np.array([[level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]])


def test_the_gain_halves_towards_each_edge_of_the_field_of_view() -> None:
    directions = np.concatenate([AHEAD, towards(60, 0), towards(0, 15), towards(-60, -15)])
    expected = PEAK_GAIN * np.array([1, 1 / 2, 1 / 2, 1 / 4])
    np.testing.assert_allclose(compute_gain(WIDE, directions), expected)
    edges = np.concatenate([towards(59.9, 0), towards(60.1, 0), towards(0, 14.9), towards(0, 15.1)])
    assert is_in_view(WIDE, edges).tolist() == [True, False, True, False]


def test_rays_cover_the_field_of_view_evenly() -> None:
    """60,000 rays over 120 by 30 degrees: 490 columns and 122 rows; 2.07 sr together."""
    fan = build_ray_fan(WIDE)
    assert len(fan.directions) == 490 * 122
    across = math.radians(120) * 2 * math.sin(math.radians(15))
    assert float(fan.solid_angle_sr.sum(dtype=float)) == pytest.approx(across, rel=1e-4)
    azimuth = np.degrees(np.arctan2(fan.directions[:, 1], fan.directions[:, 0]))
    elevation = np.degrees(np.arcsin(fan.directions[:, 2]))
    assert (azimuth.min(), azimuth.max()) == pytest.approx((-59.878, 59.878), abs=1e-3)
    assert (elevation.min(), elevation.max()) == pytest.approx((-14.877, 14.877), abs=1e-3)
    assert azimuth[0] < azimuth[1]
    assert elevation[0] < elevation[490]


def aim(placed: PlacedRadar, *states: ActorState, wall: tuple[Mesh, ...] = ()) -> RayFan:
    caster = Raycaster(World("test", wall, {"car": CAR}, lanes=(), network=Path("none")))
    caster.place(make_frame(*states))
    return aim_rays(placed, caster, states)


def test_no_rays_are_spent_on_road_users_behind_a_wall() -> None:
    placed, car = place(WIDE, pose_matrix((0, 0, 0.6))), make_actor_state(1, 80.0, 0.0)
    wall = (build_box((0.2, 20, 5), (40, 0, 0)),)
    even = len(build_ray_fan(WIDE).directions)
    assert len(aim(placed, car, wall=wall).directions) == even < len(aim(placed, car).directions)


@pytest.mark.parametrize("yaw_deg", [-170, -45, 0, 30, 180])
def test_rays_on_road_users_are_closer_and_cover_the_same_angle(yaw_deg: float) -> None:
    """A car of 4.5 by 1.5 m at 80 m has rays at 0.1 m, where even ones are 0.34 m apart."""
    placed = place(WIDE, pose_matrix((5, -3, 0.6), yaw=math.radians(yaw_deg)))
    away = math.radians(yaw_deg) + np.array([-0.3, 0.9])
    states = [
        make_actor_state(number, 5 + 80 * math.cos(angle), -3 + 80 * math.sin(angle))
        for number, angle in enumerate(away, start=1)
    ]
    even, aimed = build_ray_fan(WIDE), aim(placed, *states)
    assert float(aimed.solid_angle_sr.sum(dtype=float)) == pytest.approx(
        float(even.solid_angle_sr.sum(dtype=float)), rel=1e-5
    )
    for angle in (-0.3, 0.9):
        ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
        near = np.flatnonzero(aimed.directions @ ahead > math.cos(0.5 / 80))
        assert len(near) == pytest.approx(math.pi * 0.5**2 / 0.09**2, rel=0.3)
    behind = make_actor_state(
        3, 5 - 80 * math.cos(math.radians(yaw_deg)), -3 - 80 * math.sin(math.radians(yaw_deg))
    )
    assert len(aim(placed, behind).directions) == len(even.directions)


def test_the_range_cell_is_that_of_the_bandwidth() -> None:
    assert compute_range_cell_m(WIDE) == pytest.approx(CELL_M)


def test_the_noise_is_that_of_290_kelvin_and_the_noise_figure() -> None:
    assert compute_noise_w_hz(WIDE) == pytest.approx(1.380649e-23 * 290 * 10**1.2)


def test_an_echo_has_the_power_of_the_radar_equation() -> None:
    """12 dBm for the 13 ms that resolve 0.15 m/s, 16 receivers, 12 dB of losses."""
    wavelength_m = 299_792_458 / 77e9
    energy_j = 10**-1.8 * wavelength_m / 0.3 * 16
    factor = energy_j * wavelength_m**2 / (4 * math.pi) ** 3 / 10**1.2
    assert compute_echo_factor(WIDE) == pytest.approx(factor / compute_noise_w_hz(WIDE))
    # 3.29 mJ times 7.64e-9 over 15.8 and 6.35e-20 W/Hz: a car of 10 m² at 100 m is 173 times noise.
    snr = compute_echo_factor(WIDE) * PEAK_GAIN**2 * 10 / 100**4
    assert snr == pytest.approx(173.5, rel=2e-3)


def test_what_falls_fills_the_volume_of_a_cell() -> None:
    """1e-3 m² per m³ over 1.5 by 2 degrees and 0.4 m, 50 m away."""
    echo = FallingEcho(PointKind.RAIN, 1e-3, np.array([0.0, 0.0, -6.0]))
    clutter = FallingClutter(WIDE, echo, np.array([-10.0, 0.0, -6.0]))
    solid_angle = math.radians(1.5) * math.radians(2)
    expected = PEAK_GAIN**2 * 1e-3 * solid_angle * CELL_M / 50**2
    found = clutter.compute_strength(np.array([50.0]), AHEAD)
    assert found == pytest.approx(np.array([expected]))
    above = clutter.compute_strength(np.array([50.0]), towards(0, 15))
    assert above / found == pytest.approx(np.array([math.cos(math.radians(15)) / 4]))
    # 0.15 m/s of velocities that deviate by 1 m/s.
    peak = 0.15 / math.sqrt(2 * math.pi)
    for rate_m_s, density in ((-10.0, 1.0), (-9.0, math.exp(-0.5)), (-12.0, math.exp(-2.0))):
        part = clutter.compute_fraction(AHEAD, np.array([rate_m_s]))
        assert part == pytest.approx(np.array([peak * density]))
    wide = FallingClutter(vary(WIDE, speed_cell_m_s=5), echo, np.zeros(3))
    assert wide.compute_fraction(AHEAD, np.zeros(1)) == pytest.approx(np.ones(1))


def test_the_cells_are_those_of_the_declaration() -> None:
    grid = CellGrid.from_radar(WIDE)
    assert grid.counts == (400, 80, 15, 376)
    assert grid.size == 400 * 80 * 15 * 376
    numbers = grid.locate(
        np.array([0.1, 100.0, 149.99]),
        np.array([-29.99, 0.01, 29.99]),
        np.concatenate([towards(-59.9, -14.9), towards(0.1, 1.1), towards(59.9, 14.9)]),
    )
    assert numbers.T.tolist() == [[0, 0, 0, 0], [200, 40, 8, 250], [399, 79, 14, 375]]
    np.testing.assert_allclose(grid.fold(np.array([31.0, -31.0, 59.0, 29.0])), [-29, 29, -1, 29])
    # Keys of neighbours differ by one cell of one axis.
    (key,) = grid.encode(numbers[:, 1:2])
    expected = {
        grid.encode((numbers[:, 1] + step * axis)[:, None])[0]
        for axis in np.eye(4, dtype=np.int64)
        for step in (-1, 1)
    }
    assert set(grid.list_neighbours(np.array([key]))[0].tolist()) == expected


def test_the_middles_of_free_cells_are_listed_beam_by_beam() -> None:
    grid = CellGrid.from_radar(WIDE)
    free_m = np.zeros((80, 15))
    free_m[0, 0], free_m[79, 14] = 0.9, 0.7
    directions, range_m = grid.list_volume(free_m)
    np.testing.assert_allclose(range_m, np.array([0.5, 1.5, 0.5, 1.5]) * CELL_M)
    low, high = towards(-59.25, -14), towards(59.25, 14)
    np.testing.assert_allclose(directions, np.concatenate([low, low, high, high]))


def test_noise_is_estimated_from_16_cells_on_each_side_beyond_two() -> None:
    steps = list_window_steps().tolist()
    assert sorted(steps) == [*range(-18, -2), *range(3, 19)]
    assert compute_threshold(WIDE) == pytest.approx(10**1.3)
    # The mean of 32 cells of noise: (1 + t / 32)^-32.
    assert compute_alarm_chance(10**1.3) == pytest.approx((1 + 10**1.3 / 32) ** -32)
    window = np.arange(1.0, 33.0)[None]
    assert estimate_noise(WIDE, window) == pytest.approx(np.array([16.5]))
    # The 24th of 32, whose mean is 1/32 + 1/31 + ... + 1/9 of that of the noise.
    rank_mean = sum(1 / count for count in range(9, 33))
    ordered = estimate_noise(vary(WIDE, detector="os"), window)
    assert ordered == pytest.approx(np.array([24 / rank_mean]))


@pytest.mark.parametrize(
    ("yaw_deg", "expected_db"),
    [(0, 1.0), (44, 1.0), (-46, 2.0), (90, 2.0), (134, 2.0), (136, 3.0), (180, 3.0), (-316, 1.0)],
)
def test_a_radome_is_covered_as_its_side_of_the_vehicle(yaw_deg: float, expected_db: float) -> None:
    conditions = RadarConditions(radome_db=(1.0, 2.0, 3.0))
    assert conditions.select_radome_db(Mount(yaw_deg=yaw_deg)) == expected_db
