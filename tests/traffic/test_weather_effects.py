"""Lamps and umbrellas as the weather changes them."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl.weather_components import Lamps

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.traffic.weather_effects import apply_lamp_state, raise_umbrellas

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
