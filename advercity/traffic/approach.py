"""How a staged actor times its approach: it comes as if to meet the ego, and stops just short."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import StagedActor
from numpy.typing import NDArray

from advercity.traffic.encounters import Track
from advercity.traffic.paths import Path

CLEARANCE_M = 0.6
"""Between a stopped actor and where the ego drives."""
PROBE_M = 0.1
BEFORE_S, AFTER_S = 6.0, 5.0
"""Part of the ego's way, around its time at the point, that the actor keeps clear of."""
MERGED_S = 1.5
"""An actor that goes on in the ego's lane lets it go first by this."""
MUST_PASS_M = 8.0
"""Nearer than this to the declared point the ways have to meet."""
JOINS_M = 1.0
"""Ways that come nearer than this without crossing join."""


@dataclass(frozen=True)
class Meeting:
    """Where and when the ego crosses an actor's path.

    Attributes:
        point: (2,) where the ways cross.
        distance_m: Along the actor's path from its start to the point.
        ego_s: When the ego's middle is there.
        stop_m: Along the path, up to where the actor is clear of the ego.
        clear_s: When the ego is out of the actor's way.
    """

    point: NDArray[np.float64]
    distance_m: float
    ego_s: float
    stop_m: float
    clear_s: float


def crossing(
    line: shapely.LineString, ego: Track, point: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Where (2,) the ego's recorded way crosses a line, or else joins it; None if it does not.

    Of several crossings it is the one nearest to `point`; beyond `MUST_PASS_M` there is none.
    """
    parts = shapely.get_parts(shapely.intersection(line, shapely.LineString(ego.middles)))
    places = [shapely.get_coordinates(part)[0] for part in parts if not part.is_empty]
    nearest = _nearest(places, point)
    if nearest is not None:
        return nearest
    gaps = shapely.distance(line, shapely.points(ego.middles))
    if gaps.min() > JOINS_M:
        return None
    joins = shapely.Point(ego.middles[np.argmax(gaps <= max(JOINS_M / 2, gaps.min()))])
    on_line = shapely.get_coordinates(line.interpolate(line.project(joins)))[0]
    return _nearest([on_line], point)


def _nearest(
    places: Sequence[NDArray[np.float64]], point: tuple[float, float]
) -> NDArray[np.float64] | None:
    gaps = [float(np.linalg.norm(place - np.array(point))) for place in places]
    return places[int(np.argmin(gaps))] if min(gaps, default=np.inf) <= MUST_PASS_M else None


def meeting(
    path: Path,
    size: tuple[float, float, float],
    ego: Track,
    point: tuple[float, float],
    tick_s: float,
) -> Meeting | None:
    """Where the ego's recorded way meets a path, near a declared point; None if it does not."""
    here = crossing(path.line, ego, point)
    if here is None:
        return None
    way, place = shapely.LineString(ego.middles), shapely.Point(here)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ego.middles, axis=0), axis=1))])
    ego_s = float(np.interp(way.project(place), along, ego.rows["tick"])) * tick_s
    distance = path.line.project(place)
    near = (
        np.abs(ego.rows["tick"] * tick_s - ego_s - (AFTER_S - BEFORE_S) / 2)
        <= (BEFORE_S + AFTER_S) / 2
    )
    swept = shapely.union_all(ego.boxes[near])
    probes = np.arange(0.0, distance, PROBE_M)
    free = shapely.distance(path.boxes(probes, size), swept) > CLEARANCE_M
    stop = float(probes[np.argmin(free)]) - PROBE_M if not free.all() else distance
    corridor = path.between(max(stop, 0.0), path.length_m).buffer(size[1] / 2, cap_style="flat")
    inside = shapely.intersects(ego.boxes, corridor) & near
    last = float(ego.rows["tick"][inside].max(initial=0)) * tick_s
    return Meeting(
        point=here,
        distance_m=distance,
        ego_s=ego_s,
        stop_m=max(stop, 0.0),
        clear_s=min(last, ego_s + MERGED_S + size[0] / 5),
    )


def braked(
    met: Meeting,
    actor: StagedActor,
    length_m: float,
    *,
    offset_s: float,
    encroach_s: float,
    tick_s: float,
    ticks: int,
) -> tuple[NDArray[np.float64], float]:
    """Stations (ticks,) along the path of one who stops short of the ego and goes on after it.

    Had it not braked, it would be at the point `offset_s` after the ego.

    Args:
        met: Where and when.
        actor: Its speed, acceleration and braking.
        length_m: Where the path ends.
        offset_s: As above; negative before the ego.
        encroach_s: From the ego's leaving the actor's way to the actor's coming into the ego's.
        tick_s: Length of a tick.
        ticks: How many.

    Returns:
        Stations, and when it sets out again.
    """
    speed, gains, loses = actor.speed_m_s, actor.acceleration_m_s2, actor.braking_m_s2
    start_s = met.ego_s + offset_s - met.distance_m / speed - speed / (2 * gains)
    go_s = met.clear_s + encroach_s - np.sqrt(2 * CLEARANCE_M / gains)
    first = int(np.floor(min(start_s, 0.0) / tick_s))
    stations: list[float] = []
    here = pace = 0.0
    for tick in range(first, ticks):
        now = tick * tick_s
        goes = now >= go_s
        halt = length_m if goes else met.stop_m
        wanted = min(speed, pace + gains * tick_s) if now >= start_s else 0.0
        room = max(halt - here - wanted * tick_s / 2, 0.0)
        pace = max(min(wanted, np.sqrt(2 * loses * room)), 0.0)
        pace = min(pace, max(halt - here, 0.0) / tick_s)
        here += pace * tick_s
        if tick >= 0:
            stations.append(here)
    return np.array(stations), go_s


def passed(
    path: Path, ego: Track, point: tuple[float, float], tick_s: float
) -> tuple[float, float]:
    """When the ego passes a point, and how far along a path that is whose last leg runs beside."""
    nearest = int(np.argmin(np.linalg.norm(ego.middles - point, axis=1)))
    leg = shapely.LineString(path.points[-2:])
    beside = float(path.stations_m[-2]) + leg.project(shapely.Point(point))
    return float(ego.rows["tick"][nearest]) * tick_s, beside
