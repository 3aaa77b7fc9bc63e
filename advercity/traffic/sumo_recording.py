"""A recording of SUMO's actors by their front bumpers, and its trace of bodies."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.frames import Actor, Trace
from advercity.traffic.banking import build_lean
from advercity.traffic.body_states import round_states
from advercity.traffic.demand import TrafficDemand
from advercity.traffic.vehicle_motion import compute_lorry_states, compute_vehicle_states
from advercity.traffic.walking_motion import (
    STAGED_WALKING_SMOOTHING_TICKS,
    WALKING_SMOOTHING_TICKS,
    build_kerb_height,
    compute_walker_states,
)


@dataclass(frozen=True)
class SumoRecording:
    """The front bumpers of all actors and all lights, from the first tick of the warm-up on.

    Attributes:
        tracks: `FRONT_DTYPE` rows by actor, sorted by tick.
        signal_ids: Ids of `SignalLamp`.
        signals: (ticks, signals) uint8 of `Signal`.
        bodies: `STATE_DTYPE` rows by actor, for bodies computed before.
        arrived: Connected vehicles whose arrival ended the run; none if time was up.
    """

    tracks: Mapping[int, NDArray[np.void]]
    signal_ids: tuple[str, ...]
    signals: NDArray[np.uint8]
    bodies: dict[int, NDArray[np.void]] = field(default_factory=dict)
    arrived: frozenset[int] = frozenset()

    def __len__(self) -> int:
        """Return the number of ticks, warm-up included."""
        return len(self.signals)

    def with_tracks(self, tracks: Mapping[int, NDArray[np.void]]) -> "SumoRecording":
        """Add or replace the tracks of some actors."""
        bodies = {number: rows for number, rows in self.bodies.items() if number not in tracks}
        return replace(self, tracks={**self.tracks, **tracks}, bodies=bodies)


def build_trace(
    spec: Spec, demand: TrafficDemand, recording: SumoRecording, *, first_tick: int
) -> Trace:
    """Build the trace of a recording from a tick on, with bodies in place of front bumpers.

    Raises:
        RunError: No actor is left at that tick.
    """
    known = {actor.id: actor for actor in demand.actors}
    _compute_bodies(spec, demand, recording, known)
    actors: list[Actor] = []
    states: list[NDArray[np.void]] = []
    for number, rows in sorted(recording.bodies.items()):
        # Cut off the warm-up only now: axles and people's turns depend on earlier ticks.
        rows = rows[rows["tick"] >= first_tick]
        if len(rows) > 0:
            rows["tick"] -= first_tick
            rows["actor"] = len(actors)
            actors.append(known[number])
            states.append(rows)
    if not states:
        raise RunError("a connected vehicle arrives during the warm-up; move it back")
    together = np.concatenate(states)
    return Trace(
        tick_s=spec.timing.tick_s,
        first_tick=first_tick,
        actors=tuple(actors),
        states=round_states(together[np.lexsort((together["actor"], together["tick"]))]),
        signal_ids=recording.signal_ids,
        signals=recording.signals[first_tick:],
    )


def _compute_bodies(
    spec: Spec, demand: TrafficDemand, recording: SumoRecording, actors: Mapping[int, Actor]
) -> None:
    """Add the missing bodies of a recording; traces from several first ticks share them."""
    kerb_height, lean = build_kerb_height(spec.road), build_lean(spec.road, spec.timing.tick_s)
    speeds = {trip.actor.id: trip.speed_m_s for trip in demand.walkers}
    lorries = {trip.actor.id: trip for trip in demand.vehicles if trip.trailer}
    for number in recording.tracks.keys() - recording.bodies.keys():
        track, actor = recording.tracks[number], actors[number]
        if actor.actor_class == "pedestrian":
            # A staged pedestrian has no walking speed of its own, but the speed of its track.
            speed = speeds[number] if number in speeds else float(track["speed"].max())
            rows = compute_walker_states(
                track,
                actor.size[0],
                speed_m_s=speed,
                tick_s=spec.timing.tick_s,
                kerb_height=kerb_height,
                smoothing_ticks=(
                    WALKING_SMOOTHING_TICKS if number in speeds else STAGED_WALKING_SMOOTHING_TICKS
                ),
            )
        elif number in lorries and (trailer := lorries[number].trailer):
            rows, recording.bodies[trailer.actor.id] = compute_lorry_states(
                track,
                actor.size[0],
                trailer,
                tick_s=spec.timing.tick_s,
                trailer_heading_rad=lorries[number].trailer_heading_rad,
                lean=lean,
            )
        else:
            rows = compute_vehicle_states(
                track, actor.size[0], tick_s=spec.timing.tick_s, lean=lean
            )
            if actor.actor_class == "bicycle":
                rows["lamps"] = 0
        recording.bodies[number] = rows
