"""Actions of OpenSCENARIO: each element becomes a function to begin it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.lateral import (
    parse_lane_change,
    parse_lane_offset,
)
from advercity.recordings.openscenario.positions import (
    parse_entity,
    parse_position,
)
from advercity.recordings.openscenario.routes import Route, parse_route
from advercity.recordings.openscenario.speeds import parse_speed, parse_speed_profile
from advercity.recordings.openscenario.stage import Mover, Pose, Process, Stage
from advercity.recordings.openscenario.trajectories import Follow, parse_follow

Start = Callable[[Any, Stage], Process | None]
"""Begins an action of an entity; None if it has ended at once."""


@dataclass(frozen=True)
class Action:
    """An action, begun for every actor of its event, or once if it concerns none of them."""

    name: str
    start: Start
    is_private: bool = True
    last_s: float = 0.0


def parse_action(scope: Scope, element: Element) -> Action | None:
    """Parse a `PrivateAction`, `GlobalAction` or `UserDefinedAction`.

    Returns:
        None if it has no effect, which is recorded, or is refused.
    """
    kind = element
    # Some actions are wrapped in up to three elements; the innermost known one counts.
    while kind.tag not in ACTIONS and len(kind):
        kind = kind[0]
    if kind.tag not in ACTIONS:
        first = next(iter(element), element)
        inner = next((item for item in first if item.tag.endswith("Action")), first)
        scope.refuse(inner, "such an action is not read", "record the motion as a trajectory")
        return None
    return ACTIONS[kind.tag](scope, kind)


def _parse_teleport(scope: Scope, element: Element) -> Action | None:
    find = parse_position(scope, element)
    if find is None:
        return None

    def start(mover: Mover, stage: Stage) -> None:
        pose = find(stage)
        stage.check_jump(scope, element, mover, pose.point)
        _put(mover, pose, stage, scope, element)
        mover.is_at_end = False

    return Action(element.tag, start)


def _put(mover: Mover, pose: Pose, stage: Stage, scope: Scope, element: Element) -> None:
    if mover.pose is None and mover.samples:
        message = f"'{mover.entity.name}' comes back at {stage.time_s:g} s"
        stage.fail(scope, element, message, "an actor is there once; make it two entities")
    heading = 0.0 if math.isnan(pose.heading) else pose.heading
    mover.pose = pose._replace(heading=heading)
    mover.route = pose.route or mover.route


def _parse_follow(scope: Scope, element: Element) -> Action | None:
    follow = parse_follow(scope, element)
    if follow is None:
        return None
    last_s = follow.find_end_s()
    if math.isnan(last_s):
        last_s = 0.0
    return Action(
        element.tag, lambda mover, stage: _start_follow(follow, mover, stage), last_s=last_s
    )


def _start_follow(follow: Follow, mover: Mover, stage: Stage) -> Process:
    follower = follow.start(mover, stage)
    is_timed = follow.timing is not None
    mover.assign(follower, "path", "lateral", *(("speed",) if is_timed else ()))
    return follower


def _parse_speed(scope: Scope, element: Element) -> Action | None:
    process = parse_speed(scope, element)
    return None if process is None else Action(element.tag, process)


def _parse_speed_profile(scope: Scope, element: Element) -> Action | None:
    process = parse_speed_profile(scope, element)
    return None if process is None else Action(element.tag, process)


def _parse_lane_change(scope: Scope, element: Element) -> Action | None:
    process = parse_lane_change(scope, element)
    return None if process is None else Action(element.tag, process)


def _parse_lane_offset(scope: Scope, element: Element) -> Action | None:
    process = parse_lane_offset(scope, element)
    return None if process is None else Action(element.tag, process)


def _parse_route(scope: Scope, element: Element) -> Action | None:
    route = parse_route(scope, element, parse_position)
    if route is None:
        return None

    def start(mover: Mover, stage: Stage) -> None:
        mover.route = route.find_roads(stage, mover)

    return Action(element.tag, start)


def _parse_acquire(scope: Scope, element: Element) -> Action | None:
    goal = parse_position(scope, element)
    if goal is None:
        return None
    route = Route(scope, element, (goal,))

    def start(mover: Mover, stage: Stage) -> None:
        mover.route = route.find_roads(stage, mover)

    return Action(element.tag, start)


def _parse_entity(scope: Scope, element: Element) -> Action | None:
    name = parse_entity(scope, element)
    added = element.find("AddEntityAction")
    find = parse_position(scope, added) if added is not None else None

    def start(mover: Mover | None, stage: Stage) -> None:
        found = stage.movers.get(name)
        if found is not None:
            if find is None:
                found.leave(stage)
            else:
                _put(found, find(stage), stage, scope, element)

    return Action(element.tag, start, is_private=False)


def _parse_value(scope: Scope, element: Element) -> Action | None:
    """Parse an action on a parameter or variable."""
    name = scope.get(element, "parameterRef" if "parameterRef" in element.attrib else "variableRef")
    changed = next(iter(element), None)
    if changed is None:
        scope.refuse(element, "has no content")
        return None
    rule = next(changed.iterfind("Rule/*"), None)
    given = scope.get(changed, "value", "") if rule is None else scope.get(rule, "value")

    def start(mover: Mover | None, stage: Stage) -> None:
        if rule is None:
            stage.values[name] = given
            return
        try:
            before, by = float(stage.values.get(name, "")), float(given)
        except ValueError:
            stage.fail(scope, element, f"'{name[:40]}' is no number")
        stage.values[name] = str(before * by if rule.tag.startswith("Mult") else before + by)

    return Action(element.tag, start, is_private=False)


def _parse_activation(scope: Scope, element: Element) -> Action | None:
    """Refuse a controller in charge; the default one keeps speed and lane."""
    flags = ("longitudinal", "lateral", "activateLongitudinal", "activateLateral")
    if any(scope.get_flag(element, name) for name in flags):
        hint = "record its motion as a trajectory"
        scope.refuse(element, "a controller drives the entity", hint)
        return None
    return _do_nothing(scope, element)


def _do_nothing(scope: Scope, element: Element) -> Action:
    """Parse an action without motion: its event begins and ends without effect."""
    return Action(element.tag, lambda mover, stage: None, is_private=False)


MOVES_NOBODY = (
    "OverrideControllerValueAction",
    "VisibilityAction",
    "AppearanceAction",
    "EnvironmentAction",
    "InfrastructureAction",
    "SetMonitorAction",
)
"""Actions listed as left out."""
ACTIONS: Mapping[str, Callable[[Scope, Element], Action | None]] = {
    "TeleportAction": _parse_teleport,
    "FollowTrajectoryAction": _parse_follow,
    "SpeedAction": _parse_speed,
    "SpeedProfileAction": _parse_speed_profile,
    "LaneChangeAction": _parse_lane_change,
    "LaneOffsetAction": _parse_lane_offset,
    "AssignRouteAction": _parse_route,
    "AcquirePositionAction": _parse_acquire,
    "EntityAction": _parse_entity,
    "ParameterAction": _parse_value,
    "VariableAction": _parse_value,
    "ActivateControllerAction": _parse_activation,
    "AssignControllerAction": _parse_activation,
    **dict.fromkeys(MOVES_NOBODY, _do_nothing),
}
"""Parsers by element; others are refused."""


def parse_actions(scope: Scope, elements: Sequence[Element]) -> tuple[Action, ...]:
    """Parse several actions."""
    found = (parse_action(scope, element) for element in elements)
    return tuple(item for item in found if item is not None)
