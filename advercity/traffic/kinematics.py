"""From where SUMO has the front bumpers to where the bodies are.

What SUMO did, tick by tick, and the trace that is made of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import shapely
from advercity_dsl import Road, Spec
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.frames import STATE_DTYPE, Actor, Lamp, Trace
from advercity.physics.constants import MAX_STEERING_RAD
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.road_network import build_road
from advercity.traffic.demand import TrafficDemand

Number = TypeVar("Number", np.float64, np.complex128)

CATCH_UP_FACTOR = 1.3
"""SUMO's people hop onto crossings and its vehicles slide aside while they stand; here everybody
gets there by moving on, no faster than this times their speed."""
SMOOTHING_TICKS = 5
"""SUMO's people start and stop at once and its drivers dab at the pedals; here it takes them this
long."""
WALK_SMOOTHING_TICKS = 9
"""People take this long to turn round."""
COASTING_M_S2 = 0.3
"""Slowing down more than this takes the brakes."""
STATIONARY_M_S = 0.1
WHEELBASE_FRACTION = 0.6
"""Of a vehicle's length."""
MAX_TURN_RATE_RAD_S = np.pi
MIN_HEADING_SPEED_M_S = 0.3
"""Slower than this a person keeps looking the same way."""


def compute_vehicle_states(
    track: NDArray[np.void], length_m: float, *, tick_s: float
) -> NDArray[np.void]:
    """States of one vehicle from its fronts, both sorted by tick.

    The front axle goes where the front bumper went and draws the rear axle behind it, which rolls
    and never slides: so the body cuts corners as real ones do. An axle is as high as the front was
    when it passed there; before the first tick the lane is taken to go on at its slope. Brake
    lamps are lit while it slows down and while it is held standing.
    """
    fronts = _follow_targets(
        track["x"] + 1j * track["y"], CATCH_UP_FACTOR * track["speed"] * tick_s
    )
    steps = np.abs(np.diff(fronts, prepend=fronts[0]))
    along = np.cumsum(steps)
    wheelbase = WHEELBASE_FRACTION * length_m
    overhang = (length_m - wheelbase) / 2
    first_yaw, slope = track["yaw"][0], track["slope"][0]
    axle = _interpolate_behind(
        fronts, along, overhang, fronts[0] - overhang * np.exp(1j * first_yaw)
    )
    yaw = _compute_tractrix_headings(axle, wheelbase, first_yaw)
    front_z, rear_z = (
        _interpolate_behind(track["z"], along, back, track["z"][0] - back * np.sin(slope))
        for back in (overhang, overhang + wheelbase)
    )
    climb = np.arcsin(np.clip((front_z - rear_z) / wheelbase, -1, 1))
    states = _build_states(
        track,
        axle - wheelbase / 2 * np.cos(climb) * np.exp(1j * yaw),
        z=(front_z + rear_z) / 2,
        yaw=yaw,
        pitch=-climb,
    )
    states["acceleration"] = _smooth(track["acceleration"])
    states["yaw_rate"] = _compute_yaw_rate(yaw, tick_s)
    states["steering"] = _compute_steering(states["yaw_rate"], steps / tick_s, wheelbase)
    states["travelled"] = along
    held = (track["speed"] < STATIONARY_M_S) & (states["acceleration"] <= COASTING_M_S2)
    braking = held | (states["acceleration"] < -COASTING_M_S2)
    states["lamps"] |= np.where(braking, Lamp.BRAKE, 0).astype(np.uint8)
    return states


