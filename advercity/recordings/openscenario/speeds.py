"""Actions on the speed of an entity."""

from collections.abc import Callable, Sequence
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.positions import parse_entity
from advercity.recordings.openscenario.stage import Mover, Process, Stage
from advercity.recordings.openscenario.transitions import (
    Dynamics,
    Transition,
    parse_dynamics,
)

Target = Callable[[Stage], float]
MIN_SPEED_M_S = 0.01
"""Below it, a distance is not covered within the scenario."""


class SpeedChange:
    """A speed on its way to a target, which may be another entity's."""

    def __init__(self, transition: Transition, target: Target | None) -> None:
        self.is_done = False
        self._transition, self._target = transition, target

    def advance(self, mover: Mover, stage: Stage, step_s: float) -> None:
        """Change the speed over a step."""
        self._transition.advance(step_s, abs(mover.speed_m_s) * step_s)
        if self._target is not None:
            self._transition.end = self._target(stage)
        mover.speed_m_s = self._transition.value
        self.is_done = self._transition.is_done and self._target is None


class SpeedProfile:
    """Speeds by time, linear between them."""

    def __init__(self, entries: Sequence[tuple[float, float]]) -> None:
        self.is_done = False
        self._entries = entries
        self._elapsed_s = 0.0

    def advance(self, mover: Mover, stage: Stage, step_s: float) -> None:
        """Change the speed over a step."""
        self._elapsed_s += step_s
        before_s, before = self._entries[0]
        for after_s, after in self._entries[1:]:
            if self._elapsed_s <= after_s and after_s > before_s:
                share = (self._elapsed_s - before_s) / (after_s - before_s)
                mover.speed_m_s = before + share * (after - before)
                return
            before_s, before = after_s, after
        mover.speed_m_s = before
        self.is_done = True


def parse_speed(scope: Scope, element: Element) -> Callable[[Mover, Stage], Process | None] | None:
    """Parse a `SpeedAction`."""
    dynamics = parse_dynamics(scope, element, "SpeedActionDynamics")
    absolute = element.find("SpeedActionTarget/AbsoluteTargetSpeed")
    relative = element.find("SpeedActionTarget/RelativeTargetSpeed")
    if absolute is not None:
        speed_m_s = scope.get_number(absolute, "value")
        return (
            None
            if dynamics is None
            else _start_change(scope, element, dynamics, lambda _: speed_m_s)
        )
    if relative is None:
        scope.refuse(element, "has no target")
        return None
    target = _parse_relative(scope, relative)
    is_continuous = scope.get_flag(relative, "continuous")
    if dynamics is None:
        return None
    return _start_change(scope, element, dynamics, target, is_continuous=is_continuous)


def _start_change(
    scope: Scope,
    element: Element,
    dynamics: Dynamics,
    target: Target,
    *,
    is_continuous: bool = False,
) -> Callable[[Mover, Stage], Process | None]:
    def start(mover: Mover, stage: Stage) -> Process | None:
        transition = Transition(dynamics, mover.speed_m_s, target(stage))
        if transition.is_by_distance and abs(mover.speed_m_s) < MIN_SPEED_M_S:
            message = f"'{mover.entity.name}' stands, and never covers the distance"
            stage.fail(scope, element, message, "give the change a time")
        change = SpeedChange(transition, target if is_continuous else None)
        mover.assign(change, "speed")
        if transition.is_done:
            change.advance(mover, stage, 0.0)
        return change

    return start


def _parse_relative(scope: Scope, element: Element) -> Target:
    name = parse_entity(scope, element)
    value = scope.get_number(element, "value")
    is_factor = scope.get(element, "speedTargetValueType") == "factor"

    def find(stage: Stage) -> float:
        speed_m_s = stage.find_mover(scope, element, name).speed_m_s
        return speed_m_s * value if is_factor else speed_m_s + value

    return find


def parse_speed_profile(
    scope: Scope, element: Element
) -> Callable[[Mover, Stage], Process | None] | None:
    """Parse a `SpeedProfileAction` of speeds with times, without limits of acceleration."""
    if element.get("entityRef") is not None:
        scope.refuse(element, "its speeds are relative to an entity", "give absolute speeds")
        return None
    if scope.get(element, "followingMode") == "follow":
        hint = 'times alone are kept with followingMode="position"'
        scope.refuse(element, "follows the profile with limits of jerk", hint)
        return None
    entries = element.findall("SpeedProfileEntry")
    untimed = next((item for item in entries if item.get("time") is None), None)
    if untimed is not None or not entries:
        scope.refuse(untimed if untimed is not None else element, "has no time")
        return None
    steps = [(scope.get_number(item, "time"), scope.get_number(item, "speed")) for item in entries]

    def start(mover: Mover, stage: Stage) -> Process:
        times_s = 0.0
        profile = [(0.0, mover.speed_m_s)]
        for step_s, speed_m_s in steps:
            times_s += step_s
            profile.append((times_s, speed_m_s))
        process = SpeedProfile(profile)
        mover.assign(process, "speed")
        if steps[0][0] == 0:
            mover.speed_m_s = steps[0][1]
        return process

    return start
