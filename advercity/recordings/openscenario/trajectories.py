"""Trajectories of OpenSCENARIO, followed by time or at the speed of the entity."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.positions import (
    Position,
    has_heading,
    parse_position,
)
from advercity.recordings.openscenario.stage import Mover, Pose, Sample, Stage

MAX_TIME_S = 100_000.0
"""Longest scenario: a million ticks of 0.1 s, the highest `max_ticks` of a suite."""
CURVE_STEP_M = 0.2
MAX_CURVE_M = 10_000.0
TIME_TOLERANCE_S = 1e-9
DENSE_S = 0.5
"""A trajectory with times and vertices no farther apart keeps only these as places."""


class Vertex(NamedTuple):
    """A vertex as it is written; its time is NaN if it has none."""

    time_s: float
    element: Element
    find: Position
    has_heading: bool


Shape = Callable[[Stage], list[Sample]]
"""Vertices of a trajectory with times in its own count, NaN without."""


@dataclass(frozen=True)
class Timing:
    """How times of a trajectory become times of the scenario."""

    is_relative: bool
    scale: float
    offset_s: float


@dataclass(frozen=True)
class Follow:
    """A `FollowTrajectoryAction`."""

    scope: Scope
    element: Element
    shape: Shape
    timing: Timing | None
    begins_m: float
    last_s: float

    def start(self, mover: Mover, stage: Stage) -> "TimedFollower | PathFollower":
        """Begin to follow it."""
        samples = self.shape(stage)
        timing = self.timing
        if timing is not None:
            begins_s = timing.offset_s + (stage.time_s if timing.is_relative else 0.0)
            timed = [
                item._replace(time_s=begins_s + timing.scale * item.time_s) for item in samples
            ]
            return TimedFollower(timed)
        return PathFollower([item.pose for item in samples], self.begins_m)

    def find_end_s(self) -> float:
        """Return the latest time at which it can end, if it is absolute."""
        timing = self.timing
        return timing.offset_s + timing.scale * self.last_s if timing is not None else 0.0


def parse_follow(scope: Scope, element: Element) -> Follow | None:
    """Parse a `FollowTrajectoryAction`; None, and a problem, if it cannot be followed."""
    timing = _parse_timing(scope, element)
    holder = element.find("TrajectoryRef")
    found = scope.resolve(element if holder is None else holder, "Trajectory")
    if found is None:
        return None
    inner, trajectory = found
    kind = trajectory.find("Shape/*")
    if kind is None or kind.tag not in SHAPES:
        hint = "sample it as the vertices of a <Polyline>"
        inner.refuse(kind if kind is not None else element, "such a shape is not read", hint)
        return None
    if inner.get_flag(trajectory, "closed"):
        inner.refuse(trajectory, "is closed, and has no end", "give it as many vertices as needed")
        return None
    shape, last_s = SHAPES[kind.tag](inner, kind, timing)
    begins_m = scope.get_number(element, "initialDistanceOffset", 0.0)
    if begins_m and timing is not None:
        scope.refuse(element, "has both an initialDistanceOffset and times", "remove one of them")
    return Follow(scope, element, shape, timing, begins_m, last_s)


def _parse_timing(scope: Scope, element: Element) -> Timing | None:
    timing = element.find("TimeReference/Timing")
    if timing is None:
        return None
    is_relative = scope.get(timing, "domainAbsoluteRelative") == "relative"
    return Timing(
        is_relative, scope.get_number(timing, "scale"), scope.get_number(timing, "offset")
    )


def _parse_polyline(scope: Scope, element: Element, timing: Timing | None) -> tuple[Shape, float]:
    vertices: list[Vertex] = []
    for vertex in element.iterfind("Vertex"):
        position = vertex.find("Position")
        find = parse_position(scope, vertex)
        time_s = math.nan
        if timing is not None:
            time_s = scope.get_number(vertex, "time")
            if not _check_time(scope, vertex, time_s, timing, vertices):
                break
        if find is not None and position is not None:
            vertices.append(Vertex(time_s, vertex, find, has_heading(position)))
    if len(vertices) < 2 and not scope.findings.problems:
        scope.refuse(element, "has fewer than two vertices")

    def list_samples(stage: Stage) -> list[Sample]:
        poses = [(item, item.find(stage)) for item in vertices]
        return [
            Sample(item.time_s, pose if item.has_heading else pose._replace(heading=math.nan))
            for item, pose in poses
        ]

    return list_samples, vertices[-1].time_s if vertices else 0.0


def _check_time(
    scope: Scope, vertex: Element, time_s: float, timing: Timing, before: list[Vertex]
) -> bool:
    """Refuse a vertex far from the start of the scenario, or no later than the one before."""
    scaled_s = timing.offset_s + timing.scale * time_s
    if abs(scaled_s) > MAX_TIME_S:
        message = f"is at {scaled_s:g} s; a scenario takes at most {MAX_TIME_S:,.0f} s"
        scope.refuse(
            vertex, message, "times are in s from its start, by scale and offset of <Timing>"
        )
        return False
    if before:
        last_s = timing.offset_s + timing.scale * before[-1].time_s
        if scaled_s <= last_s:
            message = f"is at {scaled_s:g} s, no later than the vertex before, {last_s:g} s"
            scope.refuse(
                vertex, message, "order vertices by time, with a scale of <Timing> above 0"
            )
            return False
    return math.isfinite(time_s)


def _parse_clothoid(scope: Scope, element: Element, timing: Timing | None) -> tuple[Shape, float]:
    curvature = scope.get_number(element, "curvature")
    rate_name = "curvaturePrime" if element.get("curvaturePrime") is not None else "curvatureDot"
    rate = scope.get_number(element, rate_name)
    length_m = scope.get_number(element, "length")
    find = parse_position(scope, element)
    begins_s, ends_s = math.nan, math.nan
    if timing is not None:
        begins_s, ends_s = (scope.get_number(element, name) for name in ("startTime", "stopTime"))
    if not 0 < length_m <= MAX_CURVE_M:
        scope.refuse(element, f"its length of {length_m:g} m is not within {MAX_CURVE_M:g} m")
        length_m = 1.0

    def list_samples(stage: Stage) -> list[Sample]:
        assert find is not None
        start = find(stage)
        at_m = np.linspace(0.0, length_m, math.ceil(length_m / CURVE_STEP_M) + 1)
        headings = start.heading + curvature * at_m + rate * at_m**2 / 2
        middles = (headings[1:] + headings[:-1]) / 2
        steps = np.diff(at_m) * np.exp(1j * middles)
        points = start.point + np.concatenate([[0], np.cumsum(steps)])
        times = begins_s + at_m / length_m * (ends_s - begins_s)
        return [
            Sample(float(time), Pose(complex(point), float(heading)))
            for time, point, heading in zip(times, points, headings, strict=True)
        ]

    return list_samples, ends_s if timing is not None else 0.0


SHAPES: dict[str, Callable[[Scope, Element, Timing | None], tuple[Shape, float]]] = {
    "Polyline": _parse_polyline,
    "Clothoid": _parse_clothoid,
}
"""Parsers by element."""


class TimedFollower:
    """Leads an entity to places by time."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self.is_done = False
        self.samples = samples
        self._times = np.array([item.time_s for item in samples])

    def advance(self, mover: Mover, stage: Stage, step_s: float) -> None:
        """Lead the entity to where it is at the end of the step."""
        begin_s, end_s = stage.time_s, min(stage.time_s + step_s, float(self._times[-1]))
        self.is_done = stage.time_s + step_s >= self._times[-1] - TIME_TOLERANCE_S
        if self.is_done and end_s < begin_s:  # it was over before it began
            end_s = begin_s
        first, last = np.searchsorted(self._times, [begin_s, end_s - TIME_TOLERANCE_S])
        for item in self.samples[first:last]:
            mover.samples.append(item)
        # An entity without a place appears where the trajectory begins.
        if end_s < self._times[0] - TIME_TOLERANCE_S:
            return
        pose, speed_m_s = self._interpolate(end_s)
        mover.speed_m_s = speed_m_s
        mover.pose = pose
        if self.is_done:
            mover.samples.append(Sample(end_s, pose))

    def is_dense(self, time_s: float) -> bool:
        """Return whether the vertices around a time suffice, without more between them."""
        index = int(np.searchsorted(self._times, time_s, side="right"))
        inside = 0 < index < len(self._times)
        return inside and bool(self._times[index] - self._times[index - 1] <= DENSE_S)

    def _interpolate(self, time_s: float) -> tuple[Pose, float]:
        index = int(np.searchsorted(self._times, time_s, side="left"))
        index = min(max(index, 1), len(self._times) - 1)
        before, after = self.samples[index - 1], self.samples[index]
        span_s = after.time_s - before.time_s
        share = min(max((time_s - before.time_s) / span_s, 0.0), 1.0)
        moved = after.pose.point - before.pose.point
        return _blend(before.pose, after.pose, share), abs(moved) / span_s


