"""Trajectories of an OpenSCENARIO XML 1.x scenario whose actors follow polylines by time.

What is read: entities with category and bounding box, teleports, `FollowTrajectoryAction` along a
`Polyline` of world positions with a time reference, entities that are added and deleted at a time,
and the OpenDRIVE file. Anything else that would move an actor is refused, by name and line, since
the result would be another scenario. World positions are right-handed, h is counter-clockwise from
x; they are of the entity's reference point, from which the bounding box has its own centre.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity_dsl import ActorClass

from advercity.recordings.openscenario_document import ScenarioDocument
from advercity.recordings.openscenario_motion import (
    Entity,
    Motion,
    TrackBuilder,
    Vertex,
    format_id,
)
from advercity.recordings.tracks import Track

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
MAX_TIME_S = 100_000.0
"""Longest scenario: a million ticks of 0.1 s, the highest `max_ticks` of a suite."""


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


def read_scenario(path: Path) -> RecordedScenario:
    """Read a scenario.

    Raises:
        InputError: It cannot be read, or has what cannot be followed; all such places are listed.
    """
    return _ScenarioReader(path).read()


class _ScenarioReader:
    """Reads the story of one document, and what it does to each entity."""

    def __init__(self, path: Path) -> None:
        self._document = ScenarioDocument(path)
        self._root = self._document.root
        self._names: dict[str, str] = {}
        self._motions: dict[str, Motion] = {}

    def read(self) -> RecordedScenario:
        """Read the scenario."""
        root = self._root
        if root.tag != "OpenSCENARIO":
            self._document.refuse(root, "is not an <OpenSCENARIO> document", "")
        header = root.find("FileHeader")
        if header is not None and header.get("revMajor", "1") != "1":
            message = f"is version {header.get('revMajor')}.{header.get('revMinor', '')}"
            self._document.refuse(header, message, "versions 1.0 to 1.3 are read")
        self._document.raise_problems()
        entities = {item.name: item for item in self._read_entities()}
        self._motions = {name: Motion() for name in entities}
        self._read_init()
        for act in root.iterfind("Storyboard/Story/Act"):
            self._read_act(act)
        self._read_stop()
        self._check_speeds()
        logic = root.find("RoadNetwork/LogicFile")
        map_file = self._document.get(logic, "filepath") if logic is not None else None
        self._note_ignored()
        self._document.raise_problems()
        end_s = max(
            (one.time_s for motion in self._motions.values() for one in motion.vertices),
            default=0.0,
        )
        if end_s <= 0:
            self._document.refuse(root, "no entity follows a trajectory by time", "")
            self._document.raise_problems()
        builder = TrackBuilder(self._document)
        tracks = [
            track
            for name, motion in self._motions.items()
            if (track := builder.build(entities[name], motion, end_s)) is not None
        ]
        self._document.raise_problems()
        return RecordedScenario(
            tracks, map_file, [*self._document.list_left_out(), *builder.remarks]
        )

    def _read_entities(self) -> Iterator[Entity]:
        for item in self._root.iterfind("Entities/ScenarioObject"):
            name = self._document.get(item, "name")
            body = next((child for child in item if child.tag != "ObjectController"), None)
            if body is None:
                continue
            if body.tag == "MiscObject":
                self._document.remark(body, f"'{name}' is no road user")
                continue
            attribute = {"Vehicle": "vehicleCategory", "Pedestrian": "pedestrianCategory"}
            if body.tag not in attribute:
                hint = "write the <Vehicle> or <Pedestrian> into the scenario"
                self._document.refuse(body, f"the body of '{name}' is not in this file", hint)
                continue
            category = self._document.get(body, attribute[body.tag])
            if category not in CATEGORIES:
                hint = f"these are read: {', '.join(CATEGORIES)}"
                self._document.refuse(
                    body, f"'{name}' is a {category}, for which there is no body", hint
                )
                continue
            box = body.find("BoundingBox")
            if box is None:
                self._document.refuse(body, f"'{name}' has no <BoundingBox>", "")
                continue
            track = format_id(name)
            if track in self._names:
                message = f"'{name}' and '{self._names[track]}' are both the track '{track}'"
                self._document.refuse(item, message, "rename one of them")
                continue
            self._names[track] = name
            yield self._read_box(name, CATEGORIES[category], box)

    def _read_box(self, name: str, actor_class: ActorClass, box: Element) -> Entity:
        centre, extent = box.find("Center"), box.find("Dimensions")
        size, offset = (0.0, 0.0, 0.0), 0j
        if extent is not None:
            length, width, height = (
                self._document.get_number(extent, key) for key in ("length", "width", "height")
            )
            size = (length, width, height)
        if centre is not None:
            offset = complex(
                self._document.get_number(centre, "x"), self._document.get_number(centre, "y")
            )
        return Entity(name, actor_class, size, offset)

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
                elif (speed := action.find("SpeedAction")) is None:
                    self._refuse_action(action)
                elif motion is not None and not _is_standing(speed):
                    motion.speed = speed
        for action in self._root.iterfind("Storyboard/Init/Actions/GlobalAction/*"):
            self._document.remark(action, "")

    def _find_motion(self, element: Element) -> Motion | None:
        name = self._document.get(element, "entityRef")
        if name not in self._motions and not self._is_left_out(name):
            self._document.refuse(element, f"there is no entity '{name}'", "")
        return self._motions.get(name)

    def _is_left_out(self, name: str) -> bool:
        declared = self._root.iterfind("Entities/ScenarioObject")
        return any(self._document.get(item, "name") == name for item in declared)

    def _read_position(self, position: Element, time_s: float) -> Vertex:
        world = position.find("WorldPosition")
        if world is None:
            kind = next(iter(position), position)
            self._document.refuse(kind, "is not a <WorldPosition>", "give x, y and h")
            return Vertex(time_s, 0j, math.nan, 1.0)
        place = complex(
            self._document.get_number(world, "x"), self._document.get_number(world, "y")
        )
        heading = self._document.get_number(world, "h") if world.get("h") is not None else math.nan
        return Vertex(time_s, place, heading, math.cos(self._document.get_number(world, "p", "0")))

    def _refuse_action(self, action: Element) -> None:
        inner = next(iter(action), action)
        # The action itself says more than what it is wrapped in.
        named = inner if action.tag.endswith("Action") and inner.tag.endswith("Action") else action
        hint = "record the motion that it makes as a trajectory with times"
        self._document.refuse(named, "actors follow trajectories by time, and nothing else", hint)

    def _read_stop(self) -> None:
        """End all motion where the storyboard stops; triggers that stop a part are refused."""
        for condition in self._root.iterfind("Storyboard/Story//StopTrigger//Condition"):
            hint = "remove it, and cut the trajectories where it would stop"
            self._document.refuse(condition, "stop triggers of acts are not read", hint)
        storyboard = self._root.find("Storyboard")
        trigger = storyboard.find("StopTrigger") if storyboard is not None else None
        stop_s = self._read_trigger(trigger, default=math.inf)
        for motion in self._motions.values():
            motion.deleted_s = min(motion.deleted_s, stop_s)

    def _check_speeds(self) -> None:
        """Refuse speeds of entities that no trajectory leads from the start."""
        for name, motion in self._motions.items():
            is_led = any(vertex.time_s <= 0 for vertex in motion.vertices)
            if motion.speed is not None and not is_led and motion.added_s is None:
                message = f"'{name}' would drive on along its lane"
                hint = "give it a trajectory with times from 0 s"
                self._document.refuse(motion.speed, message, hint)

    def _note_ignored(self) -> None:
        for tag in ("RoadNetwork/TrafficSignals", "RoadNetwork/SceneGraphFile"):
            for item in self._root.iterfind(tag):
                if len(item) or item.attrib:
                    self._document.remark(item, "")

    def _read_act(self, act: Element) -> None:
        act_s = self._read_start(act)
        for group in act.iterfind("ManeuverGroup"):
            actors = [
                motion
                for item in group.iterfind("Actors/EntityRef")
                if (motion := self._find_motion(item)) is not None
            ]
            for item in group.iterfind("CatalogReference"):
                self._document.refuse(
                    item, "the maneuver is not in this file", "write it into the scenario"
                )
            self._check_priorities(group)
            for event in group.iterfind("Maneuver/Event"):
                start_s = max(act_s, self._read_start(event))
                for action in event.iterfind("Action/*"):
                    self._read_action(action, actors, start_s)

    def _check_priorities(self, group: Element) -> None:
        """Refuse events that would end, or be skipped for, another event of their maneuver."""
        for maneuver in group.iterfind("Maneuver"):
            for event in maneuver.findall("Event")[1:]:
                priority = self._document.get(event, "priority", "parallel")
                if priority != "parallel":
                    hint = "give one trajectory with all that is driven"
                    self._document.refuse(event, f'priority="{priority[:40]}" is not read', hint)

    def _read_start(self, item: Element) -> float:
        return self._read_trigger(item.find("StartTrigger"), default=0.0)

    def _read_trigger(self, trigger: Element | None, *, default: float) -> float:
        """Read the time of a trigger; of several groups of conditions the first counts."""
        groups = [] if trigger is None else trigger.findall("ConditionGroup")
        times_s = [
            max((self._read_condition(one) for one in group.iterfind("Condition")), default=default)
            for group in groups
        ]
        return min(times_s, default=default)

    def _read_condition(self, condition: Element) -> float:
        time = condition.find("ByValueCondition/SimulationTimeCondition")
        if time is None:
            kind = next(condition.iterfind("*/*"), condition)
            hint = "only a <SimulationTimeCondition> is"
            self._document.refuse(kind, "such a trigger is not read", hint)
            return 0.0
        delay_s = self._document.get_number(condition, "delay", "0")
        return max(self._document.get_number(time, "value"), 0.0) + delay_s

    def _read_action(self, action: Element, actors: list[Motion], start_s: float) -> None:
        if action.tag == "GlobalAction":
            entity = action.find("EntityAction")
            if entity is None:
                self._document.remark(action, "")
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

    def _read_trajectory(self, follow: Element, start_s: float) -> list[Vertex]:
        timing = follow.find("TimeReference/Timing")
        if timing is None:
            hint = "give a <TimeReference> with <Timing>"
            self._document.refuse(follow, "its trajectory is not followed by time", hint)
            return []
        is_relative = self._document.get(timing, "domainAbsoluteRelative") == "relative"
        begins_s = self._document.get_number(timing, "offset") + (start_s if is_relative else 0.0)
        scale = self._document.get_number(timing, "scale")
        trajectory = follow.find("Trajectory")
        if trajectory is None:
            trajectory = follow.find("TrajectoryRef/Trajectory")
        line = trajectory.find("Shape/Polyline") if trajectory is not None else None
        if line is None:
            shape = next(trajectory.iterfind("Shape/*"), None) if trajectory is not None else None
            found = shape if shape is not None else follow
            self._document.refuse(
                found, "its shape is no <Polyline>", "sample it as vertices with times"
            )
            return []
        vertices: list[Vertex] = []
        for vertex in line.iterfind("Vertex"):
            position = vertex.find("Position")
            if position is None:
                self._document.refuse(vertex, "has no <Position>", "")
                continue
            time_s = begins_s + scale * self._document.get_number(vertex, "time")
            if not self._check_time(vertex, time_s, vertices):
                break
            vertices.append(self._read_position(position, time_s))
        return vertices

    def _check_time(self, vertex: Element, time_s: float, before: list[Vertex]) -> bool:
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
        self._document.refuse(vertex, message, hint)
        return False


def _is_standing(speed: Element) -> bool:
    target = speed.find("SpeedActionTarget/AbsoluteTargetSpeed")
    return target is not None and target.get("value") in ("0", "0.0")
