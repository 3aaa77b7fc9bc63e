"""Lamps of vehicles as light sources: colours, intensities and beams."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl.weather_components import Lamps

from advercity.frames import Actor, ActorState, Frame, Lamp, Signal
from advercity.geometry import poses
from advercity.materials import MATERIALS
from advercity.physics.lamp_beams import LampPattern, LightSource, intensity_towards
from advercity.physics.photometry import LED_HEADLAMP_COLOUR, black_body_colour
from advercity.rendering.lamp_lenses import (
    LENS_KINDS,
    build_signal_lenses,
    compute_lens_luminances,
)
from advercity.rendering.light_sources import (
    AMBER_LAMP_COLOUR,
    RED_LAMP_COLOUR,
    SIGNAL_COLOURS,
    list_light_sources,
)
from advercity.signal_heads import GovernedTraffic
from advercity.traffic.weather_effects import apply_lamp_state
from advercity.world import SignalLamp, World
from tests.shipped import CATALOGUE, ShippedBodies

CAR = Actor(101, "car", "lincoln_mkz_2017", "car_paint_blue", (4.9, 2.1, 1.5))


EMPTY = World("w", (), bodies={}, lanes=(), network=Path("none"))


MOTOR = ("car", "van", "truck", "motorcycle")


def frame(lamps: Lamp, *, time_s: float = 0.0, actor: Actor = CAR) -> Frame:
    pose = poses.pose_matrix((10.0, 0.0, 0.0), yaw=np.pi / 2)
    return Frame(0, time_s, (ActorState(actor, pose, 5.0, 0.0, lamps),), {})


def shining(lamps: Lamp) -> list[LightSource]:
    return list_light_sources(EMPTY, frame(lamps))


def test_an_indicator_shines_amber_from_both_ends_of_its_own_side():
    lamps = shining(Lamp.LEFT)

    assert [lamp.colour for lamp in lamps] == [AMBER_LAMP_COLOUR, AMBER_LAMP_COLOUR]
    # The car heads north: its left is west, x < 10.
    assert all(lamp.position[0] == pytest.approx(10.0 - 0.4 * 2.1) for lamp in lamps)
    assert sorted(round(lamp.position[1], 2) for lamp in lamps) == [-2.55, 2.55]
    front = max(lamps, key=lambda lamp: lamp.position[1])
    assert front.facing == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    assert 175 <= front.intensity_cd <= 1000
    assert all(shining(Lamp.RIGHT)[k].position[0] > 10.0 for k in range(2))


def test_brake_and_rear_fog_lamps_outshine_tail_lamps_within_what_the_rules_allow():
    def red_cd(lamps: Lamp) -> float:
        return sum(lamp.intensity_cd for lamp in shining(lamps) if lamp.colour == RED_LAMP_COLOUR)

    tail, brake, fog = (red_cd(Lamp.LOW_BEAM | more) for more in (Lamp(0), Lamp.BRAKE, Lamp.FOG))
    assert 4 <= tail <= 34
    assert 120 <= brake <= 520
    assert 150 <= fog - tail <= 300
    assert not shining(Lamp(0))


@pytest.mark.parametrize(
    ("off_axis_deg", "least", "most"),
    [(0, 1.0, 1.0), (5, 0.7, 0.9), (10, 0.35, 0.7), (20, 0.1, 0.35), (45, 0.0, 0.05), (90, 0, 0)],
)
def test_rear_lamps_shine_behind_and_hardly_on_the_road_below(
    off_axis_deg: float, least: float, most: float
) -> None:
    """The least is UN R148's share of the peak; the car heads north."""
    brake = next(lamp for lamp in shining(Lamp.BRAKE) if lamp.colour == RED_LAMP_COLOUR)
    down = np.radians(off_axis_deg)
    ray = np.array([0.0, -np.cos(down), -np.sin(down)])
    share = intensity_towards([brake], ray[None, None])[0, 0] / brake.intensity_cd
    assert least - 1e-9 <= share <= most + 1e-9


def test_low_beams_are_dipped_and_as_strong_as_the_rules_ask():
    beams = [lamp for lamp in shining(Lamp.LOW_BEAM) if lamp.pattern is LampPattern.LOW_BEAM]
    assert len(beams) == 2
    assert all(10.1e3 < beam.intensity_cd < 25e3 for beam in beams)
    # The car heads north, its lamps are some 1.3 m apart (weather reference) and look ahead.
    apart_m = abs(beams[0].position[0] - beams[1].position[0])
    assert apart_m == pytest.approx(1.4, abs=0.15)
    assert all(beam.facing == pytest.approx((0.0, 1.0, 0.0), abs=1e-9) for beam in beams)