class PathFollower:
    """Leads an entity along a line at its own speed, forwards or backwards."""

    def __init__(self, poses: Sequence[Pose], begins_m: float) -> None:
        self.is_done = False
        self._poses = poses
        steps_m = [abs(after.point - before.point) for before, after in pairwise(poses)]
        self._stations_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        self._at_m = begins_m

    def advance(self, mover: Mover, stage: Stage, step_s: float) -> None:
        """Lead the entity along the line; beyond its ends it keeps its heading."""
        moved_m = mover.speed_m_s * step_s
        self._at_m += moved_m
        length_m = float(self._stations_m[-1])
        at_m = min(max(self._at_m, 0.0), length_m)
        mover.pose = self.find_pose(at_m)
        self.is_done = self._at_m >= length_m or (self._at_m <= 0 and moved_m < 0)
        beyond = (self._at_m - at_m) * complex(np.exp(1j * mover.pose.heading))
        mover.pose = mover.pose._replace(point=mover.pose.point + beyond)

    def find_pose(self, at_m: float) -> Pose:
        """Return the pose at a distance along the line."""
        index = int(np.searchsorted(self._stations_m, at_m, side="left"))
        index = min(max(index, 1), len(self._poses) - 1)
        begin_m, end_m = self._stations_m[index - 1 : index + 1]
        share = (at_m - begin_m) / (end_m - begin_m) if end_m > begin_m else 1.0
        return _blend(self._poses[index - 1], self._poses[index], float(share))


def _blend(before: Pose, after: Pose, share: float) -> Pose:
    moved = after.point - before.point
    heading = math.atan2(moved.imag, moved.real)
    if not (math.isnan(before.heading) or math.isnan(after.heading)):
        turned = math.remainder(after.heading - before.heading, 2 * math.pi)
        heading = before.heading + share * turned
    level = before.level + share * (after.level - before.level)
    return Pose(before.point + share * moved, heading, level)
