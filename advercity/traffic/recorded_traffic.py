"""Traffic of a road with recorded trajectories: resampled to ticks, without simulation.

Place and heading are the recording's; between samples, a curve with continuous acceleration
interpolates them. The road gives height and pitch, the lights run their fixed programs, and brake
lamps follow the deceleration.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import shapely
from advercity_dsl import Spec, TrajectorySet, Vehicle
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.frames import WHEELBASE_FRACTION, Actor, Trace
from advercity.geometry.plane import compute_directions, compute_headings
from advercity.recordings.bodies import select_blueprint
from advercity.recordings.track_file import unpack_tracks
from advercity.recordings.tracks import Track
from advercity.roads.network_file import read_network
from advercity.traffic.banking import Lean, build_lean, stay_upright
from advercity.traffic.body_states import (
    BodyCurves,
    apply_brake_lamps,
    build_states,
    compute_steering,
    round_states,
)
from advercity.traffic.demand import FIRST_BACKGROUND_VEHICLE
from advercity.traffic.motion_spline import MotionSpline, interpolate_smoothly
from advercity.traffic.paints import CONNECTED_PAINT, draw_paint
from advercity.traffic.pedestrians import FIRST_BACKGROUND_WALKER
from advercity.traffic.signal_states import build_program_states
from advercity.traffic.walking_motion import build_kerb_height

GroundHeight = Callable[[NDArray[np.complex128]], NDArray[np.float64]]
"""Returns heights (n,) in m at points (n,), east + i north."""
HEIGHT_SMOOTHING_TICKS = 4
"""Ticks over which a change of the road's slope is spread."""
TIME_TOLERANCE_S = 1e-6
"""Tables have a resolution of a microsecond."""


def build_recorded_trace(spec: Spec, recorded: TrajectorySet, network: Path) -> Trace:
    """Build the trace of a spec whose actors follow recorded trajectories.

    Args:
        spec: The scenario.
        recorded: The trajectories of its road.
        network: The SUMO network of the road.

    Raises:
        InputError: A connected vehicle is not present all the time, or a class has no blueprint.
    """
    tick_s = spec.timing.tick_s
    count = int((recorded.to_s - recorded.from_s + TIME_TOLERANCE_S) / tick_s) + 1
    count = min(count, spec.timing.max_ticks)
    since_s = tick_s * np.arange(count, dtype=np.float64)
    times_s = recorded.from_s + since_s
    tracks = unpack_tracks(recorded)
    ground, kerb = build_ground_height(network), build_kerb_height(spec.road)
    lean = build_lean(spec.road, tick_s)
    actors, states = list[Actor](), list[NDArray[np.void]]()
    for actor, track in sorted(_cast_actors(spec, tracks), key=lambda item: item[0].id):
        present = np.flatnonzero(
            (times_s >= track.times_s[0] - TIME_TOLERANCE_S)
            & (times_s <= track.times_s[-1] + TIME_TOLERANCE_S)
        )
        if len(present) < 2:
            continue
        compute = partial(_compute_states, track, present, times_s[present], tick_s=tick_s)
        if actor.actor_class == "pedestrian":
            rows = compute(
                wheelbase_m=0.0, height=lambda at: ground(at) + kerb(at), lean=stay_upright
            )
        else:
            rows = compute(wheelbase_m=WHEELBASE_FRACTION * actor.size[0], height=ground, lean=lean)
            if actor.actor_class != "bicycle":
                apply_brake_lamps(rows)
        rows["actor"] = len(actors)
        actors.append(actor)
        states.append(rows)
    together = np.concatenate(states)
    signal_ids, signals = build_program_states(network, since_s)
    return Trace(
        tick_s=tick_s,
        first_tick=spec.timing.warm_up_ticks + 1,
        actors=tuple(actors),
        states=round_states(together[np.lexsort((together["actor"], together["tick"]))]),
        signal_ids=signal_ids,
        signals=signals,
    )


