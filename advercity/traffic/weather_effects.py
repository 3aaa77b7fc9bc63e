"""Effects of the weather on a frame's actors: lamps and umbrellas.

All weathers share the trace with the drivers' actions; these functions add the rest.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from advercity_dsl import Blueprint, Weather
from advercity_dsl.weather_components import Lamps

from advercity.frames import ActorState, Frame, Lamp
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.physics.extinction import compute_extinction
from advercity.randomness import create_generator

INDICATOR_FREQUENCY_HZ = 1.5
"""UN R48: 90 +- 30 flashes a minute."""
_INDICATORS = Lamp.LEFT | Lamp.RIGHT


def apply_lamp_state(frame: Frame, lamps: Lamps) -> Frame:
    """Light low beams and fog lamps by the weather, and let indicators blink.

    In the trace an indicator is switched on; here it is lit for half of the time, each vehicle's
    with its own phase. Two-wheelers have no fog lamps, bicycles no indicators, people no lamps.
    """
    states = tuple(_apply_lamps(state, lamps, frame.time_s) for state in frame.states)
    return replace(frame, states=states)


def _apply_lamps(state: ActorState, lamps: Lamps, time_s: float) -> ActorState:
    actor_class = state.actor.actor_class
    if actor_class == "pedestrian":
        return state
    lit = state.lamps
    phase = (INDICATOR_FREQUENCY_HZ * time_s + GOLDEN_FRACTION * state.actor.vehicle_id) % 1.0
    if actor_class == "bicycle" or phase >= 0.5:
        lit &= ~_INDICATORS
    if lamps.low_beam:
        lit |= Lamp.LOW_BEAM
    if lamps.fog and actor_class not in ("bicycle", "motorcycle"):
        lit |= Lamp.FOG
    return replace(state, lamps=lit)


def fit_led_headlamps(
    frame: Frame, fraction: float, blueprints: Mapping[str, Blueprint], *, seed: int
) -> Frame:
    """Fit LED headlamps to a fraction of the motor vehicles; the same ones in every frame.

    Args:
        frame: With halogen headlamps.
        fraction: Fraction of the vehicles whose blueprint declares no headlamps.
        blueprints: By name; vehicles with other blueprints count as undeclared.
        seed: Seed of the traffic.
    """

    def has_leds(state: ActorState) -> bool:
        actor = state.actor
        if actor.actor_class in ("pedestrian", "bicycle") or actor.towed_by:
            return False
        declared = blueprints[actor.blueprint].headlamps if actor.blueprint in blueprints else None
        if declared:
            return declared == "led"
        return _draw_threshold(seed, "led_headlamps", actor.id) < fraction

    states = tuple(replace(state, has_led_headlamps=has_leds(state)) for state in frame.states)
    return replace(frame, states=states)


MIN_HIGH_BEAM_VISIBILITY_M = 1000.0
"""Below it is fog by definition of the WMO, in which high beams dazzle their own drivers."""
MAX_UNLIT_LX = 2.0
"""Above it street lighting has a class of EN 13201, at least P6."""
MIN_HIGH_BEAM_SPEED_M_S = 30.0 / 3.6
"""Speed below which vehicles wait or turn, and dip; an engineering value."""
DIP_FOR_ONCOMING_M, DIP_BEHIND_M = 152.4, 91.4
"""500 and 300 feet: drivers dip within them by the California Vehicle Code (24409)."""
BEAM_HALF_ANGLE_RAD = math.radians(30.0)
"""Maximum angle off the heading at which others are dazzled; an engineering value."""


def may_use_high_beams(weather: Weather, land_use: Literal["urban", "rural"]) -> bool:
    """Return whether a free road permits high beams: unlit roads on clear nights."""
    return (
        weather.time == "night"
        and weather.lamps.low_beam
        and getattr(weather.night.street_lx, land_use) < MAX_UNLIT_LX
        and compute_extinction(weather).mor_m >= MIN_HIGH_BEAM_VISIBILITY_M
    )


def light_high_beams(frame: Frame, fraction: float, *, seed: int) -> Frame:
    """Light the high beams of moving vehicles that would dazzle no driver ahead.

    The limits are `DIP_FOR_ONCOMING_M` and `DIP_BEHIND_M`, for all vehicles and bicycles ahead;
    crossing ones count as oncoming. The same drivers use them in every frame.

    Args:
        frame: With low beams.
        fraction: Fraction of drivers who use high beams.
        seed: Seed of the traffic.
    """
    road_users = [state for state in frame.states if state.actor.actor_class != "pedestrian"]
    if not road_users:
        return frame
    poses = np.stack([state.world_from_body for state in road_users])
    position, heading = poses[:, :2, 3], poses[:, :2, 0]

    def lit(state: ActorState) -> Lamp:
        if (
            state.actor.actor_class in ("pedestrian", "bicycle")
            or state.actor.towed_by
            or Lamp.LOW_BEAM not in state.lamps
            or state.speed_m_s < MIN_HIGH_BEAM_SPEED_M_S
            or _draw_threshold(seed, "high_beam", state.actor.id) >= fraction
        ):
            return state.lamps
        ahead = state.world_from_body[:2, 0]
        away = position - state.world_from_body[:2, 3]
        distance_m = np.hypot(*away.T)
        is_ahead = away @ ahead > math.cos(BEAM_HALF_ANGLE_RAD) * distance_m
        dip_m = np.where(heading @ ahead > math.cos(math.pi / 4), DIP_BEHIND_M, DIP_FOR_ONCOMING_M)
        dazzled = is_ahead & (distance_m < dip_m)
        return state.lamps if dazzled.any() else state.lamps | Lamp.HIGH_BEAM

    states = tuple(replace(state, lamps=lit(state)) for state in frame.states)
    return replace(frame, states=states)


HALF_UMBRELLAS_MM_H = 1.5
"""Rain rate at which half of the people with an umbrella hold it up; a plausible figure."""


def raise_umbrellas(frame: Frame, rain_mm_h: float, *, seed: int) -> Frame:
    """Raise umbrellas, the more of them the harder it rains.

    A person with a raised umbrella in some rain also has it up in harder rain.

    Args:
        frame: Without umbrellas.
        rain_mm_h: Rain rate.
        seed: Seed of the traffic.
    """
    fraction = 1.0 - math.pow(2.0, -rain_mm_h / HALF_UMBRELLAS_MM_H)
    if fraction <= 0.0:
        return frame
    states = tuple(
        replace(state, umbrella=_draw_threshold(seed, "umbrella", state.actor.id) < fraction)
        if state.actor.actor_class == "pedestrian"
        else state
        for state in frame.states
    )
    return replace(frame, states=states)


def _draw_threshold(seed: int, what: str, actor_id: int) -> float:
    """Draw the fraction of umbrellas, high beams or LEDs at which an actor gets one."""
    return float(create_generator(seed, what, actor_id).random())
