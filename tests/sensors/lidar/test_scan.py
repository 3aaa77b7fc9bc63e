"""Surfaces that a scan hits: panes, puddles, motion during the scan."""

import math

import numpy as np
import pytest
from advercity_dsl import Lidar

from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.annotation import count_lidar_hits
from advercity.sensors.lidar import (
    ScanHits,
    cast_scan,
)
from advercity.sensors.measurements import PointKind
from advercity.testing import build_box, build_flat_world, make_actor_state, make_frame
from advercity.world import Body
from tests.sensors.lidar.builders import (
    EXACT,
    FORWARD_M,
    MOVING,
    STAND,
    VACUUM,
    WALL_AHEAD,
    frame_with,
    ground,
    measure,
    raycaster_of,
    raycaster_with,
    upright,
    vary,
)


def test_a_pane_lets_most_light_through() -> None:
    glass = upright(5, 5, 4, "glass")
    behind = upright(9, 50, 20, "plaster_white")
    level = vary(EXACT, channels=1, lower_deg=0, upper_deg=1)
    shaded, plain = (
        measure(level, cast_scan(level, STAND, raycaster_of(*walls)), **VACUUM)
        for walls in ((glass, behind), (behind,))
    )
    ahead = [np.flatnonzero(np.abs(found.points[:, 1]) < 1e-3) for found in (shaded, plain)]
    for found, rows in zip((shaded, plain), ahead, strict=True):
        assert found.range_m[rows[0]] == pytest.approx(9.0, abs=2e-3)
    intensity = [
        found.intensity[rows[0]] for found, rows in zip((shaded, plain), ahead, strict=True)
    ]
    assert intensity[0] / intensity[1] == pytest.approx(0.85**2, abs=1e-3)


def test_puddles_hide_the_road_and_mirror_walls() -> None:
    caster = raycaster_of(ground("asphalt"), upright(12, 40, 10))
    scan = cast_scan(EXACT, STAND, caster, puddle_coverage=0.98)
    found = measure(EXACT, scan, surface={"wetness": 1, "puddle_coverage": 0.98})
    ghosts = found.kind == PointKind.GHOST
    assert ghosts.sum() > 100
    assert (found.points[ghosts, 2] < -1.9).all()
    assert (found.semantic[ghosts] == Semantic.WALL).all()
    # Seen through the mirror, the wall goes on below the ground.
    np.testing.assert_allclose(found.points[ghosts, 0], 12.0, atol=5e-3)
    # Fresnel, unpolarised, on the way there and on the way back.
    assert scan.puddle_reflection is not None
    cos_in = STAND[2, 3] / scan.hits.range_m[scan.puddle_rays]
    cos_out = np.sqrt(1.0 - (1.0 - cos_in**2) / 1.328**2)
    across = (cos_in - 1.328 * cos_out) / (cos_in + 1.328 * cos_out)
    along = (1.328 * cos_in - cos_out) / (1.328 * cos_in + cos_out)
    np.testing.assert_allclose(
        scan.puddle_reflection.transmittance, ((across**2 + along**2) / 2.0) ** 2, rtol=0.01
    )
    dry = measure(EXACT, cast_scan(EXACT, STAND, caster))
    left, before = ((one.semantic == Semantic.ROAD).sum() for one in (found, dry))
    assert 0 < left < 0.05 * before


def test_puddles_cover_the_fraction_that_is_asked_for() -> None:
    scan = cast_scan(Lidar(), STAND, raycaster_of(ground("asphalt")), puddle_coverage=0.35)
    road = (scan.hits.semantic == Semantic.ROAD).sum()
    assert len(scan.puddle_rays) / road == pytest.approx(0.35, abs=0.1)


def test_beams_are_counted_by_actor_whatever_the_weather() -> None:
    caster = raycaster_with((10.0, 0.0), (20.0, 30.0), (30.0, 0.0))
    scan = cast_scan(Lidar(), STAND, caster)
    counts = count_lidar_hits(scan, Lidar())
    assert set(counts) == {1, 2}
    assert counts[1] == (scan.hits.instance == 1).sum() > counts[2] > 0
    fine = vary(Lidar(), sub_rays=7)
    assert count_lidar_hits(cast_scan(fine, STAND, caster), fine) == counts


