"""The storyboard: stories, acts, maneuver groups, maneuvers and events, and how each runs."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.actions import Action, parse_actions
from advercity.recordings.openscenario.conditions import ConditionParser, Trigger
from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.elements import (
    COMPLETE,
    END,
    RUNNING,
    SKIP,
    STANDBY,
    STOP,
    StoryElement,
)
from advercity.recordings.openscenario.positions import parse_entity
from advercity.recordings.openscenario.stage import Process, Stage

Part = TypeVar("Part", bound=StoryElement)
PRIORITIES = ("overwrite", "override", "skip", "parallel")
MAX_EXECUTIONS = 1_000_000


@dataclass
class Event(StoryElement):
    """An event: its actions, its trigger, and its effect on others in its maneuver."""

    priority: str = "parallel"
    max_executions: int = 1
    trigger: Trigger | None = None
    actions: Sequence[tuple[StoryElement, Action]] = ()
    actors: Sequence[str] = ()
    running: list[tuple[StoryElement, Process]] = field(
        default_factory=list[tuple[StoryElement, Process]]
    )

    def begin(self, stage: Stage) -> None:
        """Begin its actions."""
        self.start(stage)
        for element, action in self.actions:
            element.start(stage)
            names = self.actors if action.is_private else self.actors[:1] or [""]
            for name in names:
                process = action.start(stage.movers.get(name), stage)
                if process is not None:
                    self.running.append((element, process))
        self.update(stage)

    def update(self, stage: Stage) -> None:
        """End it when its actions have ended."""
        if self.state != RUNNING:
            return
        self.running = [item for item in self.running if not item[1].is_done]
        busy = {id(element) for element, _ in self.running}
        for element, _ in self.actions:
            if element.state == RUNNING and id(element) not in busy:
                element.enter(COMPLETE, END, stage)
        if not self.running:
            self._rest(stage, END)

    def stop(self, stage: Stage) -> None:
        """Stop its actions; entities keep their speed and lane from then on."""
        if self.state == RUNNING:
            for element, process in self.running:
                process.is_done = True
                element.enter(COMPLETE, STOP, stage)
            self.running = []
            self._rest(stage, STOP)

    def skip(self, stage: Stage) -> None:
        """Count it as executed without doing anything."""
        self.executions += 1
        self._rest(stage, SKIP)

    def _rest(self, stage: Stage, transition: str) -> None:
        is_over = self.executions >= self.max_executions
        self.enter(COMPLETE if is_over else STANDBY, transition, stage)
        if not is_over and self.trigger is not None:
            self.trigger.reset()


@dataclass
class Maneuver(StoryElement):
    """Events; one may end another."""

    events: Sequence[Event] = ()

    def update(self, stage: Stage) -> None:
        """Begin the triggered events."""
        for event in self.events:
            event.update(stage)
        for event in self.events:
            if event.state != STANDBY or not (event.trigger is None or event.trigger.fires(stage)):
                continue
            others = [item for item in self.events if item is not event and item.state == RUNNING]
            if event.priority == "skip" and others:
                event.skip(stage)
                continue
            if event.priority in ("overwrite", "override"):
                for item in others:
                    item.stop(stage)
            event.begin(stage)
        if self.state == RUNNING and all(item.state == COMPLETE for item in self.events):
            self.enter(COMPLETE, END, stage)

    def stop(self, stage: Stage) -> None:
        """Stop all events."""
        for event in self.events:
            event.stop(stage)
        self.enter(COMPLETE, STOP, stage)


@dataclass
class ManeuverGroup(StoryElement):
    """Maneuvers of some actors."""

    maneuvers: Sequence[Maneuver] = ()
    max_executions: int = 1

    def begin(self, stage: Stage) -> None:
        """Begin, or begin again, all maneuvers."""
        self.start(stage)
        for maneuver in self.maneuvers:
            maneuver.start(stage)
            for event in maneuver.events:
                event.executions = 0
                event.state = STANDBY
                if event.trigger is not None:
                    event.trigger.reset()

    def update(self, stage: Stage) -> None:
        """Update maneuvers."""
        if self.state != RUNNING:
            return
        for maneuver in self.maneuvers:
            maneuver.update(stage)
        if all(item.state == COMPLETE for item in self.maneuvers):
            if self.executions < self.max_executions and self.maneuvers:
                self.begin(stage)
            else:
                self.enter(COMPLETE, END, stage)

    def stop(self, stage: Stage) -> None:
        """Stop all maneuvers."""
        for maneuver in self.maneuvers:
            maneuver.stop(stage)
        self.enter(COMPLETE, STOP, stage)


@dataclass
class Act(StoryElement):
    """Maneuver groups with a common begin and end."""

    start_trigger: Trigger | None = None
    stop_trigger: Trigger | None = None
    groups: Sequence[ManeuverGroup] = ()

    def update(self, stage: Stage) -> None:
        """Begin, update or stop its groups."""
        starts = self.start_trigger is None or (
            self.state == STANDBY and self.start_trigger.fires(stage)
        )
        if self.state == STANDBY and starts:
            self.start(stage)
            for group in self.groups:
                group.begin(stage)
        if self.state != RUNNING:
            return
        if self.stop_trigger is not None and self.stop_trigger.fires(stage):
            for group in self.groups:
                group.stop(stage)
            self.enter(COMPLETE, STOP, stage)
            return
        for group in self.groups:
            group.update(stage)
        if all(group.state == COMPLETE for group in self.groups):
            self.enter(COMPLETE, END, stage)


@dataclass
class Story(StoryElement):
    """Acts in parallel."""

    acts: Sequence[Act] = ()

    def update(self, stage: Stage) -> None:
        """Update its acts."""
        if self.state == STANDBY:
            self.start(stage)
        for act in self.acts:
            act.update(stage)
        if self.state == RUNNING and all(act.state == COMPLETE for act in self.acts):
            self.enter(COMPLETE, END, stage)


@dataclass(frozen=True)
class Storyboard:
    """All events of a scenario.

    Attributes:
        init: Actions before the first step, by entity; actions without one have no name.
        stories: Its stories.
        stop_trigger: Ends it.
        times_s: Times of conditions that change by themselves.
        last_s: Latest time of a trajectory with absolute times.
    """

    init: Sequence[tuple[str, Action]]
    stories: Sequence[Story]
    stop_trigger: Trigger | None
    times_s: Sequence[float]
    last_s: float

    @property
    def is_complete(self) -> bool:
        """Whether everything in it has happened."""
        return all(story.state == COMPLETE for story in self.stories)


class StoryboardParser:
    """Parses the storyboard of a document."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        self._conditions = ConditionParser()
        self._path: list[str] = []
        self._times_s: list[float] = []
        self._last_s = 0.0

    def parse(self) -> Storyboard:
        """Parse it; problems are kept in the scope."""
        root = self._scope.source.root
        init = list(self._parse_init(root))
        stories = [self._parse_story(item) for item in root.iterfind("Storyboard/Story")]
        storyboard = root.find("Storyboard")
        stop = None
        if storyboard is not None:
            stop = self._parse_trigger(self._scope, storyboard, "StopTrigger")
        return Storyboard(init, stories, stop, sorted({*self._times_s}), self._last_s)

    def _parse_init(self, root: Element) -> Iterator[tuple[str, Action]]:
        for group in root.iterfind("Storyboard/Init/Actions/*"):
            is_private = group.tag == "Private"
            name = parse_entity(self._scope, group) if is_private else ""
            elements = list(group) if is_private else [group]
            for action in parse_actions(self._scope, elements):
                self._last_s = max(self._last_s, action.last_s)
                yield name, action

    def _parse_story(self, element: Element) -> Story:
        scope = self._scope.nest(element)
        with self._inside(scope, element):
            acts = [self._parse_act(scope, item) for item in element.iterfind("Act")]
            return self._register("story", Story(acts=acts))

    def _parse_act(self, scope: Scope, element: Element) -> Act:
        with self._inside(scope, element):
            groups = [self._parse_group(scope, item) for item in element.iterfind("ManeuverGroup")]
            act = Act(
                start_trigger=self._parse_trigger(scope, element, "StartTrigger"),
                stop_trigger=self._parse_trigger(scope, element, "StopTrigger"),
                groups=groups,
            )
            return self._register("act", act)

    def _parse_group(self, scope: Scope, element: Element) -> ManeuverGroup:
        holder = element.find("Actors")
        actors: list[str] = []
        if holder is not None:
            if scope.get_flag(holder, "selectTriggeringEntities"):
                scope.refuse(holder, "actors by trigger are not read", "name them")
            actors = [parse_entity(scope, item) for item in holder.iterfind("EntityRef")]
        found: list[tuple[Scope, Element]] = [
            (scope.nest(item), item) for item in element.iterfind("Maneuver")
        ]
        if element.find("CatalogReference") is not None:
            entry = scope.resolve(element)
            if entry is not None:
                found.append(entry)
        with self._inside(scope, element):
            maneuvers = [self._parse_maneuver(inner, item, actors) for inner, item in found]
            group = ManeuverGroup(maneuvers=maneuvers, max_executions=_parse_count(scope, element))
            return self._register("maneuverGroup", group)

    def _parse_maneuver(self, scope: Scope, element: Element, actors: list[str]) -> Maneuver:
        with self._inside(scope, element):
            events = [self._parse_event(scope, item, actors) for item in element.iterfind("Event")]
            return self._register("maneuver", Maneuver(events=events))

    def _parse_event(self, scope: Scope, element: Element, actors: list[str]) -> Event:
        priority = scope.get(element, "priority", "parallel")
        if priority not in PRIORITIES:
            scope.refuse(element, f"there is no priority '{priority[:20]}'")
        with self._inside(scope, element):
            event = Event(
                priority=priority,
                max_executions=_parse_count(scope, element),
                trigger=self._parse_trigger(scope, element, "StartTrigger"),
                actions=list(self._parse_actions(scope, element)),
                actors=actors,
            )
            return self._register("event", event)

    def _parse_actions(
        self, scope: Scope, element: Element
    ) -> Iterator[tuple[StoryElement, Action]]:
        for item in element.iterfind("Action"):
            with self._inside(scope, item):
                for action in parse_actions(scope, list(item)):
                    self._last_s = max(self._last_s, action.last_s)
                    yield self._register("action", StoryElement()), action

    def _parse_trigger(self, scope: Scope, element: Element, tag: str) -> Trigger | None:
        trigger = self._conditions.parse_trigger(scope, element, tag)
        if trigger is not None:
            self._times_s += trigger.list_times()
        return trigger

    @contextmanager
    def _inside(self, scope: Scope, element: Element) -> Generator[None]:
        """Parse the content of an element, whose name becomes part of its children's names."""
        self._path.append(scope.get(element, "name", ""))
        yield
        self._path.pop()

    def _register(self, kind: str, part: Part) -> Part:
        self._conditions.elements.setdefault((kind, tuple(self._path)), part)
        return part


def _parse_count(scope: Scope, element: Element) -> int:
    count = scope.get_number(element, "maximumExecutionCount", 1.0)
    return int(min(max(count, 1.0), MAX_EXECUTIONS)) if count == count else 1
