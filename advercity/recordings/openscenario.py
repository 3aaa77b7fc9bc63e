"""Trajectories of an OpenSCENARIO XML 1.x scenario whose actors follow polylines by time.

What is read: entities with category and bounding box, teleports, `FollowTrajectoryAction` along a
`Polyline` of world positions with a time reference, entities that are added and deleted at a time,
and the OpenDRIVE file. Anything else that would move an actor is refused, by name and line, since
the result would be another scenario. World positions are right-handed, h is counter-clockwise from
x; they are of the entity's reference point, from which the bounding box has its own centre.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.documents import read_bytes
from advercity.errors import InputError, describe_cause
from advercity.recordings.tracks import (
    MAX_GAP_S,
    BadSampleError,
    Track,
    check_samples,
    derive_headings,
)
from advercity.roads.sumo_xml import MAX_XML_BYTES, parse_xml

CATEGORIES: dict[str, ActorClass] = {
    "car": "car",
    "van": "van",
    "truck": "truck",
    "bus": "truck",
    "trailer": "truck",
    "semitrailer": "truck",
    "motorbike": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "wheelchair": "pedestrian",
}
"""Classes by `vehicleCategory` and `pedestrianCategory`."""
SAME_PLACE_M = 0.01
"""An entity that is put no farther from its first vertex waits there until it sets out."""
TIME_TOLERANCE_S = 1e-6
MAX_VERTEX_STEP_S = MAX_GAP_S / 2
"""Points are added on edges of a polyline that take longer."""
MAX_TIME_S = 100_000.0
"""Longest scenario: a million ticks of 0.1 s, the highest `max_ticks` of a suite."""
MAX_SAMPLES = 10_000_000
"""Points of all trajectories together, added ones included."""


@dataclass(frozen=True)
class RecordedScenario:
    """What a scenario says of its actors.

    Attributes:
        tracks: One per entity that moves or stands, in their order.
        map_file: Path of the OpenDRIVE file as it is written; None if the scenario names none.
        remarks: What was left out, by name and line.
    """

    tracks: list[Track]
    map_file: str | None
    remarks: list[str]


@dataclass(frozen=True)
class _Entity:
    """A road user of the scenario; the centre of its box is relative to the reference point."""

    name: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    centre: complex


class _Vertex(NamedTuple):
    """Where an entity is at a time.

    Attributes:
        time_s: The time.
        place: Its reference point, east + i north in m.
        heading: In rad; NaN if it is not given.
        level: How long what points ahead by 1 m is in the plan, by the pitch.
    """

    time_s: float
    place: complex
    heading: float
    level: float


@dataclass
class _Motion:
    """What the scenario does to an entity.

    Attributes:
        teleport: Where it is put at the start, or None.
        vertices: Where it is led.
        added_s: Time at which it is added; None if it is there from the start.
        deleted_s: Time at which it is deleted.
        element: Its first trajectory, for messages.
    """

    teleport: _Vertex | None = None
    vertices: list[_Vertex] = field(default_factory=list[_Vertex])
    added_s: float | None = None
    deleted_s: float = math.inf
    element: Element | None = None


def read_scenario(path: Path) -> RecordedScenario:
    """Read a scenario.

    Raises:
        InputError: It cannot be read, or has what cannot be followed; all such places are listed.
    """
    return _ScenarioReader(path).read()


class _ScenarioReader:
    """Reads one document and collects what is wrong with it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            raw = read_bytes(path, max_bytes=MAX_XML_BYTES)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from None
        try:
            self._root = parse_xml(raw)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        self._places = dict(zip(self._root.iter(), _list_places(raw), strict=True))
        self._lines = raw.decode("utf-8", errors="replace").splitlines()
        self._parameters: dict[str, str] = {}
        self._problems: list[Diagnostic] = []
        self._remarks: list[str] = []
        self._left_out: dict[str, list[int]] = {}
        self._sample_count = 0
        self._names: dict[str, str] = {}
        self._motions: dict[str, _Motion] = {}

    def read(self) -> RecordedScenario:
        """Read the scenario."""
        root = self._root
        if root.tag != "OpenSCENARIO":
            self._refuse(root, "is not an <OpenSCENARIO> document", "")
        header = root.find("FileHeader")
        if header is not None and header.get("revMajor", "1") != "1":
            message = f"is version {header.get('revMajor')}.{header.get('revMinor', '')}"
            self._refuse(header, message, "versions 1.0 to 1.3 are read")
        self._raise_problems()
        for item in root.iterfind("ParameterDeclarations/ParameterDeclaration"):
            self._parameters[item.get("name", "")] = item.get("value", "")
        entities = {item.name: item for item in self._read_entities()}
        self._motions = {name: _Motion() for name in entities}
        self._read_init()
        for act in root.iterfind("Storyboard/Story/Act"):
            self._read_act(act)
        logic = root.find("RoadNetwork/LogicFile")
        map_file = self._get(logic, "filepath") if logic is not None else None
        self._note_ignored()
        self._raise_problems()
        end_s = max(
            (one.time_s for motion in self._motions.values() for one in motion.vertices),
            default=0.0,
        )
        if end_s <= 0:
            self._refuse(root, "no entity follows a trajectory by time", "")
            self._raise_problems()
        tracks = [
            track
            for name, motion in self._motions.items()
            if (track := self._build_track(entities[name], motion, end_s)) is not None
        ]
        self._raise_problems()
        return RecordedScenario(tracks, map_file, [*self._list_left_out(), *self._remarks])

    def _refuse(self, element: Element, message: str, hint: str) -> None:
        line, column = self._places[element]
        text = self._lines[line - 1] if line <= len(self._lines) else ""
        width = len(element.tag) + 1
        self._problems.append(
            Diagnostic(self._path, line, column, f"<{element.tag}>", message, hint, text, width)
        )

    def _raise_problems(self) -> None:
        if self._problems:
            raise DiagnosticsError(*self._problems)

    def _get(self, element: Element, name: str, default: str | None = None) -> str:
        """Return an attribute, with a parameter replaced by its value."""
        value = element.get(name, default)
        if value is None:
            self._refuse(element, f"has no attribute '{name}'", "")
            return ""
        if value.startswith("$"):
            known = self._parameters.get(value[1:])
            if known is None:
                hint = "only `$name` of a <ParameterDeclaration> is replaced"
                self._refuse(element, f"'{value[:40]}' has no value", hint)
            return known or ""
        return value

    def _get_number(self, element: Element, name: str, default: str | None = None) -> float:
        text = self._get(element, name, default)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if text and not math.isfinite(number):
            self._refuse(element, f'{name}="{text[:40]}" is not a number', "")
        return number

    def _read_entities(self) -> Iterator[_Entity]:
        for item in self._root.iterfind("Entities/ScenarioObject"):
            name = self._get(item, "name")
            body = next((child for child in item if child.tag != "ObjectController"), None)
            if body is None:
                continue
            if body.tag == "MiscObject":
                self._remark(body, f"'{name}' is no road user")
                continue
            attribute = {"Vehicle": "vehicleCategory", "Pedestrian": "pedestrianCategory"}
            if body.tag not in attribute:
                hint = "write the <Vehicle> or <Pedestrian> into the scenario"
                self._refuse(body, f"the body of '{name}' is not in this file", hint)
                continue
            category = self._get(body, attribute[body.tag])
            if category not in CATEGORIES:
                hint = f"these are read: {', '.join(CATEGORIES)}"
                self._refuse(body, f"'{name}' is a {category}, for which there is no body", hint)
                continue
            box = body.find("BoundingBox")
            if box is None:
                self._refuse(body, f"'{name}' has no <BoundingBox>", "")
                continue
            track = _format_id(name)
            if track in self._names:
                message = f"'{name}' and '{self._names[track]}' are both the track '{track}'"
                self._refuse(item, message, "rename one of them")
                continue
            self._names[track] = name
            yield self._read_box(name, CATEGORIES[category], box)

    def _read_box(self, name: str, actor_class: ActorClass, box: Element) -> _Entity:
        centre, extent = box.find("Center"), box.find("Dimensions")
        size, offset = (0.0, 0.0, 0.0), 0j
        if extent is not None:
            length, width, height = (
                self._get_number(extent, key) for key in ("length", "width", "height")
            )
            size = (length, width, height)
        if centre is not None:
            offset = complex(self._get_number(centre, "x"), self._get_number(centre, "y"))
        return _Entity(name, actor_class, size, offset)

    def _read_init(self) -> None:
        for private in self._root.iterfind("Storyboard/Init/Actions/Private"):
            motion = self._find_motion(private)
            for action in private.iterfind("PrivateAction/*"):
                position = action.find("Position") if action.tag == "TeleportAction" else None
                if position is not None:
                    found = self._read_position(position, 0.0)
                    if motion is not None:
                        heading = 0.0 if math.isnan(found.heading) else found.heading
                        motion.teleport = found._replace(heading=heading)
                elif action.find("SpeedAction") is None:
                    self._refuse_action(action)
        for action in self._root.iterfind("Storyboard/Init/Actions/GlobalAction/*"):
            self._remark(action, "")

    def _find_motion(self, element: Element) -> _Motion | None:
        name = self._get(element, "entityRef")
        if name not in self._motions and not self._is_left_out(name):
            self._refuse(element, f"there is no entity '{name}'", "")
        return self._motions.get(name)

    def _is_left_out(self, name: str) -> bool:
        declared = self._root.iterfind("Entities/ScenarioObject")
        return any(self._get(item, "name") == name for item in declared)

    def _read_position(self, position: Element, time_s: float) -> _Vertex:
        world = position.find("WorldPosition")
        if world is None:
            kind = next(iter(position), position)
            self._refuse(kind, "is not a <WorldPosition>", "give x, y and h")
            return _Vertex(time_s, 0j, math.nan, 1.0)
        place = complex(self._get_number(world, "x"), self._get_number(world, "y"))
        heading = self._get_number(world, "h") if world.get("h") is not None else math.nan
        return _Vertex(time_s, place, heading, math.cos(self._get_number(world, "p", "0")))

    def _refuse_action(self, action: Element) -> None:
        inner = next(iter(action), action)
        # The action itself says more than what it is wrapped in.
        named = inner if action.tag.endswith("Action") and inner.tag.endswith("Action") else action
        hint = "record the motion that it makes as a trajectory with times"
        self._refuse(named, "actors follow trajectories by time, and nothing else", hint)

    def _remark(self, element: Element, what: str) -> None:
        line, _ = self._places[element]
        inner = next((item for item in element if item.tag.endswith("Action")), element)
        text = f"<{inner.tag}> is left out{f': {what}' if what else ''}"
        self._left_out.setdefault(text, []).append(line)

    def _list_left_out(self) -> Iterator[str]:
        """List what is left out; one of a kind stands for all of it."""
        for text, lines in self._left_out.items():
            count = f" (and {len(lines) - 1} more of them)" if len(lines) > 1 else ""
            yield f"{self._path}:{lines[0]}: {text}{count}"

    def _note_ignored(self) -> None:
        for tag in ("RoadNetwork/TrafficSignals", "RoadNetwork/SceneGraphFile"):
            for item in self._root.iterfind(tag):
                if len(item) or item.attrib:
                    self._remark(item, "")

    def _read_act(self, act: Element) -> None:
        act_s = self._read_start(act)
        for group in act.iterfind("ManeuverGroup"):
            actors = [
                motion
                for item in group.iterfind("Actors/EntityRef")
                if (motion := self._find_motion(item)) is not None
            ]
            for item in group.iterfind("CatalogReference"):
                self._refuse(item, "the maneuver is not in this file", "write it into the scenario")
            for event in group.iterfind("Maneuver/Event"):
                start_s = max(act_s, self._read_start(event))
                for action in event.iterfind("Action/*"):
                    self._read_action(action, actors, start_s)

    def _read_start(self, item: Element) -> float:
        """Read the time of a start trigger; of several groups of conditions the first counts."""
        trigger = item.find("StartTrigger")
        groups = [] if trigger is None else trigger.findall("ConditionGroup")
        starts = [
            max((self._read_condition(one) for one in group.iterfind("Condition")), default=0.0)
            for group in groups
        ]
        return min(starts, default=0.0)

    def _read_condition(self, condition: Element) -> float:
        time = condition.find("ByValueCondition/SimulationTimeCondition")
        if time is None:
            kind = next(condition.iterfind("*/*"), condition)
            hint = "only a <SimulationTimeCondition> is"
            self._refuse(kind, "such a trigger is not read", hint)
            return 0.0
        delay_s = self._get_number(condition, "delay", "0")
        return max(self._get_number(time, "value"), 0.0) + delay_s

    def _read_action(self, action: Element, actors: list[_Motion], start_s: float) -> None:
        if action.tag == "GlobalAction":
            entity = action.find("EntityAction")
            if entity is None:
                self._remark(action, "")
                return
            motion = self._find_motion(entity)
            if motion is not None and entity.find("AddEntityAction") is not None:
                motion.added_s = start_s
            elif motion is not None:
                motion.deleted_s = start_s
            return
        follow = action.find("RoutingAction/FollowTrajectoryAction")
        if follow is None:
            inner = next(iter(action), action)
            self._refuse_action(inner)
            return
        vertices = self._read_trajectory(follow, start_s)
        for motion in actors:
            motion.vertices += vertices
            motion.element = motion.element if motion.element is not None else follow

    def _read_trajectory(self, follow: Element, start_s: float) -> list[_Vertex]:
        timing = follow.find("TimeReference/Timing")
        if timing is None:
            hint = "give a <TimeReference> with <Timing>"
            self._refuse(follow, "its trajectory is not followed by time", hint)
            return []
        is_relative = self._get(timing, "domainAbsoluteRelative") == "relative"
        begins_s = self._get_number(timing, "offset") + (start_s if is_relative else 0.0)
        scale = self._get_number(timing, "scale")
        trajectory = follow.find("Trajectory")
        if trajectory is None:
            trajectory = follow.find("TrajectoryRef/Trajectory")
        line = trajectory.find("Shape/Polyline") if trajectory is not None else None
        if line is None:
            shape = next(trajectory.iterfind("Shape/*"), None) if trajectory is not None else None
            found = shape if shape is not None else follow
            self._refuse(found, "its shape is no <Polyline>", "sample it as vertices with times")
            return []
        vertices: list[_Vertex] = []
        for vertex in line.iterfind("Vertex"):
            position = vertex.find("Position")
            if position is None:
                self._refuse(vertex, "has no <Position>", "")
                continue
            time_s = begins_s + scale * self._get_number(vertex, "time")
            if not self._check_time(vertex, time_s, vertices):
                break
            vertices.append(self._read_position(position, time_s))
        return vertices

    def _check_time(self, vertex: Element, time_s: float, before: list[_Vertex]) -> bool:
        """Refuse a vertex far from the start of the scenario, or no later than the one before."""
        if abs(time_s) > MAX_TIME_S:
            message = f"is at {time_s:g} s; a scenario takes at most {MAX_TIME_S:,.0f} s"
            hint = "times are in s from its start, by scale and offset of <Timing>"
        elif before and time_s <= before[-1].time_s:
            message = (
                f"is at {time_s:g} s, no later than the vertex before, {before[-1].time_s:g} s"
            )
            hint = "order vertices by time, with a scale of <Timing> above 0"
        else:
            return True
        self._refuse(vertex, message, hint)
        return False

    def _build_track(self, entity: _Entity, motion: _Motion, end_s: float) -> Track | None:
        """Build the track of an entity; None if it is nowhere, which is remarked."""
        vertices = sorted(motion.vertices, key=lambda vertex: vertex.time_s)
        begin = motion.teleport
        if begin is not None and motion.added_s is None:
            if not vertices:
                vertices = [begin, begin._replace(time_s=end_s)]
            elif vertices[0].time_s > 0 and abs(vertices[0].place - begin.place) < SAME_PLACE_M:
                vertices.insert(0, begin)
        if len(vertices) < 2:
            self._remarks.append(f"{self._path}: '{entity.name}' is left out: it is nowhere")
            return None
        self._sample_count += len(vertices) + int(
            (vertices[-1].time_s - vertices[0].time_s) / MAX_VERTEX_STEP_S
        )
        if self._sample_count > MAX_SAMPLES:
            message = f"up to '{entity.name}', trajectories have more than {MAX_SAMPLES:,} points"
            hint = f"with one every {MAX_VERTEX_STEP_S:g} s; shorten the scenario or split it"
            self._refuse(self._root, message, hint)
            self._raise_problems()
        times_s = _densify_times(vertices)
        times_s = times_s[times_s <= motion.deleted_s + TIME_TOLERANCE_S]
        places, headings, levels = _interpolate(vertices, times_s)
        plan = np.column_stack([places.real, places.imag])
        try:
            check_samples(times_s, plan)
        except BadSampleError as error:
            where = motion.element if motion.element is not None else self._root
            self._refuse(where, f"'{entity.name}': {error.message}", error.hint)
            return None
        if np.isnan(headings).any():
            headings = derive_headings(times_s, plan)
        ahead, left = entity.centre.real * levels, entity.centre.imag
        centres = places + (ahead + 1j * left) * np.exp(1j * headings)
        return Track(
            id=_format_id(entity.name),
            actor_class=entity.actor_class,
            size=entity.size,
            times_s=times_s,
            places=np.column_stack([centres.real, centres.imag]),
            headings_rad=np.unwrap(headings),
        )


