"""Plan the ego's reaction to a staged actor: when it perceives it, brakes, and drives on.

Like the actor, the ego brakes as late as its deceleration permits on a dry road, later if it sees
the actor too late, and no harder than the friction permits. For an actor that drifts into its
lane it brakes and steers aside.
"""

from dataclasses import dataclass, field

import numpy as np
import shapely
from advercity_dsl import Spec, StagedConflict
from advercity_dsl.traffic import ReactionConditions
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.trajectories import (
    QUINTIC_PEAK_ACCELERATION,
    PathCrossing,
    compute_lateral_offsets,
    compute_path_crossing,
    find_closest_approach,
)
from advercity.errors import RunError, StagingError
from advercity.frames import Trace
from advercity.geometry.polyline import (
    StationedPolyline,
    drop_repeated_points,
    polyline_stations,
)
from advercity.physics.constants import GRAVITY_M_S2
from advercity.physics.stopping import REACTION_TIME_S

LEAST_BRAKING_S = 1.0
"""Minimum time for which the ego brakes, even if the actor stops sooner."""
RESTART_M_S2 = 2.0
"""Expected acceleration of the ego when it drives on."""
COMMANDED_AROUND_S = 3.0
"""Time before and after the meeting for which an ego without reaction is commanded."""
OPAQUE_CLASSES = ("car", "van", "truck")
"""Classes of actors that hide others."""
STANDSTILL_M_S = 0.05
PASSING_GAP_M = 0.4
"""Distance at which the ego passes an actor drifting into its lane."""
MIN_SHIFT_M = 0.4
"""Minimum distance by which a driver moves aside for a vehicle over the centre line."""
STEERING_TIME_S = 2.0
"""Time of the ego to move aside, if there is as much, and to return; longer with little grip."""
BRAKING_SHARE = 0.7
"""Maximum fraction of the grip for braking while steering."""
HOLD_ASIDE_S = 0.8
"""Time for which the ego stays aside after the passing."""


@dataclass(frozen=True, eq=False)
class EgoReaction:
    """The ego's reaction to a staged actor.

    Attributes:
        speed_commands_m_s: Speed (ticks,) of the ego; NaN leaves it to SUMO's driver.
        crossing: Where and when it would have met the actor it brakes for.
        offsets_m: Offsets (ticks,) to the left of its lane; empty if it only brakes.
        hidden_by: Ids of actors that hid the other until it was too late to brake.
    """

    speed_commands_m_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    crossing: PathCrossing | None = None
    offsets_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    hidden_by: frozenset[int] = frozenset()


class HeldUpActorError(StagingError):
    """Other traffic keeps the actor from the path of the ego, which is to brake for it."""


def needs_reaction(conflict: StagedConflict) -> bool:
    """Return whether the ego takes part in resolving a conflict."""
    return conflict.resolved_by in ("ego", "both")


def needs_plan(conflict: StagedConflict) -> bool:
    """Return whether a conflict needs a plan for the ego: its reaction, or to drive on.

    Without a plan, SUMO's driver gives way to an actor in lanes.
    """
    actor = conflict.actors[0]
    collides = conflict.resolved_by == "nobody" and actor.behaviour == "stops_short"
    return needs_reaction(conflict) or (collides and bool(actor.route))


def plan_reaction(
    spec: Spec, conflict: StagedConflict, trace: Trace, crossing: PathCrossing | None
) -> EgoReaction:
    """Plan how the ego brakes or steers for the actor of a conflict, or drives on.

    Args:
        spec: The scenario.
        conflict: The conflict.
        trace: All ticks of a dry run in which the ego does not react to this actor.
        crossing: Where and when their paths cross in it; None if they run side by side.

    Raises:
        HeldUpActorError: The actor does not reach the path of the ego, which is to brake for it.
        RunError: The spec lacks `reaction`, or the paths do not cross.
    """
    if conflict.resolved_by == "nobody":
        return _plan_driving_on(spec, trace, crossing)
    if spec.reaction is None:
        raise RunError(f"{spec.id}: lacks what the ego reacts with (`reaction`)")
    if conflict.actors[0].behaviour == "drifts":
        return _plan_steering(spec, conflict, trace, spec.reaction)
    return _plan_braking(spec, conflict, trace, spec.reaction, crossing)


def _plan_driving_on(spec: Spec, trace: Trace, crossing: PathCrossing | None) -> EgoReaction:
    """Have the ego drive as in the run in which the actor gave way to it."""
    _, rows = trace.get_track(spec.ego.number)
    times_s = rows["tick"] * trace.tick_s - (crossing.ego_s if crossing else np.inf)
    kept = (times_s > -COMMANDED_AROUND_S) & (times_s < COMMANDED_AROUND_S)
    speeds = np.full(len(trace) + 1, np.nan)
    speeds[rows["tick"][kept]] = rows["speed"][kept]
    return EgoReaction(speed_commands_m_s=speeds, crossing=crossing)


