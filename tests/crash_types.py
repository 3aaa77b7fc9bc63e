"""An independent name for an encounter: NHTSA's type by geometry, and who ran a red light.

It looks at a trace and at where streets end, not at what a spec declares, and shares no code with
the program.
"""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Road
from numpy.typing import NDArray
from sumolib.net import Net

from advercity.frames import Signal, Trace

TOUCHING_M = 1.5
"""Centres nearer than this are in one place."""
TURN_DEG = 18.0
APPROACH_M, DEPARTURE_M = 20.0, 12.0
"""Where directions are compared: before the meeting and after it."""
STOP_LINE_M = 3.0


@dataclass(frozen=True)
class Track:
    """Where one actor is (n, 2) at ticks (n,), and where it heads, degrees."""

    ticks: NDArray[np.int32]
    places: NDArray[np.float64]
    headings: NDArray[np.float64]
    actor_class: str

    @staticmethod
    def of(trace: Trace, number: int) -> "Track":
        actor, rows = trace.get_track(number)
        places = np.column_stack([rows["x"], rows["y"]])
        return Track(rows["tick"], places, np.degrees(rows["yaw"]), actor.actor_class)

    def heading_at(self, row: int, ahead_m: float) -> float:
        """Its heading some metres along its way from a row."""
        steps = np.linalg.norm(np.diff(self.places, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        return float(np.interp(along[row] + ahead_m, along, np.unwrap(self.headings, period=360)))


def turned_deg(angle: float) -> float:
    """An angle within -180 and 180 degrees."""
    return (angle + 180) % 360 - 180


def find_meeting(ego: Track, actor: Track) -> tuple[int, int]:
    """The rows in which both are in one place, or nearest, with the least time in between."""
    apart_m = np.linalg.norm(ego.places[:, None] - actor.places[None], axis=2)
    apart_ticks = np.abs(ego.ticks[:, None] - actor.ticks[None])
    cost = np.where(apart_m < TOUCHING_M, apart_ticks, 1e3 + 100 * apart_m + apart_ticks)
    first, second = np.unravel_index(np.argmin(cost), cost.shape)
    return int(first), int(second)


def name_crash_type(trace: Trace, ego_number: int, actor_number: int) -> str:
    """NHTSA's type of 2019, as the ego or the actor may be the subject."""
    ego, actor = Track.of(trace, ego_number), Track.of(trace, actor_number)
    here, there = find_meeting(ego, actor)
    before = ego.heading_at(here, -APPROACH_M)
    turn = turned_deg(ego.heading_at(here, DEPARTURE_M) - before)
    if actor.actor_class in ("pedestrian", "bicycle"):
        first = 9 if actor.actor_class == "pedestrian" else 11
        return f"nhtsa2019:{first + (abs(turn) < TURN_DEG)}"
    comes = actor.heading_at(there, -APPROACH_M)
    actor_turn = turned_deg(actor.heading_at(there, DEPARTURE_M) - comes)
    bearing = turned_deg(comes - before)
    if abs(bearing) > 135:
        if max(turn, actor_turn) > TURN_DEG:
            return "nhtsa2019:30"
        return (
            "nhtsa2019:18" if passes_anybody(trace, actor_number, actor, there) else "nhtsa2019:19"
        )
    if abs(turn) < TURN_DEG:
        return "nhtsa2019:27"
    if turn < 0:
        return "nhtsa2019:25" if bearing < 0 else "nhtsa2019:26"
    return "nhtsa2019:28" if bearing < 0 else "nhtsa2019:29"


def passes_anybody(trace: Trace, number: int, actor: Track, row: int) -> bool:
    """Whether an actor gets ahead of one who goes the same way, to its right."""
    for other in trace.actors:
        if other.id == number:
            continue
        slower = Track.of(trace, other.id)
        ticks = np.intersect1d(actor.ticks[: row + 1], slower.ticks)
        if len(ticks) < 2:
            continue
        own, their = np.searchsorted(actor.ticks, ticks), np.searchsorted(slower.ticks, ticks)
        heading = np.radians(actor.headings[own])
        gap = slower.places[their] - actor.places[own]
        ahead = gap[:, 0] * np.cos(heading) + gap[:, 1] * np.sin(heading)
        right = gap[:, 0] * np.sin(heading) - gap[:, 1] * np.cos(heading)
        beside = np.abs(ahead) < 3
        if beside.any() and ahead[0] > 5 and ahead[-1] < -3 and 0.5 < right[beside].mean() < 5:
            return True
    return False


def runs_red(trace: Trace, road: Road | Net, number: int) -> bool:
    """Whether an actor drives from a street into a junction while its light is red."""
    return measure_red_s(trace, road, number) is not None


def measure_red_s(trace: Trace, road: Road | Net, number: int) -> float | None:
    """For how long a light is red when an actor drives past it; None if it does not.

    A road from a map declares no streets; its network has them.
    """
    track = Track.of(trace, number)
    for column, name in enumerate(trace.signal_ids):
        junction, street, *crossing = name.split("/")
        if crossing or street.startswith(":"):  # for pedestrians
            continue
        end, heading, half_m = (
            find_arm_end(road, street, junction)
            if isinstance(road, Net)
            else find_street_end(road, street, junction)
        )
        gaps = (track.places - end) @ (1, 1j) * np.exp(-1j * np.radians(heading))
        apart_m = np.where(np.abs(gaps.imag) < half_m, np.abs(gaps.real), np.inf)
        row = int(np.argmin(apart_m))
        enters = abs(turned_deg(track.headings[row] - heading)) < 45
        passes = 0 < row < len(apart_m) - 1 and apart_m[row] < STOP_LINE_M
        before = trace.signals[: track.ticks[row] + 1, column][::-1]
        if enters and passes and before[0] == Signal.RED:
            red = int(np.argmax(before != Signal.RED)) or len(before)
            return red * trace.tick_s
    return None


def measure_half_width_m(road: Road, street: str) -> float:
    """How wide the wider side of a street is between its sidewalks."""
    section = road.sections[road.streets[street].section]
    return max(
        sum(strip.width_m for strip in side if strip.kind != "sidewalk")
        for side in (section.left, section.right)
    )


def find_street_end(
    road: Road, street: str, junction: str
) -> tuple[NDArray[np.float64], float, float]:
    """Where a street meets a junction (2,), its direction there in degrees, and half its width."""
    drawn, half_m = road.streets[street], measure_half_width_m(road, street)
    place, heading = complex(*drawn.start_m), drawn.heading_deg
    if drawn.begins == junction:
        return np.array([place.real, place.imag]), heading + 180, half_m
    for part in drawn.path:
        data = part.model_dump()
        sign = 1 if data.get("turn") == "left" else -1
        bend = sign * np.degrees(data["arc_m"] / data["radius_m"]) if "arc_m" in data else 0.0
        length_m = data["line_m"] if "line_m" in data else data["arc_m"]
        for _ in range(100):
            place += length_m / 100 * np.exp(1j * np.radians(heading + bend / 200))
            heading += bend / 100
    return np.array([place.real, place.imag]), heading, half_m


def find_arm_end(net: Net, street: str, junction: str) -> tuple[NDArray[np.float64], float, float]:
    """The same of a street in a network, whose two directions are edges of their own."""
    edges = [net.getEdge(f"{street}{sign}") for sign in "+-" if net.hasEdge(f"{street}{sign}")]
    edge = next(edge for edge in edges if edge.getToNode().getID() == junction)
    before, end = np.array(edge.getShape()[-2:])[:, :2]
    east, north = end - before
    return (
        end,
        float(np.degrees(np.arctan2(north, east))),
        sum(lane.getWidth() for lane in edge.getLanes()),
    )
