"""Conditions of OpenSCENARIO: each element becomes a function of the stage."""

import math
import operator
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.distances import (
    measure_distance,
    parse_distance_kind,
)
from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.elements import StoryElement
from advercity.recordings.openscenario.positions import parse_entity, parse_position
from advercity.recordings.openscenario.stage import Mover, Stage

Test = Callable[[Stage], bool]
TOLERANCE = 1e-9
RULES: Mapping[str, Callable[[float, float], bool]] = {
    "greaterThan": operator.gt,
    "lessThan": operator.lt,
    "equalTo": lambda value, limit: abs(value - limit) < 1e-3,
    "notEqualTo": lambda value, limit: abs(value - limit) >= 1e-3,
    "greaterOrEqual": operator.ge,
    "lessOrEqual": operator.le,
}
EDGES: Mapping[str, Callable[[bool, bool], bool]] = {
    "none": lambda before, now: now,
    "rising": lambda before, now: now and not before,
    "falling": lambda before, now: before and not now,
    "risingOrFalling": lambda before, now: before != now,
}


@dataclass
class Condition:
    """A condition, its last value, and its values over the delay.

    Attributes:
        test: Whether it holds now.
        edge: Whether it is fulfilled, by its last and its present value.
        delay_s: Time until the result counts.
        times_s: Times of changes by itself.
        before: Whether it held before the first test; None if unknown.
    """

    test: Test
    edge: Callable[[bool, bool], bool]
    delay_s: float
    times_s: tuple[float, ...] = ()
    find_before: Callable[[float], bool] | None = None
    _last: bool | None = None
    _history: deque[tuple[float, bool]] = field(default_factory=deque[tuple[float, bool]])

    def is_fulfilled(self, stage: Stage) -> bool:
        """Look at it, and return whether it is fulfilled."""
        now = self.test(stage)
        before = self._last
        if before is None:
            before = now if self.find_before is None else self.find_before(stage.time_s)
        self._last = now
        fulfilled = self.edge(before, now)
        if not self.delay_s:
            return fulfilled
        self._history.append((stage.time_s, fulfilled))
        due = False
        while self._history and self._history[0][0] <= stage.time_s - self.delay_s + TOLERANCE:
            due = self._history.popleft()[1] or due
        return due

    def reset(self) -> None:
        """Forget earlier values."""
        self._last = None
        self._history.clear()


@dataclass(frozen=True)
class Trigger:
    """Groups of conditions; it fires when all of one group are fulfilled."""

    groups: tuple[tuple[Condition, ...], ...]

    def fires(self, stage: Stage) -> bool:
        """Look at all conditions, and return whether it fires."""
        found = [[item.is_fulfilled(stage) for item in group] for group in self.groups]
        return any(all(group) for group in found)

    def reset(self) -> None:
        """Forget earlier values of the conditions."""
        for group in self.groups:
            for item in group:
                item.reset()

    def list_times(self) -> list[float]:
        """List times at which its conditions change by themselves."""
        return [time for group in self.groups for item in group for time in item.times_s]


