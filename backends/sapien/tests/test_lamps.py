"""Lamps of streets, vehicles and signals, with both shader packs."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend

from advercity.frames import Lamp, Signal
from advercity.geometry.poses import pose_matrix
from advercity.physics.extinction import extinction_from_mor
from advercity.physics.lamp_beams import intensity_towards
from advercity.physics.scattering import PhaseLobes
from advercity.rendering.backend import RenderProfile
from advercity.rendering.fog_beams import compute_fog_beams
from advercity.rendering.light_sources import list_light_sources
from advercity.semantics import Semantic
from advercity.world import Body, SignalLamp, StreetLamp
from tests.box_scenes import (
    Floats,
    Open,
    air_of,
    centre,
    frame_of,
    luminance,
    state,
    uniform,
    view_of,
    world_of,
)
from tests.lamp_glow import integrate_street_glow
from tests.render_builders import (
    LUMINANCE,
    build_box,
)

pytestmark = [pytest.mark.render, pytest.mark.usefixtures("ideal_surfaces")]


def test_beams_in_fog_have_no_pattern_of_their_samples() -> None:
    air, profile = air_of(mor_m=60.0, night=True), RenderProfile("test", 1.0, "raster")
    with SapienBackend().open(world_of(), air, profile) as renderer:
        renderer.place(frame_of(state(1, (0.0, 0.0, 0.0), lamps=Lamp.LOW_BEAM)))
        aside = pose_matrix((14.0, -12.0, 2.0), yaw=np.pi / 2, pitch=0.1)
        seen = luminance(renderer.render_camera(view_of(aside, size=(320, 240))))
    middle, beside = seen[1:-1, 1:-1], (seen[1:-1, :-2] + seen[1:-1, 2:]) / 2.0
    bright = beside > 0.1 * seen.max()
    assert bright.sum() > 200
    assert np.median(np.abs(middle / beside - 1.0)[bright]) < 0.01


def test_light_of_a_thin_bar_that_fog_deflects_is_even_along_it_and_all_there() -> None:
    """A slanting bar beside a wall of the same light, each minus the light of a black one."""
    air, profile = air_of(mor_m=60.0, night=True), RenderProfile("test", 1.0, "raster")
    lamp, distance, width = StreetLamp((0.0, 0.0, 20.0), flux_lm=1e5), 20.0, 0.25

    def render(height: float, material: str) -> Floats:
        thing = build_box((distance + 0.5, 0.0, 0.0), (1.0, 80.0, height), material)
        with SapienBackend().open(world_of(thing, street_lamps=(lamp,)), air, profile) as renderer:
            renderer.place(frame_of())
            slanting = pose_matrix((0.0, 0.0, 0.0), roll=0.2)
            return luminance(renderer.render_camera(view_of(slanting, size=(240, 160))))

    wall, bar = (render(height, "white") - render(height, "black") for height in (60.0, width))
    lobes = PhaseLobes.from_diameter_um(12.0)
    depth = lobes.narrow_fraction * extinction_from_mor(60.0) * distance
    spread = float(lobes.forward_spread_rad(np.array(depth)))
    # Light of a line deflected to an angle beside it: the integral of the Cauchy
    # distributions of all places of the path, along the line.
    row, column = np.indices(bar.shape) - np.array([79.5, 119.5])[:, None, None]
    beside = np.abs(row * np.cos(0.2) + column * np.sin(0.2)) / 120.0
    along = np.hypot(row, column) < 50.0
    for low in (0.03, 0.05, 0.07):
        ring = along & (beside > low) & (beside < low + 0.02)
        part = np.log1p((spread / beside[ring]) ** 2) / (2.0 * np.pi * spread)
        expected = -np.expm1(-depth) * width / distance * wall[ring] * part
        assert bar[ring].mean() == pytest.approx(expected.mean(), rel=0.25)
        assert np.std(bar[ring] / expected) < 0.25


def test_a_street_lamp_gives_the_illuminance_of_its_flux(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    lamp = StreetLamp((0.0, 0.0, 8.0), flux_lm=8000.0)
    world = world_of(ground, street_lamps=(lamp,))
    with opened(world, air_of(night=True)) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(
            view_of(pose_matrix((0, 0, 5), pitch=np.pi / 2), size=(21, 21))
        )
    expected = 8000.0 / np.pi / 8.0**2 / np.pi
    assert centre(luminance(capture)) == pytest.approx(expected, rel=0.02)


def test_forty_lamps_over_one_spot_give_the_sum_of_their_light(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    around = [
        (2.0 * np.cos(turn), 2.0 * np.sin(turn), 8.0) for turn in 2 * np.pi / 40 * np.arange(40)
    ]
    lamps = tuple(StreetLamp(position, flux_lm=500.0) for position in around)
    with opened(world_of(ground, street_lamps=lamps), air_of(night=True), samples=16) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(
            view_of(pose_matrix((0, 0, 5), pitch=np.pi / 2), size=(21, 21))
        )
    # A Lambertian lamp gives flux / pi times both cosines, 8 m / d, over d².
    each_lx = 500.0 / np.pi * 8.0**2 / (8.0**2 + 2.0**2) ** 2
    assert centre(luminance(capture)) == pytest.approx(40 * each_lx / np.pi, rel=0.02)


def test_low_beams_light_the_road_ahead_by_night_only(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white", Semantic.ROAD)
    seen: dict[tuple[bool, Lamp], Floats] = {}
    for night in (False, True):
        with opened(world_of(ground), air_of(night=night)) as renderer:
            for lamps in (Lamp(0), Lamp.LOW_BEAM):
                renderer.place(frame_of(state(1, (0.0, 0.0, 0.0), lamps=lamps)))
                above = pose_matrix((0.0, 0.0, 40.0), pitch=np.pi / 2)
                capture = renderer.render_camera(view_of(above, size=(80, 80)))
                # Tail lamps are lit as well, but have no blue.
                seen[night, lamps] = capture.radiance[..., 2]
    assert seen[True, Lamp(0)].max() == seen[False, Lamp.LOW_BEAM].max() == 0.0
    lit = seen[True, Lamp.LOW_BEAM]
    # At 1 m a pixel, rows run against x: the road at 16 m gets 40 kcd/d² times z/d, a third blue.
    assert lit[24, 40] == pytest.approx(0.33 * 40e3 * 0.65 / 15.0**3 / np.pi, rel=0.4)
    assert lit[50, 40] == 0.0


def test_the_road_right_before_a_vehicle_is_lit_at_any_position(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (2000.0, 200.0, 1.0), "white")
    far_away = state(2, (-700.0, 0.0, 0.0), lamps=Lamp.LOW_BEAM, yaw=np.pi)
    seen: list[Floats] = []
    with opened(world_of(ground), air_of(night=True)) as renderer:
        for x in np.arange(0.0, 30.0, 6.0):
            renderer.place(frame_of(far_away, state(1, (x, 0.0, 0.0), lamps=Lamp.LOW_BEAM)))
            view = view_of(pose_matrix((x, 0.0, 1.5), pitch=0.6), size=(64, 48), hide=1)
            seen.append(renderer.render_camera(view).radiance[..., 2])
    assert seen[0].min() < 0.1 * seen[0].max()
    for other in seen[1:]:
        np.testing.assert_allclose(other, seen[0], rtol=0.05, atol=0.01 * seen[0].max())


def test_a_wall_beside_the_road_gets_the_light_of_beams_that_the_road_reflects(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In clear air, by the table of the raster pack as by paths; straight it gets a tenth of it."""
    of_grey = partial(compute_fog_beams, ground_albedo=0.5)
    road = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "grey", Semantic.ROAD)
    wall = build_box((16.0, 7.0, 2.0), (20.0, 1.0, 4.0), "white", Semantic.BUILDING)
    view = view_of(pose_matrix((14.0, 0.0, 1.5), yaw=np.pi / 2), size=(32, 24))
    frame = frame_of(state(1, (0.0, 0.0, 0.0), lamps=Lamp.LOW_BEAM))

    def light_of_wall(pack: Literal["raster", "ray_traced"]) -> Floats:
        profile = RenderProfile("test", 1.0, pack, samples=128, path_depth=2)
        with SapienBackend().open(world_of(road, wall), air_of(night=True), profile) as renderer:
            renderer.place(frame)
            # Blue: tail lamps have none.
            return renderer.render_camera(view).radiance[8:12, 8:24, 2]

    monkeypatch.setattr("advercity_sapien.renderer.compute_fog_beams", of_grey)
    lit, traced = light_of_wall("raster"), light_of_wall("ray_traced")
    # Two harmonics of its directions give a wall along the road a sixth less.
    assert lit.mean() == pytest.approx(traced.mean(), rel=0.2)


