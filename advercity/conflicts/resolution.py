"""Measure how a staged conflict was resolved: who braked how hard, or the speeds at impact."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from advercity_dsl.conflict import Resolver, StagedConflict
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack, Encounter

BRAKING_WINDOW_S = (3.0, 2.0)
"""Time before and after the lowest time to collision in which both may brake."""
EVASIVE_BRAKING_M_S2 = 2.5
"""Deceleration at and above which braking is evasive: for bends and lights drivers take 2 m/s²."""

EVASIVE_SHIFT_M = 0.3
"""Distance at and above which moving aside is evasive."""
COASTING_M_S2 = 0.5
"""Maximum deceleration of a vehicle without braking."""
ONSET_S = 0.4
"""Time within which a driver goes from acceleration to braking."""


@dataclass(frozen=True)
class Impact:
    """The first contact of a collision.

    Attributes:
        tick: Kept tick of the contact, the last of the trace.
        ego_speed_m_s: Speed of the ego.
        actor_speed_m_s: Speed of the actor.
        relative_speed_m_s: Length of the difference of both velocities.
    """

    tick: int
    ego_speed_m_s: float
    actor_speed_m_s: float
    relative_speed_m_s: float

    def __str__(self) -> str:
        """`ego 18, actor 34`: speeds in km/h."""
        ego, actor = (KM_H_PER_M_S * v for v in (self.ego_speed_m_s, self.actor_speed_m_s))
        return f"ego {ego:.0f}, actor {actor:.0f}"


@dataclass(frozen=True)
class Resolution:
    """How a staged conflict was resolved, as measured; part of `report.json`.

    Attributes:
        resolved_by: Who was to resolve it.
        ego_braking_m_s2: Maximum deceleration of the ego near the lowest time to collision.
        actor_braking_m_s2: The same of the actor.
        ego_aside_m: How far the ego moved aside for a drifting actor; None for other actors.
        impact: The collision, if the outlines touch.
    """

    resolved_by: Resolver
    ego_braking_m_s2: float
    actor_braking_m_s2: float
    ego_aside_m: float | None
    impact: Impact | None

    @property
    def ego_evades(self) -> bool:
        """Whether the ego brakes or steers out of the way."""
        brakes = self.ego_braking_m_s2 >= EVASIVE_BRAKING_M_S2
        return brakes or (self.ego_aside_m or 0.0) >= EVASIVE_SHIFT_M


def measure_resolution(
    conflict: StagedConflict,
    encounter: Encounter,
    ego: ActorTrack,
    actor: ActorTrack,
    lane: shapely.LineString,
    tick_s: float,
) -> Resolution:
    """Measure how the encounter of two whole tracks was resolved; `lane` is the ego's path."""
    ego_braking, actor_braking = (
        _round(-track.rows["acceleration"][_list_braking_rows(encounter, track, tick_s)].min())
        for track in (ego, actor)
    )
    aside_m = None
    if conflict.actors and conflict.actors[0].behaviour == "drifts":
        aside_m = _measure_shift_m(lane, encounter, ego, tick_s)
    impact = _find_impact(encounter, ego, actor)
    return Resolution(conflict.resolved_by, ego_braking, actor_braking, aside_m, impact)


def _measure_shift_m(
    lane: shapely.LineString, encounter: Encounter, ego: ActorTrack, tick_s: float
) -> float:
    """Measure how far the ego moves aside from its place in the lane before the meeting."""
    rows = _list_braking_rows(encounter, ego, tick_s)
    offsets_m = np.asarray(shapely.distance(lane, shapely.points(ego.centres[rows])))
    return _round(offsets_m.max() - offsets_m[0])


def find_undisturbed_row(encounter: Encounter, ego: ActorTrack, tick_s: float) -> int | None:
    """Find the last row of the ego before it brakes for the actor; None without hard braking.

    It begins to brake `ONSET_S` before it decelerates more than by coasting.
    """
    rows = _list_braking_rows(encounter, ego, tick_s)
    acceleration = ego.rows["acceleration"]
    hard = rows[acceleration[rows] < -EVASIVE_BRAKING_M_S2]
    if len(hard) == 0:
        return None
    nearest = np.argmin(np.abs(ego.rows["tick"][hard] - _find_nearest_tick(encounter)))
    usual = np.flatnonzero(acceleration[: hard[nearest]] >= -COASTING_M_S2)
    return max(int(usual[-1]) - round(ONSET_S / tick_s), 0) if len(usual) else 0


def _list_braking_rows(encounter: Encounter, track: ActorTrack, tick_s: float) -> NDArray[np.intp]:
    before, after = (round(time_s / tick_s) for time_s in BRAKING_WINDOW_S)
    ticks = track.rows["tick"] - _find_nearest_tick(encounter)
    return np.flatnonzero((ticks >= -before) & (ticks <= after))


def _find_nearest_tick(encounter: Encounter) -> int:
    return (encounter.time_to_collision_on_way_s or encounter.distance_m).tick


def _find_impact(encounter: Encounter, ego: ActorTrack, actor: ActorTrack) -> Impact | None:
    if encounter.distance_m.value > 0:
        return None
    at = np.array([encounter.distance_m.tick])
    own, other = ego.at_ticks(at), actor.at_ticks(at)
    return Impact(
        tick=encounter.distance_m.tick,
        ego_speed_m_s=_round(own.rows["speed"][0]),
        actor_speed_m_s=_round(other.rows["speed"][0]),
        relative_speed_m_s=_round(np.linalg.norm(own.velocities - other.velocities)),
    )


def _round(value: float | np.floating[Any]) -> float:
    return round(float(value), 3)
