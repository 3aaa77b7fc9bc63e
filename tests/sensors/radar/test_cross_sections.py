"""Radar cross-sections of bodies with known ones, and of road users."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import ActorClass

from advercity.assets.bodies import build_body
from advercity.geometry.poses import pose_matrix
from advercity.physics.microwaves import WAVELENGTH_M
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar import SceneMotion, trace_paths
from advercity.testing import load_example_spec, make_actor_state, make_frame
from advercity.world import Body, World
from tests.sensors.radar.builders import (
    NARROW,
    WIDE,
    place,
    plate,
    rows_of,
    scan,
    sphere,
    strongest_dbsm,
    trihedral,
    vary,
)


def decibels(value: float) -> float:
    return 10 * math.log10(value)


def test_a_trihedral_corner_returns_what_its_formula_says() -> None:
    expected = decibels(4 * math.pi * 0.3**4 / (3 * WAVELENGTH_M**2))
    assert expected == pytest.approx(33.5, abs=0.1)
    found = scan(NARROW, trihedral(0.3, 50)).detections
    assert strongest_dbsm(found) == pytest.approx(expected, abs=1.0)
    # The corner's place and speed, too.
    row = int(found.snr_db.argmax())
    assert found.points[row] == pytest.approx([50, 0, 0], abs=0.15)
    assert found.velocity_m_s[row] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(("edge_m", "range_m"), [(0.3, 100), (1.0, 400)])
def test_a_plate_returns_its_peak_at_normal_incidence(edge_m: float, range_m: float) -> None:
    # At 400 m a plate of 1 m is at 0.8 of its far-field distance, which costs it some decibels.
    radar = vary(NARROW, azimuth_fov_deg=1, elevation_fov_deg=1, range_m=450)
    expected = decibels(4 * math.pi * edge_m**4 / WAVELENGTH_M**2)
    found = scan(radar, plate(edge_m, range_m)).detections
    assert strongest_dbsm(found) == pytest.approx(expected, abs=1.5)


@pytest.mark.parametrize("lobe", [1, 2, 3])
def test_a_tilted_plate_returns_as_much_less_as_the_sinc_says(lobe: int) -> None:
    radar = vary(NARROW, azimuth_fov_deg=1, elevation_fov_deg=1)
    upright = strongest_dbsm(scan(radar, plate(0.3, 100)).detections)
    # Twice the wave number times half the edge: the middle of a side lobe.
    phase = (lobe + 0.5) * math.pi
    tilt_rad = math.asin(phase * WAVELENGTH_M / (2 * math.pi * 0.3))
    found = strongest_dbsm(scan(radar, plate(0.3, 100, tilt_rad)).detections) - upright
    assert found == pytest.approx(-2 * decibels(phase), abs=1.5)


def test_a_plate_tilted_by_5_deg_returns_as_little_as_far_lobes_do() -> None:
    # The 7 mm between rays at its edges are two wavelengths of path there: the limit of the model.
    radar = vary(NARROW, azimuth_fov_deg=1, elevation_fov_deg=1)
    upright = strongest_dbsm(scan(radar, plate(0.3, 100)).detections)
    phase = 2 * math.pi / WAVELENGTH_M * 0.3 * math.sin(math.radians(5))
    found = strongest_dbsm(scan(radar, plate(0.3, 100, math.radians(5))).detections) - upright
    assert found < -2 * decibels(phase) + 3


@pytest.mark.parametrize(("material", "opening_rad"), [("sign_blue", 0.6), ("car_paint_red", 1.6)])
def test_a_sphere_returns_the_area_of_its_disc(material: str, opening_rad: float) -> None:
    target = sphere(0.5, 30, material, opening_rad)
    # A rough one fluctuates.
    found = [strongest_dbsm(scan(NARROW, target, key=key).detections) for key in range(8)]
    mean = sum(10 ** (value / 10) for value in found) / len(found)
    assert decibels(mean) == pytest.approx(decibels(math.pi / 4), abs=1.5)


@cache
def load_body(name: str) -> Body:
    return build_body(name, load_example_spec().blueprints[name])


def mean_dbsm(name: str, actor_class: ActorClass, aspects: int = 120) -> float:
    """Mean cross-section over all horizontal aspects, at 40 m without a road.

    Panes and discs flash within a few degrees, so few aspects miss most of it.
    """
    radar = vary(NARROW, azimuth_fov_deg=16, elevation_fov_deg=8, azimuth_cell_deg=16, rays=20_000)
    body, total = load_body(name), 0.0
    caster = Raycaster(World("test", (), {name: body}, lanes=(), network=Path("none")))
    for aspect in range(aspects):
        state = make_actor_state(
            *(7, 40.0),
            yaw_rad=math.radians(3 + aspect * 360 / aspects),
            actor_class=actor_class,
            blueprint=name,
            paint="cloth_grey" if actor_class == "pedestrian" else "car_paint_red",
            size=body.size,
        )
        frame = make_frame(replace(state, travelled_m=0.3 * aspect))
        caster.place(frame)
        placed = place(radar, pose_matrix((0, 0, 0.8)))
        paths = trace_paths(placed, caster, SceneMotion(frame, {name: body})).paths
        total += float(paths.strength.sum()) + abs(paths.field.sum()) ** 2
    gain = 30_000 / (16 * 8)
    return decibels(total / aspects / gain**2 * 40**4)


@pytest.mark.parametrize(
    ("name", "actor_class", "least_dbsm", "most_dbsm"),
    [
        ("seat_leon", "car", 5, 20),
        ("vespa_zx125", "motorcycle", -1, 8),
        ("yamaha_yzf", "motorcycle", 0, 8),
        ("gazelle_omafiets", "bicycle", -5, 0),
        ("pedestrian_0001", "pedestrian", -10, -5),
    ],
)
def test_road_users_have_cross_sections_as_measured(
    name: str, actor_class: ActorClass, least_dbsm: float, most_dbsm: float
) -> None:
    assert least_dbsm <= mean_dbsm(name, actor_class) <= most_dbsm


@pytest.mark.parametrize("range_m", [30, 60, 100, 145])
def test_a_small_corner_is_found_wherever_it_stands_in_range(range_m: int) -> None:
    """Of 33.5 dBsm; its opening of 0.4 m is less than the distance of even rays at 100 m."""
    corner, found_dbsm = trihedral(0.3, 0), list[float]()
    mesh = replace(corner, vertices=corner.vertices + np.array([0, 0, 0.6], np.float32))
    for left_m in (-7.0, -3.3, 1.7, 9.2):
        state = make_actor_state(
            *(7, range_m, left_m), yaw_rad=math.atan2(left_m, range_m), size=(0.5, 0.5, 1.0)
        )
        bodies = {state.actor.blueprint: Body((mesh,), state.actor.size)}
        found = scan(WIDE, frame=make_frame(state), bodies=bodies, pose=pose_matrix((0, 0, 0.6)))
        own = rows_of(found.detections, 7)
        assert len(own)
        found_dbsm.append(float(found.detections.rcs_dbsm[own].max()))
    assert found_dbsm == pytest.approx([33.5] * 4, abs=1)


@pytest.mark.parametrize("range_m", [60, 100])
def test_a_small_corner_on_a_pole_is_found_wherever_it_stands(range_m: int) -> None:
    """Static things have no id, so it is found by its place."""
    for left_m in (-7.0, -3.3, 1.7, 9.2):
        mesh = replace(trihedral(0.3, range_m, left_m), semantic=Semantic.POLE)
        found = scan(WIDE, mesh).detections
        at = np.linalg.norm(found.points - [range_m, left_m, 0], axis=1) < 2.5
        assert (at & (found.kind == PointKind.SURFACE)).any()
