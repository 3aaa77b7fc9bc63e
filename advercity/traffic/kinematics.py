"""Turn SUMO's front bumpers into the poses of bodies, and a whole recording into a trace.

A vehicle's body follows its front bumper like a trailer; a person's path and heading are smoothed.
Positions in the plane are complex numbers here, east + i north: a heading is then an argument, and
one function smooths or interpolates positions and plain numbers alike.
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
KerbHeight = Callable[[NDArray[np.complex128]], NDArray[np.float64]]
"""Returns heights (n,) in m at points (n,), east + i north."""

CATCH_UP_FACTOR = 1.3
"""SUMO's people hop onto crossings and its vehicles slide sideways at standstill; here an actor
catches up with its position in SUMO no faster than this times its speed."""
SMOOTHING_TICKS = 5
"""Ticks over which speed changes are spread: SUMO's people start and stop at once, and its drivers
press their pedals for single ticks."""
WALK_SMOOTHING_TICKS = 9
"""Ticks over which people turn."""
COASTING_M_S2 = 0.3
"""Deceleration above which the brakes are in use."""
STANDSTILL_M_S = 0.1
"""Below this speed a vehicle is held by its brakes and keeps its steering angle."""
WHEELBASE_FRACTION = 0.6
"""Distance of the axles as a fraction of a vehicle's length."""
MAX_TURN_RATE_RAD_S = np.pi
MIN_HEADING_SPEED_M_S = 0.3
"""Below this speed a person keeps its heading."""


def compute_vehicle_states(
    track: NDArray[np.void], length_m: float, *, tick_s: float
) -> NDArray[np.void]:
    """Compute the states of one vehicle from its fronts, both sorted by tick.

    The front axle follows the path of the front bumper and pulls the rear axle behind it, which
    rolls and never slides (a tractrix): so the body cuts corners as real ones do. An axle is as
    high as the front was when it passed there; before the first tick the lane is extended at its
    slope. Brake lamps are lit while the vehicle slows down and while it is held at standstill.

    Args:
        track: (n,) of `FRONT_DTYPE`; of yaw and slope only the first row counts.
        length_m: Length of the body.
        tick_s: Length of a tick.

    Returns:
        (n,) of `STATE_DTYPE`, with `actor` left at 0.
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
    held = (track["speed"] < STANDSTILL_M_S) & (states["acceleration"] <= COASTING_M_S2)
    braking = held | (states["acceleration"] < -COASTING_M_S2)
    states["lamps"] |= np.where(braking, Lamp.BRAKE, 0).astype(np.uint8)
    return states


def compute_walker_states(
    track: NDArray[np.void],
    length_m: float,
    *,
    speed_m_s: float,
    tick_s: float,
    kerb_height: KerbHeight,
) -> NDArray[np.void]:
    """Compute the states of one person, who stays upright and faces the walking direction.

    Args:
        track: (n,) of `FRONT_DTYPE`, sorted by tick.
        length_m: Length of the body.
        speed_m_s: Walking speed.
        tick_s: Length of a tick.
        kerb_height: Height in m of the ground above SUMO's lanes at points (n,), east + i north.

    Returns:
        (n,) of `STATE_DTYPE`, with `actor` left at 0.
    """
    centres = track["x"] + 1j * track["y"] - length_m / 2 * np.exp(1j * track["yaw"])
    path = _follow_targets(centres, np.full(len(track), CATCH_UP_FACTOR * speed_m_s * tick_s))
    path = _smooth(path, WALK_SMOOTHING_TICKS)
    z = _smooth(track["z"] + kerb_height(path))
    steps = np.diff(path, prepend=path[0])
    speed = np.abs(steps) / tick_s
    speed[0] = track["speed"][0]
    moves = np.gradient(path, tick_s) if len(path) > 1 else np.zeros(1, complex)
    headings = np.where(np.abs(moves) > MIN_HEADING_SPEED_M_S, np.angle(moves), np.nan)
    yaw = _limit_turns(headings, track["yaw"][0], MAX_TURN_RATE_RAD_S * tick_s)
    states = _build_states(track, path, z=z, yaw=yaw, pitch=np.zeros(len(track)))
    states["speed"], states["acceleration"] = speed, np.gradient(speed, tick_s)
    states["yaw_rate"] = _compute_yaw_rate(yaw, tick_s)
    states["travelled"] = np.cumsum(np.abs(steps))
    return states


def _follow_targets(
    targets: NDArray[np.complex128], max_step: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Compute positions (n,) that follow the targets by steps of `max_step` (n,) at most."""
    position = complex(targets[0])
    path: list[complex] = []
    for target, limit in zip(targets.tolist(), max_step.tolist(), strict=True):
        gap = target - position
        position = target if abs(gap) <= limit else position + gap / abs(gap) * limit
        path.append(position)
    return np.array(path)


