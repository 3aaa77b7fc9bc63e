"""Draw a scenario's traffic as a video of its road's plan."""

from collections.abc import Iterator

import cv2
import numpy as np
import shapely
from advercity_dsl import Spec
from advercity_dsl.units import Point2
from numpy.typing import NDArray

from advercity.conflicts.metrics import (
    UNIT_BOX_CORNERS,
    ActorTrack,
    compute_path_time_to_collision,
)
from advercity.frames import Signal, Trace
from advercity.geometry.arrays import Uint8Array
from advercity.roads.plan_drawing import FONT, FONT_SCALE, INK_COLOUR, PlanCanvas, draw_plan_canvas
from advercity.roads.road_network import build_road

CLASS_COLOURS = {
    "car": (235, 235, 235),
    "van": (200, 225, 235),
    "truck": (150, 200, 240),
    "bicycle": (90, 200, 120),
    "motorcycle": (60, 200, 230),
    "pedestrian": (190, 90, 190),
}
"""Colours in BGR, OpenCV's order, by class."""
CONNECTED_COLOUR = (220, 110, 30)
STAGED_COLOUR = (40, 40, 230)
SIGNAL_COLOURS = {
    Signal.RED: (40, 40, 230),
    Signal.YELLOW: (40, 210, 250),
    Signal.GREEN: (80, 200, 60),
}
SIGNAL_SIZE_M = 1.4
SHOWN_TIME_TO_COLLISION_S = 5.0
"""Time to collision below which it is written on the pictures."""


def draw_traffic_pictures(spec: Spec, trace: Trace) -> Iterator[Uint8Array]:
    """Draw the plan of a spec's road with all actors on it: an RGB picture per kept tick."""
    road = build_road(spec.road)
    canvas = draw_plan_canvas(road, around_agents=True)
    empty = canvas.image
    tracks = [ActorTrack.from_trace(trace, actor.id) for actor in trace.actors]
    rows = np.concatenate([track.rows for track in tracks])
    corners = np.concatenate([track.corners for track in tracks])
    colours = _choose_colours(spec, trace)
    heads = road.traffic_lights
    texts = _format_conflict_states(spec, trace)
    for tick in range(len(trace)):
        canvas.image = empty.copy()
        shown = trace.build_frame(tick).signals
        for head in heads:
            if head.id in shown:
                canvas.fill(_build_square(head.position_m[:2]), SIGNAL_COLOURS[shown[head.id]])
        for row in np.flatnonzero(rows["tick"] == tick):
            canvas.fill(corners[row], colours[int(rows["actor"][row])])
            canvas.line(corners[row][[0, 1, 2, 3, 0]], INK_COLOUR)
        lines = [f"{spec.id}   {tick * trace.tick_s:5.1f} s", *texts[tick]]
        _draw_lines(canvas, lines)
        yield np.ascontiguousarray(canvas.image[..., ::-1])


def _choose_colours(spec: Spec, trace: Trace) -> list[tuple[int, int, int]]:
    connected = {agent.number for agent in spec.agents}
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    return [
        CONNECTED_COLOUR
        if actor.id in connected
        else STAGED_COLOUR
        if actor.id in staged
        else CLASS_COLOURS[actor.actor_class]
        for actor in trace.actors
    ]


def _format_conflict_states(spec: Spec, trace: Trace) -> list[list[str]]:
    """Format, for every tick, how near the ego and the staged actors are to each other."""
    texts: list[list[str]] = [[] for _ in range(len(trace))]
    ego = ActorTrack.from_trace(trace, spec.ego.number)
    for conflict in spec.conflicts:
        actor = ActorTrack.from_trace(trace, conflict.actors[0].number)
        ticks = np.intersect1d(ego.rows["tick"], actor.rows["tick"])
        gaps = shapely.distance(ego.at_ticks(ticks).boxes, actor.at_ticks(ticks).boxes)
        times = compute_path_time_to_collision(ego, actor, ticks)
        for tick, gap, time in zip(ticks.tolist(), gaps.tolist(), times.tolist(), strict=True):
            ahead = f", collision in {time:.1f} s" if time < SHOWN_TIME_TO_COLLISION_S else ""
            texts[tick].append(f"{conflict.conflict}: {gap:.1f} m{ahead}")
    return texts


def _build_square(centre: Point2) -> NDArray[np.float64]:
    return np.asarray(centre) + SIGNAL_SIZE_M * UNIT_BOX_CORNERS


def _draw_lines(canvas: PlanCanvas, lines: list[str]) -> None:
    for index, text in enumerate(lines):
        at = (16, 28 + 24 * index)
        cv2.putText(canvas.image, text, at, FONT, 1.3 * FONT_SCALE, INK_COLOUR, 1, cv2.LINE_AA)