class ConditionParser:
    """Parses triggers; conditions on parts of the storyboard find them by name later.

    Attributes:
        elements: Parts of the storyboard, by type and names from the story to their own, as far as
            they are parsed.
    """

    def __init__(self) -> None:
        self.elements: dict[tuple[str, tuple[str, ...]], StoryElement] = {}

    def parse_trigger(self, scope: Scope, element: Element, tag: str) -> Trigger | None:
        """Parse a trigger of an element; None if it has none, or one without conditions."""
        found = element.find(tag)
        groups = [] if found is None else found.findall("ConditionGroup")
        if not groups:
            return None
        return Trigger(
            tuple(
                tuple(
                    condition
                    for item in group.iterfind("Condition")
                    if (condition := self._parse(scope, item)) is not None
                )
                for group in groups
            )
        )

    def _parse(self, scope: Scope, element: Element) -> Condition | None:
        edge = scope.get(element, "conditionEdge", "none")
        delay_s = scope.get_number(element, "delay", 0.0)
        if edge not in EDGES or delay_s < 0:
            scope.refuse(element, f"its edge '{edge[:20]}' or delay is not known")
            return None
        kind = element.find("ByValueCondition/*")
        if kind is not None and kind.tag == "SimulationTimeCondition":
            return self._parse_time(scope, kind, edge, delay_s)
        if kind is not None and kind.tag == "StoryboardElementStateCondition":
            return Condition(self._parse_state(scope, kind), EDGES[edge], delay_s)
        if kind is not None and kind.tag in ("ParameterCondition", "VariableCondition"):
            return Condition(_parse_value(scope, kind), EDGES[edge], delay_s)
        kind = element.find("ByEntityCondition/EntityCondition/*")
        if kind is None or kind.tag not in ENTITY_CONDITIONS:
            inner = next(element.iterfind("ByValueCondition/*"), kind)
            found = inner if inner is not None else element
            scope.refuse(found, "such a condition is not read", "write the time at which it holds")
            return None
        holder = element.find("ByEntityCondition/TriggeringEntities")
        names: list[str] = []
        rule = any
        if holder is not None:
            names = [parse_entity(scope, item) for item in holder.iterfind("EntityRef")]
            rule = all if scope.get(holder, "triggeringEntitiesRule") == "all" else any
        test = ENTITY_CONDITIONS[kind.tag](scope, kind)

        def check(stage: Stage) -> bool:
            movers = [stage.movers[name] for name in names if name in stage.movers]
            present = [test(mover, stage) for mover in movers if mover.pose is not None]
            return bool(present) and rule(present)

        return Condition(check, EDGES[edge], delay_s)

    def _parse_time(self, scope: Scope, element: Element, edge: str, delay_s: float) -> Condition:
        value_s = scope.get_number(element, "value")
        rule = scope.get(element, "rule")
        # A time is passed as soon as it is reached.
        known = {"greaterThan": "greaterOrEqual", "lessOrEqual": "lessThan"}.get(rule, rule)
        if known not in RULES:
            scope.refuse(element, f"there is no rule '{rule[:20]}'")
            known = "greaterOrEqual"
        compare = RULES[known]
        times = (value_s, value_s + delay_s) if math.isfinite(value_s) else ()
        return Condition(
            lambda stage: compare(stage.time_s + TOLERANCE, value_s),
            EDGES[edge],
            delay_s,
            times,
            lambda time_s: compare(time_s - 2 * TOLERANCE, value_s),
        )

    def _parse_state(self, scope: Scope, element: Element) -> Test:
        kind = scope.get(element, "storyboardElementType")
        name, state = scope.get(element, "storyboardElementRef"), scope.get(element, "state")
        names = tuple(name.split("::"))

        def check(stage: Stage) -> bool:
            found = next(self._list_elements(kind, names), None)
            if found is None:
                stage.fail(scope, element, f"there is no {kind[:20]} '{name[:40]}'")
            return found.is_in(state, stage)

        return check

    def _list_elements(self, kind: str, names: tuple[str, ...]) -> Iterator[StoryElement]:
        """List the parts of the storyboard whose last names are these."""
        for (known, path), part in self.elements.items():
            if known == kind and path[-len(names) :] == names:
                yield part


def _parse_value(scope: Scope, element: Element) -> Test:
    name = scope.get(element, "parameterRef" if "parameterRef" in element.attrib else "variableRef")
    value, rule = scope.get(element, "value"), scope.get(element, "rule")
    if rule not in RULES:
        scope.refuse(element, f"there is no rule '{rule[:20]}'")

    def check(stage: Stage) -> bool:
        found = stage.values.get(name)
        if found is None:
            stage.fail(scope, element, f"'{name[:40]}' has no value")
        try:
            return RULES[rule](float(found), float(value))
        except ValueError:
            return (found == value) == (rule != "notEqualTo")

    return check


EntityTest = Callable[[Mover, Stage], bool]


def _parse_compared(
    scope: Scope, element: Element, measure: Callable[[Mover, Stage], float]
) -> EntityTest:
    rule, value = scope.get(element, "rule"), scope.get_number(element, "value")
    if rule not in RULES:
        scope.refuse(element, f"there is no rule '{rule[:20]}'")
        return lambda mover, stage: False
    return lambda mover, stage: RULES[rule](measure(mover, stage), value)


def _refuse_direction(scope: Scope, element: Element) -> None:
    if element.get("direction") not in (None, "longitudinal"):
        scope.refuse(element, "a direction other than longitudinal is not read")


def _parse_speed(scope: Scope, element: Element) -> EntityTest:
    _refuse_direction(scope, element)
    return _parse_compared(scope, element, lambda mover, stage: mover.speed_m_s)


def _parse_acceleration(scope: Scope, element: Element) -> EntityTest:
    _refuse_direction(scope, element)
    return _parse_compared(scope, element, lambda mover, stage: mover.acceleration_m_s2)


