"""Evaluate staged conflicts on a trace alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Spec, Vehicle
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.achieved_parameters import (
    APPROACH_WINDOW_S,
    AchievedParameter,
    measure_parameters,
    select_before,
)
from advercity.conflicts.ego_motion import compute_free_drive_s
from advercity.conflicts.metrics import ActorTrack, Encounter, MetricAtTick, measure_encounter
from advercity.conflicts.reaction import needs_reaction
from advercity.conflicts.resolution import (
    EVASIVE_BRAKING_M_S2,
    Resolution,
    find_undisturbed_row,
    measure_resolution,
)
from advercity.conflicts.trajectories import find_crossing, go_straight_on
from advercity.errors import RunError
from advercity.frames import WHEELBASE_FRACTION, Signal, Trace
from advercity.geometry.polyline import StationedPolyline, drop_repeated_points
from advercity.roads.mirrored_traffic import mirror_trace
from advercity.roads.plan_frame import to_plan_spec
from advercity.roads.routes import RoutePlanner, build_ego_path

ADJACENT_LANE_GAP_M = 6.0
"""Distance from a point within which an actor passes it in an adjacent lane."""
AFTER_IMPACT_S = 3.0
"""Time for which both tracks continue after an impact, to where their paths would have crossed."""
LEAST_COSINE = 0.1
"""Lower bound for the cosine of the angle between an actor and the ego's lane, against 1 / 0."""
STEADY_SPEED_RATIO = 0.99
"""Fraction of the approach speed below which an actor has begun to brake."""


@dataclass(frozen=True)
class ConflictOutcome:
    """Outcome of a staged conflict, with the fields of `report.json`.

    Attributes:
        id: Id of the staged conflict.
        conflict: Id of its declaration.
        crash_types: NHTSA crash types of the conflict.
        actor: Id of the actor.
        ego_at_s: Time from the first kept tick at which the ego's centre was nearest to the
            crossing of both paths, or would have been without braking.
        actor_lag_s: How much later the actor would have been there at the speed of its approach.
        met: How near they came to each other.
        resolution: Who braked, or the impact.
        parameters: Declared parameters measured on the trace.
        missed: Deviations from the declaration; empty if the conflict happened.
    """

    id: str
    conflict: str
    crash_types: tuple[str, ...]
    actor: int
    ego_at_s: float
    actor_lag_s: float
    met: Encounter
    resolution: Resolution
    parameters: tuple[AchievedParameter, ...]
    missed: tuple[str, ...]

    @property
    def happened(self) -> bool:
        """Whether everything happened as declared."""
        return not self.missed

    @property
    def problems(self) -> tuple[str, ...]:
        """Deviations from the declaration, with the conflict's name."""
        return tuple(f"{self.id} ({self.conflict}): {reason}" for reason in self.missed)

    @property
    def outside(self) -> tuple[str, ...]:
        """Names of the parameters outside their declared range."""
        return tuple(item.name for item in self.parameters if item.is_outside)


def evaluate_outcomes(spec: Spec, trace: Trace) -> Iterator[ConflictOutcome]:
    """Evaluate every staged conflict of a spec.

    Raises:
        RunError: A participant is not in the trace.
    """
    if spec.road.is_left_hand:
        spec, trace = to_plan_spec(spec), mirror_trace(trace)
    ego = spec.ego.number
    for conflict in spec.conflicts:
        actor = conflict.actors[0].number
        try:
            encounter = measure_encounter(trace, ego, actor)
            tracks = ActorTrack.from_trace(trace, ego), ActorTrack.from_trace(trace, actor)
        except KeyError:
            encounter, tracks = None, None
        if encounter is None or tracks is None:
            raise RunError(f"{spec.id}: {conflict.id} lacks its actor {actor}, or the ego")
        yield _evaluate_outcome(spec, conflict, encounter, *tracks, trace)