def compute_walker_states(
    track: NDArray[np.void],
    length_m: float,
    *,
    speed_m_s: float,
    tick_s: float,
    kerb_height: Callable[[NDArray[np.complex128]], NDArray[np.float64]],
) -> NDArray[np.void]:
    """States of one person, who stays upright, walks without hops and looks where they go.

    Args:
        track: Fronts of the person, sorted by tick.
        length_m: Of the body.
        speed_m_s: At which the person walks.
        tick_s: Length of a tick.
        kerb_height: How high above SUMO's lanes the ground is at places (n,), east + i north.
    """
    middles = track["x"] + 1j * track["y"] - length_m / 2 * np.exp(1j * track["yaw"])
    path = _follow_targets(middles, np.full(len(track), CATCH_UP_FACTOR * speed_m_s * tick_s))
    path = _smooth(path, WALK_SMOOTHING_TICKS)
    z = _smooth(track["z"] + kerb_height(path))
    steps = np.diff(path, prepend=path[0])
    speed = np.abs(steps) / tick_s
    speed[0] = track["speed"][0]
    track = track.copy()
    track["speed"], track["acceleration"] = speed, np.gradient(speed, tick_s)
    moves = np.gradient(path, tick_s) if len(path) > 1 else np.zeros(1, complex)
    looked = np.where(np.abs(moves) > MIN_HEADING_SPEED_M_S, np.angle(moves), np.nan)
    yaw = _limit_turns(looked, track["yaw"][0], MAX_TURN_RATE_RAD_S * tick_s)
    states = _build_states(track, path, z=z, yaw=yaw, pitch=np.zeros(len(track)))
    states["yaw_rate"], states["travelled"] = (
        _compute_yaw_rate(yaw, tick_s),
        np.cumsum(np.abs(steps)),
    )
    return states