def _plan_steering(
    spec: Spec, conflict: StagedConflict, trace: Trace, conditions: ReactionConditions
) -> EgoReaction:
    """Plan how far the ego moves to the right, and when, for an actor over the centre line."""
    ego = ActorTrack.from_trace(trace, spec.ego.number)
    actor = ActorTrack.from_trace(trace, conflict.actors[0].number)
    passing, _ = find_closest_approach(ego, actor)
    passing_s = passing * trace.tick_s
    driven = shapely.LineString(ego.centres)
    coming = actor.rows["tick"] <= passing
    apart_m = np.asarray(shapely.distance(driven, shapely.points(actor.centres[coming])))
    is_over = apart_m < apart_m.min() + conflict.parameters["encroachment_m"]
    over_s = float(actor.rows["tick"][np.argmax(is_over)]) * trace.tick_s
    seen_s, _ = find_perception(trace, ego, actor, conditions, until_s=passing_s)
    gap_m = apart_m.min() - (ego.size[1] + actor.size[1]) / 2
    shift_m = max(PASSING_GAP_M - gap_m, MIN_SHIFT_M)
    begin_s = max(over_s, seen_s) + REACTION_TIME_S
    times_s = ego.rows["tick"] * trace.tick_s
    grip_m_s2 = conditions.friction * GRAVITY_M_S2
    braking_m_s2 = min(conflict.parameters.get("ego_braking_m_s2", 0.0), grip_m_s2 * BRAKING_SHARE)
    lateral_m_s2 = np.sqrt(grip_m_s2**2 - braking_m_s2**2)
    shortest_s = np.sqrt(QUINTIC_PEAK_ACCELERATION * shift_m / lateral_m_s2)
    longest_s = max(STEERING_TIME_S, shortest_s)
    steers_s = float(np.clip(passing_s - HOLD_ASIDE_S / 2 - begin_s, shortest_s, longest_s))
    offsets = compute_lateral_offsets(
        trace.tick_s * np.arange(spec.timing.max_ticks + 1, dtype=np.float64),
        shift_m=-shift_m,
        out_s=steers_s,
        hold_s=max(passing_s + HOLD_ASIDE_S - begin_s - steers_s, 0.0),
        return_s=longest_s,
        end_s=max(passing_s + HOLD_ASIDE_S, begin_s + steers_s) + longest_s,
    )
    braking = (times_s > begin_s) & (times_s <= passing_s) & (braking_m_s2 > 0)
    own, first = ego.rows["speed"], int(np.argmax(braking))
    slowed = np.minimum(own, own[first] - braking_m_s2 * (times_s - times_s[first]))
    return EgoReaction(
        speed_commands_m_s=_build_commands(ego, np.where(braking, np.maximum(slowed, 0.0), np.nan)),
        offsets_m=offsets,
    )


