"""State of a scenario while it is played: where its entities are, and which parts of it run."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, NoReturn, Protocol
from xml.etree.ElementTree import Element

from advercity_dsl import ActorClass

from advercity.diagnostics import DiagnosticsError
from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.road_map import (
    Chooser,
    LanePlace,
    RoadMap,
    choose_on_route,
    choose_straightest,
)

ACROSS_RAD = math.pi / 4
"""An entity with a larger angle to its lane does not follow it."""

MAX_JUMP_M = 1.0
"""Largest instant move of an entity by an action, while the scenario is played."""


class Entity(NamedTuple):
    """A road user of the scenario; the centre of its box is relative to the reference point."""

    name: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    centre: complex


class Pose(NamedTuple):
    """A place and heading.

    Attributes:
        point: East + i north in m.
        heading: In rad, counter-clockwise from east; NaN if it follows the motion.
        level: Length in the plan of 1 m ahead, by the pitch.
        lane: The same place on a lane, if given so.
        route: Roads of its route, if given on one.
    """

    point: complex
    heading: float
    level: float = 1.0
    lane: LanePlace | None = None
    route: tuple[str, ...] = ()


class Sample(NamedTuple):
    """Where an entity is at a time."""

    time_s: float
    pose: Pose


class Process(Protocol):
    """An action with a duration.

    Attributes:
        is_done: Whether it has ended.
    """

    is_done: bool

    def advance(self, mover: "Mover", stage: "Stage", step_s: float) -> None:
        """Change the entity over a step."""
        ...


@dataclass
class Mover:
    """An entity in motion.

    Attributes:
        entity: Its entity.
        pose: Its pose; None if it is nowhere.
        speed_m_s: Its speed, below 0 backwards.
        processes: Its current actions, by domain: `speed`, `lateral` or `path`.
        route: Roads ahead of it.
        travelled_m: Distance moved.
        acceleration_m_s2: Change of speed over the last step.
        standing_s: Time at rest.
        is_at_end: Whether no road leads further.
        lane_offset_m: Offset to its left in its lane at the end of the step; None keeps it.
        samples: Its past, in pieces between being added and deleted.
    """

    entity: Entity
    pose: Pose | None = None
    speed_m_s: float = 0.0
    processes: dict[str, Process] = field(default_factory=dict[str, Process])
    route: tuple[str, ...] = ()
    travelled_m: float = 0.0
    acceleration_m_s2: float = 0.0
    standing_s: float = 0.0
    is_at_end: bool = False
    lane_offset_m: float | None = None
    samples: list[Sample] = field(default_factory=list[Sample])

    def assign(self, process: Process, *domains: str) -> None:
        """Start a process on it, and end others in the same domains."""
        for domain in domains:
            before = self.processes.get(domain)
            if before is not None:
                before.is_done = True
            self.processes[domain] = process

    def leave(self, stage: "Stage") -> None:
        """Take it from the scenario, and end its motion."""
        if self.pose is not None:
            self.samples.append(Sample(stage.time_s, self.pose))
        for process in self.processes.values():
            process.is_done = True
        self.processes.clear()
        self.pose = None

    def run(self, domain: str, stage: "Stage", step_s: float) -> bool:
        """Advance the process of a domain; False if there is none."""
        process = self.processes.get(domain)
        if process is None:
            return False
        if not process.is_done:
            process.advance(self, stage, step_s)
        if process.is_done and self.processes.get(domain) is process:
            del self.processes[domain]
        return True


@dataclass
class Stage:
    """The scenario at a time.

    Attributes:
        movers: Entities by name.
        open_map: Opens the map; raises if there is none.
        time_s: The time.
        values: Values of parameters and variables by name.
    """

    movers: dict[str, Mover]
    open_map: Callable[[], RoadMap | None]
    scope: Scope
    step: int = 0
    time_s: float = 0.0
    values: dict[str, str] = field(default_factory=dict[str, str])

    def fail(self, scope: Scope, element: Element, message: str, hint: str = "") -> NoReturn:
        """Raise DiagnosticsError for a problem found only while the scenario is played."""
        scope.refuse(element, message, hint)
        raise DiagnosticsError(*scope.findings.problems.values())

    def check_jump(self, scope: Scope, element: Element, mover: Mover, point: complex) -> None:
        """Raise DiagnosticsError if an action moves an entity on the road elsewhere."""
        if mover.pose is None or not self.step:
            return
        jump_m = abs(point - mover.pose.point)
        if jump_m > MAX_JUMP_M:
            message = f"'{mover.entity.name}' jumps {jump_m:.1f} m at {self.time_s:g} s"
            self.fail(scope, element, message, "end the scenario before with a <StopTrigger>")

    def find_mover(self, scope: Scope, element: Element, name: str) -> Mover:
        """Find an entity with a place."""
        mover = self.movers.get(name)
        if mover is None or mover.pose is None:
            self.fail(scope, element, f"'{name}' is nowhere at {self.time_s:g} s")
        return mover

    def find_pose(self, scope: Scope, element: Element, name: str) -> Pose:
        """Find where an entity is."""
        pose = self.find_mover(scope, element, name).pose
        assert pose is not None
        return pose

    def find_lane(self, pose: Pose) -> LanePlace | None:
        """Find the lane on which a pose is; None off the road, without a map, or across it."""
        if pose.lane is not None:
            return pose.lane
        roads = self.open_map()
        if roads is None:
            return None
        found = roads.find_nearest(pose.point, 0.0 if math.isnan(pose.heading) else pose.heading)
        if found is None or math.isnan(pose.heading):
            return found
        _, ahead = roads.locate(found)
        turned = abs(math.remainder(pose.heading - ahead, 2 * math.pi))
        return found if turned < ACROSS_RAD else None

    def choose_way(self, mover: Mover, place: LanePlace) -> Chooser:
        """Return a chooser of ways through junctions: along the route, else straight on."""
        roads = self.open_map()
        assert roads is not None
        straightest = choose_straightest(roads, place)

        def choose(followers: Sequence[LanePlace]) -> LanePlace | None:
            name = "junction that is passed straight on, for want of a route"
            plural = "junctions that are passed straight on, for want of a route"
            self.scope.findings.ledger.leave_out(name, plural=plural)
            return straightest(followers)

        return choose_on_route(mover.route, choose)