@pytest.mark.parametrize(("panes", "expected"), [(0, {1}), (2, {1}), (3, set[int]())])
def test_an_actor_behind_two_panes_of_glass_is_counted(panes: int, expected: set[int]) -> None:
    glass = [upright(4.0 + 0.1 * pane, 50, 20, "glass") for pane in range(panes)]
    counts = count_lidar_hits(
        cast_scan(Lidar(), STAND, raycaster_with((10.0, 0.0), walls=glass)), Lidar()
    )
    assert set(counts) == expected


def test_a_beam_through_a_car_counts_once() -> None:
    """A box of glass returns from its near and its far side."""
    car = build_box((4.0, 2.0, 1.5), (0.0, 0.0, 0.75), material="glass", semantic=Semantic.VEHICLE)
    caster = Raycaster(build_flat_world(bodies={"car": Body((car,), (4.0, 2.0, 1.5))}))
    caster.place(make_frame(make_actor_state(1, 10.0)))
    scan = cast_scan(Lidar(), STAND, caster)
    both = (scan.hits.instance == 1).sum() + (scan.behind_glass[0].hits.instance == 1).sum()
    assert count_lidar_hits(scan, Lidar())[1] == (scan.hits.instance == 1).sum() < both


def scan_between(before: Matrix, now: Matrix, *walls: Mesh) -> ScanHits:
    return cast_scan(MOVING, now, raycaster_of(*walls), previous_world_from_lidar=before)


def test_a_wall_ahead_breaks_where_the_scan_of_a_driving_lidar_ends() -> None:
    scan = scan_between(pose_matrix((-FORWARD_M, 0, 1.9)), STAND, WALL_AHEAD)
    found = measure(MOVING, scan)
    ahead = np.flatnonzero(np.abs(found.raw[:, 1]) < 0.1)
    first, last = found.raw[ahead[0], 0], found.raw[ahead[-1], 0]
    assert first - last == pytest.approx(1.11, rel=0.01)
    assert found.time_s[ahead[0]] == pytest.approx(-0.1, abs=1e-3)
    assert found.time_s[ahead[-1]] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(found.points[:, 0], 20.0, atol=0.02)


def test_compensation_makes_a_wall_flat_after_a_turn() -> None:
    before = pose_matrix((-FORWARD_M, 0.05, 1.9), yaw=-math.radians(2), pitch=0.01)
    found = measure(MOVING, scan_between(before, STAND, WALL_AHEAD))
    near = np.linalg.norm(found.points, axis=1) < 100
    assert np.ptp(found.raw[near, 0]) > 1.0
    np.testing.assert_allclose(found.points[near, 0], 20.0, atol=0.02)


def test_a_rotating_vehicle_shifts_distant_points() -> None:
    scan = scan_between(
        pose_matrix((0, 0, 1.9), yaw=-math.radians(2)), STAND, upright(50.0, 400, 60)
    )
    found = measure(MOVING, scan)
    first = np.flatnonzero((found.time_s == found.time_s.min()) & (found.ring == 0))[0]
    shift = found.points[first] - found.raw[first]
    assert np.linalg.norm(shift) == pytest.approx(50 * math.radians(2), rel=0.02)


def test_a_moving_car_is_where_it_was_when_the_beam_hit_it() -> None:
    caster = raycaster_of()
    caster.place(frame_with((-20.0, 8.0)), previous_frame=frame_with((-20.0, 0.0)))
    found = measure(MOVING, cast_scan(MOVING, STAND, caster))
    # Straight behind, half the turn is over, and so is half of its way.
    middle = (found.points[:, 1].min() + found.points[:, 1].max()) / 2
    assert middle == pytest.approx(8.0 * (math.pi + math.atan2(-4, 20)) / (2 * math.pi), abs=0.25)
    np.testing.assert_allclose(found.points[:, 0], -20.0, atol=1e-3)


def test_without_motion_distortion_a_scan_is_instantaneous() -> None:
    lidar = vary(MOVING, motion_distortion=False)
    caster = raycaster_of(WALL_AHEAD)
    found = measure(
        lidar,
        cast_scan(
            lidar, STAND, caster, previous_world_from_lidar=pose_matrix((-FORWARD_M, 0, 1.9))
        ),
    )
    np.testing.assert_allclose(found.raw[:, 0], 20.0, atol=1e-3)