def test_headlamps_of_leds_are_whiter_and_have_a_pattern_of_their_own():
    (halogen,) = frame(Lamp.LOW_BEAM | Lamp.HIGH_BEAM).states
    led = Frame(0, 0.0, (replace(halogen, has_led_headlamps=True),), {})
    front = [lamp for lamp in list_light_sources(EMPTY, led) if lamp.colour != RED_LAMP_COLOUR]
    assert [lamp.pattern for lamp in front] == [
        *[LampPattern.LED_LOW_BEAM] * 2,
        *[LampPattern.HIGH_BEAM] * 2,
    ]
    assert {lamp.colour for lamp in front} == {LED_HEADLAMP_COLOUR}
    np.testing.assert_allclose(LED_HEADLAMP_COLOUR, black_body_colour(5700.0), atol=0.005)


@pytest.mark.parametrize(
    ("led", "low"),
    [(False, LampPattern.LEFT_HAND_LOW_BEAM), (True, LampPattern.LEFT_HAND_LED_LOW_BEAM)],
)
def test_where_traffic_drives_on_the_left_low_beams_rise_to_the_left(led: bool, low: LampPattern):
    (driving,) = frame(Lamp.LOW_BEAM | Lamp.HIGH_BEAM | Lamp.FOG).states
    shown = Frame(0, 0.0, (replace(driving, has_led_headlamps=led),), {})
    here, there = (
        list_light_sources(replace(EMPTY, is_left_hand=side), shown) for side in (False, True)
    )
    assert [lamp.pattern for lamp in there[:2]] == [low, low]
    # All else is the same.
    assert there[2:] == here[2:]
    assert [lamp.position for lamp in there] == [lamp.position for lamp in here]


def test_a_motorcycle_has_one_beam_and_no_fog_lamps():
    rider = replace(CAR, actor_class="motorcycle", size=(2.0, 0.8, 1.5))
    states = apply_lamp_state(frame(Lamp(0), actor=rider), Lamps(low_beam=True, fog=True))
    assert [lamp.pattern for lamp in list_light_sources(EMPTY, states)] == [
        LampPattern.LOW_BEAM,
        LampPattern.LENS,
    ]


def test_front_fog_lamps_look_below_the_dipped_beams_from_below_them():
    lamps = shining(Lamp.LOW_BEAM | Lamp.FOG)
    beams = [lamp for lamp in lamps if lamp.pattern is LampPattern.LOW_BEAM]
    (fog,) = (lamp for lamp in lamps if lamp.pattern is LampPattern.FOG_BEAM)
    assert fog.position[2] < min(beam.position[2] for beam in beams)
    assert fog.facing[2] < 0.0
    assert fog.intensity_cd < min(beam.intensity_cd for beam in beams)


@pytest.mark.parametrize(
    ("above_deg", "aside_deg", "least_cd", "most_cd"),
    [
        *((up, 0, 0, most) for up, most in [(20, 60), (8, 90), (4, 105), (2, 170), (1, 250)]),
        *((0, aside, 0, 340) for aside in (-10, 0, 10)),
        *((-2.5, aside, 2000, 8000) for aside in (-5, 0, 10)),
        *((-3.5, aside, 800, 8000) for aside in (-22, 22)),
        *((-4.5, aside, 320, 8000) for aside in (-35, 35)),
    ],
)
def test_a_front_fog_lamp_is_cut_off_and_as_wide_as_its_regulation_asks(
    above_deg: float, aside_deg: float, least_cd: float, most_cd: float
) -> None:
    """UN R19, class F3, of each of the two lamps that one stands for; the car heads north."""
    (both,) = (lamp for lamp in shining(Lamp.FOG) if lamp.pattern is LampPattern.FOG_BEAM)
    up, right = np.radians([above_deg, aside_deg])
    ray = np.array([np.cos(up) * np.sin(right), np.cos(up) * np.cos(right), np.sin(up)])
    one_cd = intensity_towards([both], ray[None, None])[0, 0] / 2.0
    assert least_cd <= one_cd <= most_cd


@pytest.mark.parametrize(
    "name", [n for n, made in CATALOGUE.blueprints.items() if made.actor_class in MOTOR]
)
def test_every_motor_vehicle_has_an_indicator_at_each_corner(name: str):
    made, blueprint = ShippedBodies()[name], CATALOGUE.blueprints[name]
    found = {
        part.material: part.vertices[np.unique(part.triangles)]
        for part in made.parts
        if part.material.startswith("lamp_amber")
    }
    assert set(found) == {"lamp_amber_left", "lamp_amber_right"}
    assert found["lamp_amber_left"][:, 1].min() > 0 > found["lamp_amber_right"][:, 1].max()
    # A lorry has those in front on its tractor unit, those behind on its semi-trailer.
    for points in found.values():
        assert (points[:, 0].max() > 0.2 * made.size[0]) == (blueprint.semitrailer is None)
        assert (points[:, 0].min() < -0.2 * made.size[0]) == (blueprint.tows is None)
        assert (np.abs(points) <= np.array(made.size) * (0.5, 0.5, 1) + 0.03).all()