def _build_commands(ego: ActorTrack, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Build commands (ticks,) from speeds at the ego's rows; NaN leaves it to SUMO's driver."""
    return np.concatenate([np.full(int(ego.rows["tick"][0]), np.nan), speeds, [np.nan]])


def _plan_braking(
    spec: Spec,
    conflict: StagedConflict,
    trace: Trace,
    conditions: ReactionConditions,
    crossing: PathCrossing | None,
) -> EgoReaction:
    if crossing is None:
        raise RunError(f"{conflict.id} ({conflict.conflict}): the ego does not cross the actor")
    ego = ActorTrack.from_trace(trace, spec.ego.number)
    actor = ActorTrack.from_trace(trace, conflict.actors[0].number)
    path = StationedPolyline.from_points(drop_repeated_points(ego.centres))
    length_m, width_m = ego.size.tolist()
    at = int(np.searchsorted(ego.rows["tick"] * trace.tick_s, crossing.ego_s))
    point = tuple(ego.centres[min(at, len(ego.rows) - 1)].tolist())
    meeting = compute_path_crossing(path, (length_m, width_m, 0.0), actor, point, trace.tick_s)
    if meeting is None:
        raise HeldUpActorError(
            f"{conflict.id} ({conflict.conflict}): other traffic keeps the actor from the ego's"
            " path; lower the density or take other seeds.traffic"
        )
    perceived_s, hidden_by = find_perception(trace, ego, actor, conditions, until_s=crossing.ego_s)
    hardest_m_s2 = conditions.friction * GRAVITY_M_S2
    speeds = compute_braking_speeds(
        ego,
        stop_m=meeting.stop_m,
        braking_m_s2=conflict.parameters["ego_braking_m_s2"],
        hardest_m_s2=hardest_m_s2,
        earliest_s=perceived_s + REACTION_TIME_S,
        tick_s=trace.tick_s,
    )
    first_s = float(np.argmin(np.isnan(speeds))) * trace.tick_s
    if conflict.resolved_by == "ego":
        go_s = meeting.clear_s + conflict.parameters["post_encroachment_s"]
        go_s -= np.sqrt(2 * (meeting.enter_m - meeting.stop_m) / RESTART_M_S2)
    else:
        go_s = _find_halt_s(actor, first_s, crossing.clear_s, trace.tick_s)
    # The friction of the tyres does not suffice, or the actor has stopped by then.
    hardest = np.nanmin(np.diff(speeds)) < -(hardest_m_s2 - 0.01) * trace.tick_s
    is_late = bool(hardest) or go_s <= first_s + trace.tick_s
    go_s = max(go_s, first_s + LEAST_BRAKING_S)
    speeds[round(go_s / trace.tick_s) :] = np.nan
    return EgoReaction(
        speed_commands_m_s=speeds,
        crossing=crossing,
        hidden_by=hidden_by if is_late else frozenset(),
    )


def find_perception(
    trace: Trace,
    ego: ActorTrack,
    actor: ActorTrack,
    conditions: ReactionConditions,
    *,
    until_s: float,
) -> tuple[float, frozenset[int]]:
    """Find the time from which the ego sees an actor: near enough, and not behind a vehicle.

    The line of sight runs from centre to centre in the plane. Only times to `until_s` count.

    Returns:
        The time, and the ids of actors in the line of sight just before.
    """
    ticks = np.intersect1d(ego.rows["tick"], actor.rows["tick"])
    ticks = ticks[ticks * trace.tick_s <= until_s]
    eyes, seen = ego.at_ticks(ticks).centres, actor.at_ticks(ticks).centres
    hidden: NDArray[np.bool_] = np.zeros(len(ticks), dtype=bool)
    if conditions.visibility_m is not None:
        hidden = np.linalg.norm(seen - eyes, axis=1) > conditions.visibility_m
    hiders: dict[int, NDArray[np.bool_]] = {}
    sights = np.asarray(shapely.linestrings(np.stack([eyes, seen], axis=1)))
    for other in trace.actors:
        if other.actor_class in OPAQUE_CLASSES and other.id not in (ego.actor, actor.actor):
            track = ActorTrack.from_trace(trace, other.id)
            both = np.isin(ticks, track.rows["tick"])
            behind = np.zeros(len(ticks), dtype=bool)
            now = track.at_ticks(ticks[both])
            is_level = now.is_level_with(ego.at_ticks(ticks[both]))
            behind[both] = shapely.intersects(sights[both], now.boxes) & is_level
            hiders[other.id] = behind
            hidden |= behind
    if not hidden.any():
        return float(ticks[0]) * trace.tick_s, frozenset()
    last = int(np.flatnonzero(hidden)[-1])
    hidden_by = frozenset(number for number, behind in hiders.items() if behind[last])
    return float(ticks[min(last + 1, len(ticks) - 1)]) * trace.tick_s, hidden_by


def compute_braking_speeds(
    ego: ActorTrack,
    *,
    stop_m: float,
    braking_m_s2: float,
    hardest_m_s2: float,
    earliest_s: float,
    tick_s: float,
) -> NDArray[np.float64]:
    """Compute speeds (ticks,) of an ego stopping at a station; NaN before it brakes.

    Args:
        ego: Its track without braking; stations count from its first row.
        stop_m: Station at which its centre is to stop.
        braking_m_s2: Intended deceleration.
        hardest_m_s2: Maximum deceleration of its tyres.
        earliest_s: Time of the earliest reaction.
        tick_s: Time between ticks.
    """
    speeds = ego.rows["speed"].copy()
    room_m = stop_m - polyline_stations(ego.centres)
    needs = room_m < speeds * tick_s + speeds**2 / (2 * braking_m_s2)
    first = int(np.argmax(needs & (ego.rows["tick"] * tick_s >= earliest_s)))
    needed_m_s2 = speeds[first] ** 2 / (2 * max(room_m[first], 0.1))
    deceleration = min(max(braking_m_s2, needed_m_s2), hardest_m_s2)
    after_s = tick_s * np.arange(1, len(speeds) - first + 1)
    speeds[first:] = np.maximum(speeds[first] - deceleration * after_s, 0.0)
    speeds[:first] = np.nan
    return _build_commands(ego, speeds)


def _find_halt_s(actor: ActorTrack, from_s: float, until_s: float, tick_s: float) -> float:
    """Find when an actor is first at a standstill between two times, or slowest."""
    times_s = actor.rows["tick"] * tick_s
    rows = np.flatnonzero((times_s > from_s) & (times_s <= max(until_s, from_s + 2 * tick_s)))
    speeds = actor.rows["speed"][rows]
    return float(times_s[rows[np.argmax(speeds < speeds.min() + STANDSTILL_M_S)]])