def _parse_relative_speed(scope: Scope, element: Element) -> EntityTest:
    _refuse_direction(scope, element)
    name = parse_entity(scope, element)

    def measure(mover: Mover, stage: Stage) -> float:
        other = stage.find_mover(scope, element, name)
        assert other.pose is not None and mover.pose is not None
        aligned = math.cos(other.pose.heading - mover.pose.heading)
        return mover.speed_m_s - other.speed_m_s * aligned

    return _parse_compared(scope, element, measure)


def _parse_stand_still(scope: Scope, element: Element) -> EntityTest:
    duration_s = scope.get_number(element, "duration")
    return lambda mover, stage: mover.standing_s >= duration_s - TOLERANCE


def _parse_travelled(scope: Scope, element: Element) -> EntityTest:
    distance_m = scope.get_number(element, "value")
    return lambda mover, stage: mover.travelled_m >= distance_m - TOLERANCE


def _parse_reach(scope: Scope, element: Element) -> EntityTest:
    find, tolerance_m = parse_position(scope, element), scope.get_number(element, "tolerance")

    def test(mover: Mover, stage: Stage) -> bool:
        assert find is not None and mover.pose is not None
        return abs(mover.pose.point - find(stage).point) <= tolerance_m

    return test


def _parse_distance(scope: Scope, element: Element) -> EntityTest:
    find = parse_position(scope, element)
    kind = parse_distance_kind(scope, element)

    def measure(mover: Mover, stage: Stage) -> float:
        assert find is not None
        return abs(measure_distance(stage, scope, element, kind, mover, find(stage), None))

    return _parse_compared(scope, element, measure)


def _parse_relative_distance(scope: Scope, element: Element) -> EntityTest:
    name = parse_entity(scope, element)
    kind = parse_distance_kind(scope, element)

    def measure(mover: Mover, stage: Stage) -> float:
        other = stage.find_mover(scope, element, name)
        assert other.pose is not None
        return abs(measure_distance(stage, scope, element, kind, mover, other.pose, other))

    return _parse_compared(scope, element, measure)


def _parse_headway(scope: Scope, element: Element) -> EntityTest:
    name = parse_entity(scope, element)
    kind = parse_distance_kind(scope, element)

    def measure(mover: Mover, stage: Stage) -> float:
        other = stage.find_mover(scope, element, name)
        assert other.pose is not None
        distance_m = measure_distance(stage, scope, element, kind, mover, other.pose, other)
        if distance_m < 0:  # there is no headway to one behind
            return math.nan
        return distance_m / mover.speed_m_s if mover.speed_m_s > 0 else math.inf

    return _parse_compared(scope, element, measure)


def _parse_collision_time(scope: Scope, element: Element) -> EntityTest:
    holder = element.find("TimeToCollisionConditionTarget/EntityRef")
    kind = parse_distance_kind(scope, element)
    if holder is None:
        scope.refuse(element, "its target is no entity", "name one with <EntityRef>")
        return lambda mover, stage: False
    name = parse_entity(scope, holder)

    def measure(mover: Mover, stage: Stage) -> float:
        other = stage.find_mover(scope, element, name)
        assert other.pose is not None and mover.pose is not None
        distance_m = measure_distance(stage, scope, element, kind, mover, other.pose, other)
        ahead = math.copysign(1.0, distance_m)
        turned = math.cos(other.pose.heading - mover.pose.heading)
        closing_m_s = ahead * (mover.speed_m_s - other.speed_m_s * turned)
        return abs(distance_m) / closing_m_s if closing_m_s > TOLERANCE else math.inf

    return _parse_compared(scope, element, measure)


def _parse_end_of_road(scope: Scope, element: Element) -> EntityTest:
    duration_s = scope.get_number(element, "duration")
    return lambda mover, stage: mover.is_at_end and mover.standing_s >= duration_s - TOLERANCE


ENTITY_CONDITIONS: Mapping[str, Callable[[Scope, Element], EntityTest]] = {
    "SpeedCondition": _parse_speed,
    "AccelerationCondition": _parse_acceleration,
    "RelativeSpeedCondition": _parse_relative_speed,
    "StandStillCondition": _parse_stand_still,
    "TraveledDistanceCondition": _parse_travelled,
    "ReachPositionCondition": _parse_reach,
    "DistanceCondition": _parse_distance,
    "RelativeDistanceCondition": _parse_relative_distance,
    "TimeHeadwayCondition": _parse_headway,
    "TimeToCollisionCondition": _parse_collision_time,
    "EndOfRoadCondition": _parse_end_of_road,
}
"""Parsers by element; others are refused."""