@pytest.mark.parametrize("governs", ["vehicles", "pedestrians"])
@pytest.mark.parametrize("shown", [Signal.RED, Signal.GREEN])
def test_a_signal_shines_from_its_lens_as_much_as_the_lens_is_bright(
    governs: GovernedTraffic, shown: Signal
):
    world = replace(EMPTY, signal_lamps=(SignalLamp("j/a", (5.0, 0.0, 3.0), (-1.0, 0.0), governs),))

    (light,) = list_light_sources(world, Frame(0, 0.0, (), {"j/a": shown}))

    lens = next(
        mesh
        for mesh in build_signal_lenses(governs)
        if mesh.material == f"signal_{shown.name.lower()}"
    )
    a, b, c = (lens.vertices[lens.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a) / 2
    kind = LENS_KINDS[lens.material]
    albedo = np.dot(MATERIALS[lens.material].albedo, (0.2126, 0.7152, 0.0722))
    luminance_cd_m2 = 1e3 * compute_lens_luminances(Lamp(0), shown)[kind] * albedo
    assert normals.sum(axis=0)[1:] == pytest.approx([0, 0], abs=1e-6)
    assert normals.sum() * luminance_cd_m2 == pytest.approx(light.intensity_cd, rel=0.1)
    assert light.colour == SIGNAL_COLOURS[shown]
    assert light.position[2] == pytest.approx(3.0 + lens.vertices[:, 2].mean(), abs=0.03)


@pytest.mark.parametrize(
    ("material", "luminance_cd_m2"),
    [("room_warm", 4.0), ("room_cool", 8.0), ("room_shop", 13.5)],
)
def test_windows_shine_by_night_with_the_light_of_their_rooms(
    material: str, luminance_cd_m2: float
):
    """Walls behind a pane: 0.5 / pi of 30 and 60 lx, 0.85 of it outside; goods: 1/3 of 150 lx."""
    kind, albedo = LENS_KINDS[material], np.array(MATERIALS[material].albedo)
    night = 1e3 * compute_lens_luminances(Lamp.LOW_BEAM)[kind] * albedo
    assert night @ (0.2126, 0.7152, 0.0722) == pytest.approx(luminance_cd_m2, rel=1e-3)
    assert compute_lens_luminances(Lamp(0))[kind] == 0.0
    assert MATERIALS[material].is_transparent


def test_a_head_without_a_yellow_lens_shows_nothing_for_yellow():
    lamp = SignalLamp("j/a", (5.0, 0.0, 3.0), (-1.0, 0.0), "pedestrians")
    world = replace(EMPTY, signal_lamps=(lamp,))

    assert list_light_sources(world, Frame(0, 0.0, (), {"j/a": Signal.YELLOW})) == []


def test_a_lorry_has_headlamps_on_its_tractor_unit_and_rear_lamps_on_its_semitrailer():
    tractor = Actor(1001, "truck", "lorry_tractor", "car_paint_red", (6.1, 2.83, 3.8))
    trailer = Actor(101_001, "truck", "trailer", "car_paint_blue", (13.6, 2.55, 4.0), 1001)
    lamps = Lamp.LOW_BEAM | Lamp.BRAKE | Lamp.LEFT | Lamp.FOG
    states = [
        ActorState(actor, poses.pose_matrix((x, 0.0, 0.0)), 5.0, 0.0, lamps)
        for actor, x in ((tractor, 0.0), (trailer, -6.65))
    ]

    found = list_light_sources(EMPTY, Frame(0, 0.0, tuple(states), {}))

    ahead = [lamp for lamp in found if lamp.facing[0] > 0.9]
    behind = [lamp for lamp in found if lamp.facing[0] < -0.9]
    # Two low beams, fog lamps and an indicator ahead; two red lamps and an indicator behind.
    assert (len(ahead), len(behind), len(found)) == (4, 3, 7)
    assert {round(lamp.position[0], 2) for lamp in ahead} == {3.15}
    assert {round(lamp.position[0], 2) for lamp in behind} == {-13.55}
    # The semi-trailer behind it hides no beam.
    assert all(lamp.unobstructed_m == np.inf for lamp in ahead if lamp.intensity_cd > 1e3)
