"""A scenario's traffic as a moving plan."""

from collections.abc import Iterator

import cv2
import numpy as np
import shapely
from advercity_dsl import Spec
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.traffic.encounters import Track, time_to_collision_on_way
from advercity.traffic.trace import Signal, Trace
from advercity.world.plan import FONT, FONT_SCALE, INK, Canvas, Image, plan
from advercity.world.roads import built

COLOURS = {
    "car": (235, 235, 235),
    "van": (200, 225, 235),
    "truck": (150, 200, 240),
    "bicycle": (90, 200, 120),
    "motorcycle": (60, 200, 230),
    "pedestrian": (190, 90, 190),
}
"""BGR by class."""
CONNECTED = (220, 110, 30)
STAGED = (40, 40, 230)
LIGHTS = {Signal.RED: (40, 40, 230), Signal.YELLOW: (40, 210, 250), Signal.GREEN: (80, 200, 60)}
LIGHT_M = 1.4
NEAR_S = 5.0
"""Times to collision below this are told."""


def film(spec: Spec, trace: Trace) -> Iterator[Image]:
    """The plan of a spec's road with everybody on it, RGB, a picture per kept tick."""
    canvas = plan(spec.road)
    empty = canvas.image
    tracks = [Track.of(trace, actor.id) for actor in trace.actors]
    rows = np.concatenate([track.rows for track in tracks])
    corners = np.concatenate([track.corners for track in tracks])
    colours = _colours(spec, trace)
    lamps = {head.id: head.at_m[:2] for head in built(spec.road).heads}
    told = _meetings(spec, trace)
    for tick in range(len(trace)):
        canvas.image = empty.copy()
        for name, value in trace.frame(tick).signals.items():
            if name in lamps:
                canvas.fill(_square(lamps[name]), LIGHTS[value])
        for row in np.flatnonzero(rows["tick"] == tick):
            canvas.fill(corners[row], colours[int(rows["actor"][row])])
            canvas.line(corners[row][[0, 1, 2, 3, 0]], INK)
        lines = [f"{spec.id}   {tick * trace.tick_s:5.1f} s", *told[tick]]
        _write(canvas, lines)
        yield np.ascontiguousarray(canvas.image[..., ::-1])


def _colours(spec: Spec, trace: Trace) -> list[tuple[int, int, int]]:
    connected = {agent.number for agent in spec.agents}
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    return [
        CONNECTED
        if actor.id in connected
        else STAGED
        if actor.id in staged
        else COLOURS[actor.actor_class]
        for actor in trace.actors
    ]


def _meetings(spec: Spec, trace: Trace) -> list[list[str]]:
    """For every tick, how near the ego and the staged actors are to each other."""
    told: list[list[str]] = [[] for _ in range(len(trace))]
    ego = Track.of(trace, spec.ego.number)
    for conflict in spec.conflicts:
        actor = Track.of(trace, conflict.actors[0].number)
        ticks = np.intersect1d(ego.rows["tick"], actor.rows["tick"])
        gaps = shapely.distance(ego.at(ticks).boxes, actor.at(ticks).boxes)
        times = time_to_collision_on_way(ego, actor, ticks)
        for tick, gap, time in zip(ticks.tolist(), gaps.tolist(), times.tolist(), strict=True):
            ahead = f", collision in {time:.1f} s" if time < NEAR_S else ""
            told[tick].append(f"{conflict.conflict}: {gap:.1f} m{ahead}")
    return told


def _square(at: Point2) -> NDArray[np.float64]:
    return np.asarray(at) + LIGHT_M / 2 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])


def _write(canvas: Canvas, lines: list[str]) -> None:
    for index, words in enumerate(lines):
        place = (16, 28 + 24 * index)
        cv2.putText(canvas.image, words, place, FONT, 1.3 * FONT_SCALE, INK, 1, cv2.LINE_AA)
