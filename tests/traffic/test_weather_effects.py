"""Lamps and umbrellas as the weather changes them."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from advercity_dsl import ActorClass, Blueprint, Weather
from advercity_dsl.weather_components import Lamps

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.traffic.weather_effects import (
    apply_lamp_state,
    fit_led_headlamps,
    light_high_beams,
    may_use_high_beams,
    raise_umbrellas,
)

CAR = Actor(101, "car", "lincoln_mkz_2017", "car_paint_blue", (4.9, 2.1, 1.5))


def frame(lamps: Lamp, *, time_s: float = 0.0, actor: Actor = CAR) -> Frame:
    pose = poses.pose_matrix((10.0, 0.0, 0.0), yaw=np.pi / 2)
    return Frame(0, time_s, (ActorState(actor, pose, 5.0, 0.0, lamps),), {})


def test_an_indicator_blinks_three_times_in_two_seconds():
    times_s = np.arange(0.0, 20.0, 0.01)
    shown = [
        Lamp.LEFT in apply_lamp_state(frame(Lamp.LEFT, time_s=time), Lamps()).get_state(101).lamps
        for time in times_s.tolist()
    ]
    assert np.sum(np.diff(np.array(shown, int)) == 1) == pytest.approx(30, abs=1)
    assert np.mean(shown) == pytest.approx(0.5, abs=0.02)


def test_indicators_of_different_vehicles_keep_their_own_beat():
    def seen(number: int) -> tuple[bool, ...]:
        actor = replace(CAR, id=number)
        return tuple(
            Lamp.RIGHT
            in apply_lamp_state(frame(Lamp.RIGHT, time_s=0.1 * k, actor=actor), Lamps())
            .get_state(number)
            .lamps
            for k in range(14)
        )

    assert len({seen(number) for number in range(1001, 1011)}) > 4


def test_a_blink_leaves_the_other_lamps_alone():
    on = Lamp.LEFT | Lamp.BRAKE
    shown = {
        apply_lamp_state(frame(on, time_s=0.1 * k), Lamps(low_beam=True)).get_state(101).lamps
        for k in range(20)
    }
    assert shown == {Lamp.BRAKE | Lamp.LOW_BEAM, on | Lamp.LOW_BEAM}


def test_bicycles_have_no_indicators():
    rider = replace(CAR, actor_class="bicycle", size=(1.7, 0.6, 1.6))
    shown = [
        apply_lamp_state(frame(Lamp.LEFT, time_s=0.1 * k, actor=rider), Lamps(low_beam=False))
        for k in range(14)
    ]
    assert {one.get_state(101).lamps for one in shown} == {Lamp(0)}


def test_umbrellas_go_up_with_the_rain_and_stay_up_when_it_gets_harder():
    people = tuple(
        ActorState(
            Actor(number, "pedestrian", "pedestrian_0001", "cloth_red", (1.0, 0.5, 1.8)),
            np.eye(4),
            1.0,
            0.0,
            Lamp(0),
        )
        for number in range(5001, 5201)
    )
    walking = Frame(0, 0.0, people, {})

    def up(rain_mm_h: float) -> set[int]:
        shown = raise_umbrellas(walking, rain_mm_h, seed=7)
        return {state.actor.id for state in shown.states if state.umbrella}

    assert not up(0.0)
    assert len(up(1.5)) / 200 == pytest.approx(0.5, abs=0.12)
    assert up(1.5) <= up(4.5) <= up(50.0)
    assert len(up(50.0)) == 200
    assert raise_umbrellas(frame(Lamp(0)), 50.0, seed=7).states[0].umbrella is False


def test_weather_lights_beams_and_leaves_brakes_to_the_driver():
    foggy = Lamps(low_beam=True, fog=True)
    cyclist = Actor(1001, "bicycle", "roadster", "car_paint_red", (1.8, 0.6, 1.7))
    walker = Actor(5001, "pedestrian", "adult", "cloth_dark", (0.4, 0.4, 1.8))

    assert (
        apply_lamp_state(frame(Lamp.BRAKE), foggy).get_state(101).lamps
        == Lamp.BRAKE | Lamp.LOW_BEAM | Lamp.FOG
    )
    lit = apply_lamp_state(frame(Lamp(0), actor=cyclist), foggy)
    assert lit.get_state(1001).lamps == Lamp.LOW_BEAM
    assert apply_lamp_state(frame(Lamp(0), actor=walker), foggy).get_state(5001).lamps == Lamp(0)
    dark = apply_lamp_state(frame(Lamp.BRAKE), Lamps(low_beam=False))
    assert dark.get_state(101).lamps == Lamp.BRAKE


def meeting(
    at_m: tuple[float, float], heading_deg: float, *, speed_m_s: float = 20.0, actor: Actor = CAR
) -> Frame:
    """A car that drives east at the origin, and another road user."""
    at, yaw = (*at_m, 0.0), np.radians(heading_deg)
    other = ActorState(replace(actor, id=7), poses.pose_matrix(at, yaw=yaw), 15.0, 0.0, Lamp(0))
    car = ActorState(CAR, poses.pose_matrix((0.0, 0.0, 0.0)), speed_m_s, 0.0, Lamp.LOW_BEAM)
    return Frame(0, 0.0, (car, other), {})


def dazzles(frame: Frame) -> bool:
    return Lamp.HIGH_BEAM in light_high_beams(frame, 1.0, seed=1).get_state(101).lamps


@pytest.mark.parametrize(
    ("at_m", "heading_deg", "expected"),
    [
        # 500 feet are 152.4 m, 300 feet 91.4 m.
        ((150.0, 3.5), 180.0, False),
        ((155.0, 3.5), 180.0, True),
        ((90.0, 0.0), 0.0, False),
        ((93.0, 0.0), 0.0, True),
        # Crossing from the right, as far as oncoming traffic; past the car; and behind it.
        ((120.0, -20.0), 90.0, False),
        ((50.0, 60.0), 90.0, True),
        ((-20.0, 0.0), 0.0, True),
    ],
)
def test_high_beams_are_dipped_for_traffic_ahead(
    at_m: tuple[float, float], heading_deg: float, expected: bool
) -> None:
    assert dazzles(meeting(at_m, heading_deg)) == expected


def test_high_beams_are_dipped_for_bicycles_but_not_for_pedestrians():
    def ahead(actor_class: ActorClass) -> Frame:
        return meeting((60.0, 0.0), 0.0, actor=replace(CAR, actor_class=actor_class))

    assert not dazzles(ahead("bicycle"))
    assert dazzles(ahead("pedestrian"))


def test_a_vehicle_that_crawls_keeps_its_low_beams():
    assert not dazzles(meeting((400.0, 0.0), 180.0, speed_m_s=8.0))
    assert dazzles(meeting((400.0, 0.0), 180.0, speed_m_s=9.0))


def thousand_cars() -> Frame:
    states = tuple(
        ActorState(
            replace(CAR, id=number),
            poses.pose_matrix((0.0, 1e3 * number, 0.0)),
            20.0,
            0.0,
            Lamp.LOW_BEAM,
        )
        for number in range(1, 1001)
    )
    return Frame(0, 0.0, states, {})


def test_as_many_drivers_use_high_beams_as_declared():
    found = light_high_beams(thousand_cars(), 0.48, seed=3).states
    assert sum(Lamp.HIGH_BEAM in state.lamps for state in found) == pytest.approx(480, abs=50)


def test_as_many_vehicles_have_leds_as_declared_and_the_same_ones_in_every_frame():
    def with_leds(fraction: float) -> set[int]:
        fitted = fit_led_headlamps(thousand_cars(), fraction, {}, seed=3)
        return {state.actor.id for state in fitted.states if state.has_led_headlamps}

    some = with_leds(0.3)
    assert len(some) == pytest.approx(300, abs=50)
    assert some < with_leds(0.6)
    assert some == with_leds(0.3)


@pytest.mark.parametrize(("declared", "expected"), [("halogen", False), ("led", True)])
def test_a_blueprint_may_say_what_its_headlamps_have(
    declared: Literal["halogen", "led"], expected: bool
) -> None:
    blueprint = Blueprint(
        actor_class="car", length_m=4.9, width_m=2.1, height_m=1.5, headlamps=declared
    )
    fitted = fit_led_headlamps(
        frame(Lamp.LOW_BEAM), 1.0 - expected, {CAR.blueprint: blueprint}, seed=3
    )
    assert fitted.get_state(101).has_led_headlamps == expected


def test_bicycles_and_people_have_no_headlamps_of_cars():
    for actor_class in ("bicycle", "pedestrian"):
        actor = replace(CAR, actor_class=actor_class)
        fitted = fit_led_headlamps(frame(Lamp.LOW_BEAM, actor=actor), 1.0, {}, seed=3)
        assert not fitted.get_state(101).has_led_headlamps


@pytest.mark.parametrize(
    ("values", "land_use", "expected"),
    [
        ({"time": "night"}, "rural", True),
        ({"time": "night"}, "urban", False),
        ({"time": "day"}, "rural", False),
        ({"time": "night", "fog": {"mor_m": "900 m"}}, "rural", False),
        ({"time": "night", "fog": {"mor_m": "1500 m"}}, "rural", True),
        ({"time": "night", "night": {"street_lx": {"urban": 12, "rural": 5}}}, "rural", False),
        ({"time": "night", "lamps": {"low_beam": False}}, "rural", False),
    ],
)
def test_high_beams_are_for_clear_nights_on_unlit_roads(
    values: dict[str, Any], land_use: Literal["urban", "rural"], expected: bool
) -> None:
    sun = {"elevation_deg": 30 if values["time"] == "day" else -30}
    weather = Weather.model_validate({"id": "tried", "sun": sun, **values})
    assert may_use_high_beams(weather, land_use) == expected


def lorry(lamps: Lamp, *, time_s: float = 0.0) -> Frame:
    """A tractor unit that heads north, and its semi-trailer behind it."""
    pairs = (
        (Actor(1001, "truck", "lorry_tractor", "car_paint_red", (6.1, 2.83, 3.8)), 0.0),
        (Actor(101_001, "truck", "trailer", "car_paint_blue", (13.6, 2.55, 4.0), 1001), -6.65),
    )
    states = (
        ActorState(actor, poses.pose_matrix((0.0, y, 0.0), yaw=np.pi / 2), 20.0, 0.0, lamps)
        for actor, y in pairs
    )
    return Frame(0, time_s, tuple(states), {})


def test_a_semitrailer_blinks_with_its_tractor_unit():
    for time_s in np.arange(0.0, 2.0, 0.05).tolist():
        shown = apply_lamp_state(lorry(Lamp.RIGHT, time_s=time_s), Lamps(low_beam=True, fog=True))
        tractor, trailer = shown.states
        assert tractor.lamps == trailer.lamps


def test_a_semitrailer_has_no_headlamps_and_does_not_dazzle_its_tractor_unit():
    lit = light_high_beams(lorry(Lamp.LOW_BEAM), 1.0, seed=1)

    assert [Lamp.HIGH_BEAM in state.lamps for state in lit.states] == [True, False]
    fitted = fit_led_headlamps(lorry(Lamp.LOW_BEAM), 1.0, {}, seed=1)
    assert [state.has_led_headlamps for state in fitted.states] == [True, False]