def _follow_targets(
    targets: NDArray[np.complex128], max_step: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Places (n,), east + i north, that approach the targets by `reach` (n,) at most."""
    here = complex(targets[0])
    path: list[complex] = []
    for target, most in zip(targets.tolist(), max_step.tolist(), strict=True):
        gap = target - here
        here = target if abs(gap) <= most else here + gap / abs(gap) * most
        path.append(here)
    return np.array(path)


def _smooth(values: NDArray[Number], ticks: int = SMOOTHING_TICKS) -> NDArray[Number]:
    """Values (n,), each the mean of the (odd) `ticks` around it."""
    kernel = np.full(ticks, 1 / ticks)
    return np.convolve(np.pad(values, ticks // 2, mode="edge"), kernel, mode="valid")


def _interpolate_behind(
    values: NDArray[Number], along: NDArray[np.float64], back_m: float, before: Number
) -> NDArray[Number]:
    """Values (n,) `back_m` further back on the way, whose value was `before` that far before it."""
    way, known = np.concatenate([[-back_m], along]), np.concatenate([[before], values])
    return np.asarray(np.interp(along - back_m, way, known), dtype=values.dtype)


def _compute_tractrix_headings(
    axle: NDArray[np.complex128], wheelbase_m: float, first: float
) -> NDArray[np.float64]:
    """Headings (n,) of a body whose rear axle is drawn by its front axle (a tractrix)."""
    rear = complex(axle[0]) - wheelbase_m * np.exp(1j * first)
    directions: list[complex] = []
    for front in axle.tolist():
        pull = front - rear
        directions.append(pull / abs(pull))
        rear = front - wheelbase_m * directions[-1]
    return np.unwrap(np.angle(directions))


def _limit_turns(wanted: NDArray[np.float64], first: float, max_step: float) -> NDArray[np.float64]:
    """Headings (n,) that turn towards the wanted ones by `reach` at most; NaN wants none.

    Half of a turn comes before it is called for: one looks where one will go.
    """
    known = np.concatenate([[first], wanted[~np.isnan(wanted)]])
    at = np.cumsum(~np.isnan(wanted))
    aims = np.unwrap(known)[at]
    late = _limit_steps(aims, max_step)
    return (late + _limit_steps(aims[::-1], max_step)[::-1]) / 2


def _limit_steps(aims: NDArray[np.float64], max_step: float) -> NDArray[np.float64]:
    here = float(aims[0])
    headings: list[float] = []
    for aim in aims.tolist():
        here += min(max(aim - here, -max_step), max_step)
        headings.append(here)
    return np.array(headings)


def _compute_yaw_rate(headings: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
    """Turn per second (n,); headings change by less than half a turn a tick."""
    return np.gradient(headings, tick_s) if len(headings) > 1 else np.zeros(1)


def _compute_steering(
    yaw_rate: NDArray[np.float64], speed: NDArray[np.float64], wheelbase_m: float
) -> NDArray[np.float64]:
    """Angle (n,) of the front wheels by the single-track model; kept while standing."""
    moves = speed > STATIONARY_M_S
    wanted = np.arctan2(wheelbase_m * yaw_rate, np.where(moves, speed, 1.0))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), 0))
    return np.clip(np.where(moves[last], wanted[last], 0.0), -MAX_STEERING_RAD, MAX_STEERING_RAD)


def _build_states(
    track: NDArray[np.void],
    middles: NDArray[np.complex128],
    *,
    z: NDArray[np.float64],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
) -> NDArray[np.void]:
    states = np.zeros(len(track), dtype=STATE_DTYPE)
    for name in ("tick", "speed", "acceleration", "lamps"):
        states[name] = track[name]
    states["x"], states["y"], states["z"] = middles.real, middles.imag, z
    states["yaw"], states["pitch"] = yaw, pitch
    return states


KerbHeight = Callable[[NDArray[np.complex128]], NDArray[np.float64]]


@dataclass(frozen=True)
class SumoRecording:
    """Everybody's front bumpers and all lights from the first tick of the warm-up on.

    Attributes:
        tracks: `FRONT` rows by actor, sorted by tick.
        signal_ids: Ids of `SignalLamp`.
        signals: (ticks, signals) uint8 of `Signal`.
    """

    tracks: Mapping[int, NDArray[np.void]]
    signal_ids: tuple[str, ...]
    signals: NDArray[np.uint8]

    def __len__(self) -> int:
        """Ticks, warm-up included."""
        return len(self.signals)

    def with_tracks(self, tracks: Mapping[int, NDArray[np.void]]) -> "SumoRecording":
        """The same with some actors added or moved."""
        return replace(self, tracks={**self.tracks, **tracks})


def build_trace(
    spec: Spec, demand: TrafficDemand, recording: SumoRecording, *, first_tick: int
) -> Trace:
    """A recording from tick `first` on, bodies in place of front bumpers."""
    kerb = build_kerb_height(spec.road)
    tick_s = spec.timing.tick_s
    speeds = {walk.actor.id: walk.speed_m_s for walk in demand.walkers}
    known = {actor.id: actor for actor in demand.actors}
    actors: list[Actor] = []
    states: list[NDArray[np.void]] = []
    for number, track in sorted(recording.tracks.items()):
        actor = known[number]
        if actor.actor_class == "pedestrian":
            speed = speeds[number] if number in speeds else float(track["speed"].max())
            kept = compute_walker_states(
                track, actor.size[0], speed_m_s=speed, tick_s=tick_s, kerb_height=kerb
            )
        else:
            kept = compute_vehicle_states(track, actor.size[0], tick_s=tick_s)
            if actor.actor_class == "bicycle":
                kept["lamps"] = 0
        kept = kept[kept["tick"] >= first_tick]
        if len(kept) > 0:
            kept["tick"] -= first_tick
            kept["actor"] = len(actors)
            actors.append(actor)
            states.append(kept)
    if not states:
        raise RunError("a connected vehicle arrives during the warm-up; move it back")
    together = np.concatenate(states)
    return Trace(
        tick_s=tick_s,
        first_tick=first_tick,
        actors=tuple(actors),
        states=together[np.lexsort((together["actor"], together["tick"]))],
        signal_ids=recording.signal_ids,
        signals=recording.signals[first_tick:],
    )


def build_kerb_height(road: Road) -> KerbHeight:
    """Height of a sidewalk above the roadway for places on foot, 0 on the roadway."""
    roadway = build_road(road).roadway_level_area
    shapely.prepare(roadway)
    return lambda places: np.where(
        shapely.contains_xy(roadway, places.real, places.imag), 0.0, KERB_HEIGHT_M
    )