def _evaluate_outcome(
    spec: Spec,
    conflict: StagedConflict,
    encounter: Encounter,
    ego: ActorTrack,
    actor: ActorTrack,
    trace: Trace,
) -> ConflictOutcome:
    tick_s = trace.tick_s
    lane, actor_path = _build_ego_lane(spec), _build_actor_path(spec, conflict)
    resolution = measure_resolution(conflict, encounter, ego, actor, lane.line, tick_s)
    if resolution.impact is not None:
        ego = ego.roll_on(lane, AFTER_IMPACT_S, tick_s)
        actor = actor.roll_on(actor_path, AFTER_IMPACT_S, tick_s)
    point = _find_meeting_point(conflict, ego, actor_path.line)
    ego_at_s = _find_ego_arrival_s(spec, conflict, encounter, ego, point, lane, tick_s)
    lag_s = _find_actor_arrival_s(conflict, ego, actor, point, ego_at_s, tick_s) - ego_at_s
    missed = tuple(_find_deviations(conflict, encounter, resolution, lag_s))
    parameters = measure_parameters(
        conflict,
        ego,
        actor,
        ego_at_s=ego_at_s,
        lag_s=lag_s,
        lanes=(lane.line, actor_path.line),
        since_red_s=_measure_since_red_s(spec, conflict, actor, trace),
        tick_s=tick_s,
    )
    return ConflictOutcome(
        id=conflict.id,
        conflict=conflict.conflict,
        crash_types=conflict.stages,
        actor=actor.actor,
        ego_at_s=ego_at_s,
        actor_lag_s=lag_s,
        met=encounter,
        resolution=resolution,
        parameters=parameters,
        missed=missed,
    )


def _build_ego_lane(spec: Spec) -> StationedPolyline:
    path, _, _ = build_ego_path(RoutePlanner(spec.road), spec.road.ego)
    return path.line


def _build_actor_path(spec: Spec, conflict: StagedConflict) -> StationedPolyline:
    actor = conflict.actors[0]
    if actor.route:
        return RoutePlanner(spec.road).build_path(actor.route, actor.lane).line
    path = StationedPolyline.from_points(np.array(actor.path_m))
    return go_straight_on(path) if actor.behaviour == "steers_clear" else path


def _measure_since_red_s(
    spec: Spec, conflict: StagedConflict, actor: ActorTrack, trace: Trace
) -> float:
    """Measure how long the actor's light has been red when its front is at the line.

    Negative before red; infinite if the conflict declares no light, or it is never red.
    """
    if conflict.light is None:
        return float("inf")
    fronts = actor.centres + actor.size[0] / 2 * actor.axes[:, 0]
    line = _find_line(spec, conflict)
    at = actor.rows["tick"][np.argmin(np.linalg.norm(fronts - line, axis=1))]
    red = trace.signals[:, trace.signal_ids.index(conflict.light)] == Signal.RED
    begins = np.flatnonzero(red & ~np.concatenate([[False], red[:-1]]))
    if len(begins) == 0:
        return float("inf")
    return float(at - begins[np.argmin(np.abs(begins - at))]) * trace.tick_s


def _find_line(spec: Spec, conflict: StagedConflict) -> NDArray[np.float64]:
    """Find the end (2,) of the street by which an actor enters the junction."""
    actor = conflict.actors[0]
    if not actor.route:
        return np.array(actor.path_m[1])
    path = RoutePlanner(spec.road).build_path(actor.route, actor.lane)
    return path.point_at(path.segments[0].end_m)


def _find_deviations(
    conflict: StagedConflict, encounter: Encounter, resolution: Resolution, lag_s: float
) -> Iterator[str]:
    outcome, offset_s = conflict.outcome, conflict.parameters["arrival_offset_s"]
    collides = conflict.resolved_by == "nobody"
    if (resolution.impact is not None) != collides:
        yield "they do not touch" if collides else "they touch"
    if needs_reaction(conflict) and not resolution.ego_evades:
        yield f"the ego neither steers nor brakes with {EVASIVE_BRAKING_M_S2:g} m/s2"
    if abs(lag_s - offset_s) > outcome.arrival_tolerance_s:
        yield f"the actor comes {lag_s:.2f} s after the ego instead of {offset_s:.2f} s"
    collision = {
        "way": encounter.time_to_collision_on_way_s,
        "velocity": encounter.time_to_collision_s,
    }[outcome.keeping]
    if collision is None or collision.value >= outcome.time_to_collision_below_s:
        limit = f"{outcome.time_to_collision_below_s:g} s"
        yield f"time to collision {_format_metric(collision)} is not below {limit}"
    gap = encounter.post_encroachment_s
    # If both stop, the ego may arrive before the actor goes on.
    may_lack_gap = collides or (gap is None and conflict.resolved_by == "both")
    if outcome.post_encroachment_s is not None and not may_lack_gap:
        low, high = outcome.post_encroachment_s
        if gap is None or not low <= gap.value <= high:
            limits = f"{low:g} to {high:g} s"
            yield f"post-encroachment time {_format_metric(gap)} is not within {limits}"