@pytest.mark.parametrize("is_left_hand", [False, True], ids=["right-hand", "left-hand"])
@pytest.mark.parametrize(
    ("lamps", "led"),
    [(Lamp.LOW_BEAM, False), (Lamp.LOW_BEAM, True), (Lamp.FOG, False), (Lamp.HIGH_BEAM, False)],
)
def test_beams_have_the_pattern_that_sensors_know(
    opened: Open, lamps: Lamp, led: bool, is_left_hand: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a wall 10 m ahead, at the height of the lamps and below, without a road."""
    no_road = partial(compute_fog_beams, ground_albedo=0.0)
    monkeypatch.setattr("advercity_sapien.renderer.compute_fog_beams", no_road)
    wall = world_of(build_box((11.5, 0.0, 0.0), (1.0, 30.0, 4.0), "white"))
    wall = replace(wall, is_left_hand=is_left_hand)
    frame = frame_of(replace(state(1, (0.0, 0.0, 0.0), lamps=lamps), has_led_headlamps=led))
    view = view_of(pose_matrix((1.0, 0.0, 0.7)), size=(180, 180))
    with opened(wall, air_of(night=True)) as renderer:
        renderer.place(frame)
        capture = renderer.render_camera(replace(view, hide=frozenset({1})))
    row, column = np.mgrid[90:100, 15:165]
    at = np.stack([np.full(row.shape, 11.0), (90 - column - 0.5) / 9.0, 0.7 - (row - 89.5) / 9.0])
    expected = np.zeros(row.shape)
    for lamp in list_light_sources(wall, frame):
        away = np.moveaxis(at, 0, -1) - lamp.position
        distance = np.linalg.norm(away, axis=-1)
        intensity = intensity_towards([lamp], (away / distance[..., None]).reshape(1, -1, 3))
        lux = intensity.reshape(row.shape) * away[..., 0] / distance**3
        expected += lux * np.dot(lamp.colour, LUMINANCE) / np.pi
    found = luminance(capture)[90:100, 15:165]
    np.testing.assert_allclose(found.mean(axis=1), expected.mean(axis=1), rtol=0.02)
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=0.02, atol=0.1)


@pytest.mark.parametrize("led", [False, True])
def test_low_beams_leave_dark_what_is_beside_them(opened: Open, led: bool) -> None:
    wall = world_of(build_box((0.0, -4.0, 0.0), (40.0, 1.0, 8.0), "white"))
    frame = frame_of(replace(state(1, (0.0, 0.0, 0.0), lamps=Lamp.LOW_BEAM), has_led_headlamps=led))
    (front, *_) = list_light_sources(wall, frame)
    beside = pose_matrix((front.position[0], 0.0, 0.7), yaw=-np.pi / 2)
    with opened(wall, air_of(night=True)) as renderer:
        renderer.place(frame)
        seen = renderer.render_camera(view_of(beside, size=(80, 40), hide=1))
    # 58 degrees or more off the axis is hardly any of the peak; 0.2 of it gives 100 cd/m².
    assert luminance(seen)[:, 20:60].max() < 2.0


def test_a_lamp_in_fog_wears_the_halo_of_its_droplets(opened: Open) -> None:
    lamp = StreetLamp((0.0, 0.0, 30.0), flux_lm=1000.0 * np.pi)
    air = air_of(mor_m=100.0, night=True)
    with opened(world_of(street_lamps=(lamp,)), air) as renderer:
        renderer.place(frame_of())
        up = pose_matrix((0, 0, 0), pitch=-np.pi / 2)
        seen = luminance(renderer.render_camera(view_of(up, size=(801, 801))))
    row, column = np.indices(seen.shape) - 400
    angle_deg = np.degrees(np.arctan(np.hypot(row, column) / 400))
    rings = [seen[np.abs(angle_deg - at) < 0.07].mean() for at in (2.0, 5.0)]
    # By the path tracer of `benchmarks/night_fog.py`, without a road; single scattering: 6.0, 1.1.
    assert rings == pytest.approx([9.56, 1.93], rel=0.1)


def test_a_street_lamp_glows_in_clear_air_as_far_as_the_dark_sky_shows_it(opened: Open) -> None:
    lamp, eye = (0.0, 0.0, 8.0), np.array([-16.0, 0.0, 2.0])
    # Air without end would be a hundred times as bright as this sky, but there is little of it.
    sky, airlight = 0.02, (3.0, 2.0, 1.0)
    air = air_of(mor_m=20_000.0, sky=lambda sine: 0.0 * sine + sky, airlight=airlight, night=True)
    world = world_of(street_lamps=(StreetLamp(lamp, flux_lm=8000.0),))
    view = view_of(pose_matrix(tuple(eye)), size=(161, 121))
    with opened(world, air) as renderer:
        renderer.place(frame_of())
        glow = luminance(renderer.render_camera(view)) - sky
    row, column = (index.ravel() for index in np.mgrid[4:60:8, 4:160:8])
    rays = np.stack([np.full(row.shape, 80.5), 80.0 - column, 60.0 - row], axis=1)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    extinction = air.extinction.at_550nm
    expected = integrate_street_glow(lamp, 8000.0 / np.pi, extinction, eye, rays)
    off_deg = np.degrees(np.arccos(rays @ ([0.0, 0.0, 8.0] - eye) / np.linalg.norm([16.0, 6.0])))
    near, far = (off_deg > 6.0) & (off_deg < 25.0), off_deg > 25.0
    found = glow[row, column]
    assert found[near].mean() == pytest.approx(expected[near].mean(), rel=0.04)
    assert np.abs(expected - found)[far].max() < 0.01 * sky


@pytest.mark.parametrize("shown", list(Signal))
def test_a_signal_shows_its_lit_lens(opened: Open, shown: Signal) -> None:
    lamp = SignalLamp("j/a", (5.0, 0.0, 1.0), (-1.0, 0.0))
    with opened(world_of(signal_lamps=(lamp,)), air_of(sky=uniform(100.0))) as renderer:
        renderer.place(frame_of(**{"j/a": shown}))
        capture = renderer.render_camera(view_of(size=(161, 161)))
    rows = [80 + round(80 * 0.31 * step / 5.0) for step in (-1, 0, 1)]
    column = capture.radiance[rows, 80]
    assert int((column @ LUMINANCE).argmax()) == shown
    assert (column @ LUMINANCE).max() == pytest.approx(7500.0, rel=0.1)
    assert capture.semantic[80, 80] == Semantic.TRAFFIC_LIGHT


def test_brake_lamps_are_brighter_than_tail_lamps_and_those_than_none(opened: Open) -> None:
    body = Body((build_box((0, 0, 1), (2, 2, 2), "lamp_red", Semantic.VEHICLE),), (2.0, 2.0, 2.0))
    with opened(world_of(bodies={"box": body}), air_of()) as renderer:
        seen: list[float] = []
        for lamps in (Lamp(0), Lamp.LOW_BEAM, Lamp.LOW_BEAM | Lamp.BRAKE):
            renderer.place(frame_of(state(1, (8, 0, 0), lamps=lamps)))
            seen.append(centre(luminance(renderer.render_camera(view_of(size=(21, 21))))))
    assert seen[0] == 0.0 < 5.0 * seen[1] < seen[2]


def test_lamps_that_flicker_show_the_light_that_an_exposure_collects(opened: Open) -> None:
    body = Body((build_box((0, 0, 1), (2, 2, 2), "lamp_red", Semantic.VEHICLE),), (2.0, 2.0, 2.0))
    lamp = SignalLamp("j/a", (5.0, 0.0, 1.0), (-1.0, 0.0))
    world = world_of(signal_lamps=(lamp,), bodies={"box": body})
    views = view_of(size=(161, 161)), view_of(pose_matrix((0, 20, 0)), size=(21, 21))
    seen: list[tuple[float, float]] = []
    with opened(world, air_of()) as renderer:
        for ratio in (1.0, 0.0, 0.5, 2.0):
            tail = replace(state(1, (8, 20, 0), lamps=Lamp.LOW_BEAM), tail_light_ratio=ratio)
            shown = frame_of(tail, **{"j/a": Signal.RED})
            renderer.place(replace(shown, signal_light_ratios={"j/a": ratio}))
            signal, rear = (luminance(renderer.render_camera(view)) for view in views)
            seen.append((float(signal.max()), centre(rear)))
    np.testing.assert_allclose(np.divide(seen, seen[0])[:, 0], (1, 0, 0.5, 2), atol=0.01)
    np.testing.assert_allclose(np.divide(seen, seen[0])[:, 1], (1, 0, 0.5, 2), atol=0.01)