def _smooth(values: NDArray[Number], ticks: int = SMOOTHING_TICKS) -> NDArray[Number]:
    """Average values (n,) over the (odd) number of `ticks` around each."""
    kernel = np.full(ticks, 1 / ticks)
    return np.convolve(np.pad(values, ticks // 2, mode="edge"), kernel, mode="valid")


def _interpolate_behind(
    values: NDArray[Number], along: NDArray[np.float64], back_m: float, before: Number
) -> NDArray[Number]:
    """Interpolate values (n,) `back_m` behind each station (n,).

    `before` is the value `back_m` before the first station, which the path does not include.
    """
    stations, known = np.concatenate([[-back_m], along]), np.concatenate([[before], values])
    return np.asarray(np.interp(along - back_m, stations, known), dtype=values.dtype)


def _compute_tractrix_headings(
    axle: NDArray[np.complex128], wheelbase_m: float, first: float
) -> NDArray[np.float64]:
    """Compute headings (n,) of a body whose front axle (n,) pulls the rear one (a tractrix)."""
    rear = complex(axle[0]) - wheelbase_m * np.exp(1j * first)
    directions: list[complex] = []
    for front in axle.tolist():
        pull = front - rear
        directions.append(pull / abs(pull))
        rear = front - wheelbase_m * directions[-1]
    return np.unwrap(np.angle(directions))


def _limit_turns(wanted: NDArray[np.float64], first: float, max_step: float) -> NDArray[np.float64]:
    """Compute headings (n,) that turn towards the wanted ones by `max_step` a tick at most.

    NaN leaves the heading as it was. Half of a turn happens before it is wanted, since people look
    where they will go.
    """
    known = np.concatenate([[first], wanted[~np.isnan(wanted)]])
    at = np.cumsum(~np.isnan(wanted))
    aims = np.unwrap(known)[at]
    late = _limit_steps(aims, max_step)
    return (late + _limit_steps(aims[::-1], max_step)[::-1]) / 2


def _limit_steps(aims: NDArray[np.float64], max_step: float) -> NDArray[np.float64]:
    heading = float(aims[0])
    headings: list[float] = []
    for aim in aims.tolist():
        heading += min(max(aim - heading, -max_step), max_step)
        headings.append(heading)
    return np.array(headings)


def _compute_yaw_rate(headings: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
    """Compute yaw rates (n,) in rad/s of unwrapped headings (n,)."""
    return np.gradient(headings, tick_s) if len(headings) > 1 else np.zeros(1)


def _compute_steering(
    yaw_rate: NDArray[np.float64], speed: NDArray[np.float64], wheelbase_m: float
) -> NDArray[np.float64]:
    """Compute steering angles (n,) by the single-track model; kept at standstill."""
    moves = speed > STANDSTILL_M_S
    wanted = np.arctan2(wheelbase_m * yaw_rate, np.where(moves, speed, 1.0))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), 0))
    return np.clip(np.where(moves[last], wanted[last], 0.0), -MAX_STEERING_RAD, MAX_STEERING_RAD)


def _build_states(
    track: NDArray[np.void],
    centres: NDArray[np.complex128],
    *,
    z: NDArray[np.float64],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
) -> NDArray[np.void]:
    states = np.zeros(len(track), dtype=STATE_DTYPE)
    for name in ("tick", "speed", "acceleration", "lamps"):
        states[name] = track[name]
    states["x"], states["y"], states["z"] = centres.real, centres.imag, z
    states["yaw"], states["pitch"] = yaw, pitch
    return states


@dataclass(frozen=True)
class SumoRecording:
    """The front bumpers of all actors and all lights, from the first tick of the warm-up on.

    Attributes:
        tracks: `FRONT_DTYPE` rows by actor, sorted by tick.
        signal_ids: Ids of `SignalLamp`.
        signals: (ticks, signals) uint8 of `Signal`.
    """

    tracks: Mapping[int, NDArray[np.void]]
    signal_ids: tuple[str, ...]
    signals: NDArray[np.uint8]

    def __len__(self) -> int:
        """Return the number of ticks, warm-up included."""
        return len(self.signals)

    def with_tracks(self, tracks: Mapping[int, NDArray[np.void]]) -> "SumoRecording":
        """Add or replace the tracks of some actors."""
        return replace(self, tracks={**self.tracks, **tracks})


def build_trace(
    spec: Spec, demand: TrafficDemand, recording: SumoRecording, *, first_tick: int
) -> Trace:
    """Build the trace of a recording from a tick on, with bodies in place of front bumpers.

    Raises:
        RunError: No actor is left at that tick.
    """
    kerb_height = build_kerb_height(spec.road)
    tick_s = spec.timing.tick_s
    speeds = {trip.actor.id: trip.speed_m_s for trip in demand.walkers}
    known = {actor.id: actor for actor in demand.actors}
    actors: list[Actor] = []
    states: list[NDArray[np.void]] = []
    for number, track in sorted(recording.tracks.items()):
        actor = known[number]
        if actor.actor_class == "pedestrian":
            # A staged pedestrian has no walking speed of its own, but the speed of its track.
            speed = speeds[number] if number in speeds else float(track["speed"].max())
            rows = compute_walker_states(
                track, actor.size[0], speed_m_s=speed, tick_s=tick_s, kerb_height=kerb_height
            )
        else:
            rows = compute_vehicle_states(track, actor.size[0], tick_s=tick_s)
            if actor.actor_class == "bicycle":
                rows["lamps"] = 0
        # Cut off the warm-up only now: axles roll and people turn on what they did before.
        rows = rows[rows["tick"] >= first_tick]
        if len(rows) > 0:
            rows["tick"] -= first_tick
            rows["actor"] = len(actors)
            actors.append(actor)
            states.append(rows)
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
    """Build a function for the height of the ground above SUMO's lanes, 0 on the roadway.

    SUMO's sidewalks lie at the height of the roadway; ours lie on a kerb.
    """
    roadway = build_road(road).roadway_level_area
    shapely.prepare(roadway)
    return lambda places: np.where(
        shapely.contains_xy(roadway, places.real, places.imag), 0.0, KERB_HEIGHT_M
    )