def _format_metric(metric: MetricAtTick | None) -> str:
    return "(none)" if metric is None else f"{metric.value:.2f} s"


def _find_meeting_point(
    conflict: StagedConflict, ego: ActorTrack, actor_path: shapely.LineString
) -> NDArray[np.float64]:
    """Find where (2,) the ego crosses the actor's path; the declared point if it does not."""
    point = None
    if conflict.outcome.keeping == "way":
        point = find_crossing(actor_path, ego, conflict.point_m)
    return np.array(conflict.point_m) if point is None else point


def _find_actor_arrival_s(
    conflict: StagedConflict,
    ego: ActorTrack,
    actor: ActorTrack,
    point_m: NDArray[np.float64],
    ego_at_s: float,
    tick_s: float,
) -> float:
    """Find when an actor is at a point, or would be had it not stopped short of the ego."""
    row, left_m = _find_arrival(conflict, ego, actor, point_m)
    stops_short = conflict.actors[0].behaviour == "stops_short"
    last = _find_steady_row(actor, ego_at_s, tick_s) if stops_short else row
    if last is None:
        return float("inf")
    rows = actor.rows
    left_m += rows["travelled"][row] - rows["travelled"][last]
    return float(rows["tick"][last] * tick_s + left_m / max(rows["speed"][last], 0.1))


def _find_arrival(
    conflict: StagedConflict, ego: ActorTrack, actor: ActorTrack, point_m: NDArray[np.float64]
) -> tuple[int, float]:
    """Find the row in which an actor is nearest to a point, and its distance before it in metres.

    An actor in an adjacent lane arrives when it is level with the point.
    """
    gaps = point_m - actor.centres
    near = np.linalg.norm(gaps, axis=1) < ADJACENT_LANE_GAP_M
    if conflict.outcome.keeping != "velocity" or not near.any():
        row = actor.find_nearest_row(point_m)
        return row, float(gaps[row] @ actor.axes[row, 0])
    along = ego.axes[ego.find_nearest_row(point_m), 0]
    row = int(np.argmin(np.where(near, np.abs(gaps @ along), np.inf)))
    cosine = float(actor.axes[row, 0] @ along)
    return row, float(gaps[row] @ along / np.copysign(max(abs(cosine), LEAST_COSINE), cosine))


def _find_ego_arrival_s(
    spec: Spec,
    conflict: StagedConflict,
    encounter: Encounter,
    ego: ActorTrack,
    point_m: NDArray[np.float64],
    lane: StationedPolyline,
    tick_s: float,
) -> float:
    """Find when the ego is at a point, or would be had it not braked for the actor.

    SUMO's speeds apply to the front axle, which turns on a wider curve than the centre. So the
    remaining path is the axle's; the lane if the ego steers aside.
    """
    place = spec.ego.place
    last = find_undisturbed_row(encounter, ego, tick_s)
    if conflict.resolved_by == "actor" or last is None or not isinstance(place, Vehicle):
        return ego.find_passing_tick(point_m) * tick_s
    axles = ego.centres + WHEELBASE_FRACTION / 2 * ego.size[0] * ego.axes[:, 0]
    row = ego.find_nearest_row(point_m)
    is_aside = conflict.actors[0].behaviour == "drifts"
    path = lane if is_aside else StationedPolyline.from_points(drop_repeated_points(axles))
    begin_m, _ = path.project_point(axles[last])
    end_m, _ = path.project_point(axles[row] + point_m - ego.centres[row])
    left_s = compute_free_drive_s(
        place,
        path,
        begin_m,
        end_m,
        actor_class=spec.blueprints[spec.ego.blueprint or ""].actor_class,
        first_m_s=float(np.linalg.norm(np.gradient(axles, tick_s, axis=0)[last])),
        top_m_s=conflict.parameters.get("ego_speed_km_h", np.inf) / KM_H_PER_M_S,
    )
    return float(ego.rows["tick"][last]) * tick_s + left_s


def _find_steady_row(actor: ActorTrack, ego_at_s: float, tick_s: float) -> int | None:
    """Find the last row of an actor's approach before it brakes; None if it has not arrived."""
    approach = select_before(actor, ego_at_s, APPROACH_WINDOW_S, tick_s)
    if len(approach) == 0:
        return None
    speeds = actor.rows["speed"][approach]
    return int(approach[np.flatnonzero(speeds >= STEADY_SPEED_RATIO * speeds.max())[-1]])