def _cast_actors(spec: Spec, tracks: list[Track]) -> list[tuple[Actor, Track]]:
    """Give every track an actor: connected vehicles their own, others bodies of their size."""
    by_id = {track.id: track for track in tracks}
    cast: list[tuple[Actor, Track]] = []
    for agent in spec.agents:
        if isinstance(agent.place, Vehicle):
            track = by_id.pop(agent.place.track or "", None)
            if track is None or agent.blueprint not in spec.blueprints:
                raise InputError(f"agent '{agent.id}': has no track or no blueprint in the spec")
            blueprint = spec.blueprints[agent.blueprint]
            name = agent.blueprint
            actor = Actor.from_blueprint(agent.number, name, blueprint, CONNECTED_PAINT)
            cast.append((actor, track))
    following = {True: FIRST_BACKGROUND_WALKER, False: FIRST_BACKGROUND_VEHICLE}
    for track in by_id.values():
        is_walker = track.actor_class == "pedestrian"
        number = following[is_walker]
        following[is_walker] += 1
        cast.append((_cast_background_actor(spec, track, number), track))
    return cast


def _cast_background_actor(spec: Spec, track: Track, number: int) -> Actor:
    seed, use = spec.seeds.traffic, spec.road.land_use
    fitting = {
        name: blueprint
        for name, blueprint in spec.blueprints.items()
        if blueprint.land_use in ("any", use)
    }
    name = select_blueprint(fitting, track.actor_class, track.size, seed, track.id)
    blueprint = fitting[name]
    # Keyed by its name in the recording, so every part of the recording shows it the same.
    paint = draw_paint(track.actor_class, seed, track.id, paints=blueprint.paints)
    return Actor.from_blueprint(number, name, blueprint, paint)


def _compute_states(
    track: Track,
    ticks: NDArray[np.int64],
    times_s: NDArray[np.float64],
    *,
    tick_s: float,
    wheelbase_m: float,
    height: GroundHeight,
    lean: Lean,
) -> NDArray[np.void]:
    """Compute the states (n,) of a track at ticks (n,) with times (n,)."""
    resample = partial(interpolate_smoothly, track.times_s, at_s=times_s)
    plan = resample(track.places[:, 0] + 1j * track.places[:, 1])
    yaw = resample(track.headings_rad)
    directions = compute_directions(yaw[0])
    half = wheelbase_m / 2 * directions
    front, rear = (_smooth_heights(height(plan[0] + way * half), tick_s) for way in (1, -1))
    climb, climb_rate, _ = (front - rear) / wheelbase_m if wheelbase_m else np.zeros_like(front)
    curves = BodyCurves(
        plan=plan,
        height=(front + rear) / 2,
        yaw=yaw[:2],
        pitch=-np.stack([compute_headings(1 + 1j * climb), climb_rate / (1 + climb**2)]),
        roll=np.zeros((2, len(ticks))),
    )
    states = build_states(ticks, np.zeros(len(ticks), np.uint8), lean(curves))
    if wheelbase_m:
        states["steering"] = compute_steering(plan[1] + 1j * yaw[1] * half, directions)
    return states


def _smooth_heights(heights_m: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
    """Smooth heights (n,) at ticks into heights and their first two derivatives (3, n)."""
    steps = np.diff(heights_m)
    return MotionSpline.from_samples(
        heights_m,
        tick_s,
        ticks=HEIGHT_SMOOTHING_TICKS,
        first_step=float(steps[0]),
        last_step=float(steps[-1]),
    ).derivatives


def build_ground_height(network: Path) -> GroundHeight:
    """Build a function for the height of the roadway, from the nearest lane's centre."""
    lanes = [
        shapely.LineString(lane.centre)
        for lane in read_network(network).lanes
        if lane.function != "walkingarea" and len(lane.centre) > 1
    ]
    lines, tree = np.array(lanes, dtype=np.object_), shapely.STRtree(lanes)

    def find_height(places: NDArray[np.complex128]) -> NDArray[np.float64]:
        points = shapely.points(places.real, places.imag)
        nearest = lines[tree.nearest(points)]
        along = shapely.line_locate_point(nearest, points)
        return shapely.get_z(shapely.line_interpolate_point(nearest, along))

    return find_height