def _format_id(name: str) -> str:
    """Format the name of an entity as a road may call a track, `TrackId`."""
    return re.sub(r"[^A-Za-z0-9_.:-]", "_", name)[:64]


def _densify_times(vertices: list[_Vertex]) -> NDArray[np.float64]:
    """List the times of vertices, and times between those that are far apart."""
    times_s = [vertex.time_s for vertex in vertices]
    pieces = [
        np.linspace(begin, end, max(math.ceil((end - begin) / MAX_VERTEX_STEP_S), 1) + 1)[:-1]
        for begin, end in pairwise(times_s)
    ]
    # Repeated times stay, so that they are found: they have no piece between them.
    return np.concatenate([*pieces, times_s[-1:]])


def _interpolate(
    vertices: list[_Vertex], at_s: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """Interpolate places, headings and levels (n,) at times (n,)."""
    times_s, places, headings, levels = (np.array(column) for column in zip(*vertices, strict=True))
    if not np.isnan(headings).any():
        headings = np.unwrap(headings)
    return (
        np.asarray(np.interp(at_s, times_s, places), dtype=np.complex128),
        np.interp(at_s, times_s, headings),
        np.interp(at_s, times_s, levels),
    )


def _list_places(raw: bytes) -> list[tuple[int, int]]:
    """List line and column of every element, in the order of the document."""
    places: list[tuple[int, int]] = []
    parser = expat.ParserCreate()

    def enter(*_: object) -> None:
        places.append((parser.CurrentLineNumber, parser.CurrentColumnNumber + 1))

    parser.StartElementHandler = enter
    parser.Parse(raw, True)
    return places
