"""What SUMO did, tick by tick, and the trace that is made of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl import Road, Spec
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.traffic.bumpers import vehicle_states, walker_states
from advercity.traffic.demand import Demand
from advercity.traffic.trace import Actor, Trace
from advercity.world.roads import built
from advercity.world.surface import KERB_HEIGHT_M

Kerb = Callable[[NDArray[np.complex128]], NDArray[np.float64]]


@dataclass(frozen=True)
class Recording:
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

    def with_tracks(self, tracks: Mapping[int, NDArray[np.void]]) -> "Recording":
        """The same with some actors added or moved."""
        return replace(self, tracks={**self.tracks, **tracks})


def trace_of(spec: Spec, demand: Demand, recording: Recording, *, first: int) -> Trace:
    """A recording from tick `first` on, bodies in place of front bumpers."""
    kerb = kerb_of(spec.road)
    tick_s = spec.timing.tick_s
    speeds = {walk.actor.id: walk.speed_m_s for walk in demand.walkers}
    known = {actor.id: actor for actor in demand.actors}
    actors: list[Actor] = []
    states: list[NDArray[np.void]] = []
    for number, track in sorted(recording.tracks.items()):
        actor = known[number]
        if actor.actor_class == "pedestrian":
            speed = speeds[number] if number in speeds else float(track["speed"].max())
            kept = walker_states(track, actor.size[0], speed_m_s=speed, tick_s=tick_s, kerb=kerb)
        else:
            kept = vehicle_states(track, actor.size[0], tick_s=tick_s)
            if actor.actor_class == "bicycle":
                kept["lamps"] = 0
        kept = kept[kept["tick"] >= first]
        if len(kept) > 0:
            kept["tick"] -= first
            kept["actor"] = len(actors)
            actors.append(actor)
            states.append(kept)
    if not states:
        raise RunError("a connected vehicle arrives during the warm-up; move it back")
    together = np.concatenate(states)
    return Trace(
        tick_s=tick_s,
        first_tick=first,
        actors=tuple(actors),
        states=together[np.lexsort((together["actor"], together["tick"]))],
        signal_ids=recording.signal_ids,
        signals=recording.signals[first:],
    )


def kerb_of(road: Road) -> Kerb:
    """Height of a sidewalk above the roadway for places on foot, 0 on the roadway."""
    roadway = built(road).kerbless
    shapely.prepare(roadway)
    return lambda places: np.where(
        shapely.contains_xy(roadway, places.real, places.imag), 0.0, KERB_HEIGHT_M
    )
