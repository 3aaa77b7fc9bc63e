"""Actions across the road: changes of lane and of the offset in it."""

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.positions import count_lanes, find_own_lane, parse_entity
from advercity.recordings.openscenario.road_map import LanePlace, RoadMap, choose_straightest
from advercity.recordings.openscenario.stage import Mover, Process, Stage
from advercity.recordings.openscenario.transitions import (
    SHAPES,
    Dynamics,
    Transition,
    parse_dynamics,
)

MAX_SEARCH_M = 1000.0
"""How far along its lane another entity may be, of which a lane is counted."""
SEARCH_STEP_M = 5.0


class OffsetChange:
    """An offset in the lane on its way to another, to the left along a road.

    The entity may come to a road in the other direction.
    """

    def __init__(self, transition: Transition, along: int, *, is_kept: bool = False) -> None:
        self.is_done = False
        self._transition, self._along, self._is_kept = transition, along, is_kept

    def advance(self, mover: Mover, stage: Stage, step_s: float) -> None:
        """Change the offset over a step; the player moves the entity along its lane."""
        self._transition.advance(step_s, abs(mover.speed_m_s) * step_s)
        mover.lane_offset_m = self._transition.value * self._along
        self.is_done = self._transition.is_done and not self._is_kept


def parse_lane_change(
    scope: Scope, element: Element
) -> Callable[[Mover, Stage], Process | None] | None:
    """Parse a `LaneChangeAction`."""
    dynamics = parse_dynamics(scope, element, "LaneChangeActionDynamics")
    offset_m = scope.get_number(element, "targetLaneOffset", 0.0)
    find = _parse_target_lane(scope, element)
    if dynamics is None or find is None:
        return None

    def start(mover: Mover, stage: Stage) -> Process:
        place = find_own_lane(stage, scope, element, mover.entity.name)
        roads = stage.open_map()
        assert roads is not None
        target = place._replace(lane=find(mover, stage, place), offset_m=0.0)
        if not roads.has_lane(target):
            message = f"road '{place.road}' has no lane {target.lane} at {place.station_m:g} m"
            stage.fail(scope, element, message)
        begin_m = roads.find_left(place) - roads.find_left(target)
        transition = Transition(dynamics, begin_m, offset_m)
        return _start_offset(mover, stage, scope, element, target, transition)

    return start


def _parse_target_lane(
    scope: Scope, element: Element
) -> Callable[[Mover, Stage, LanePlace], int] | None:
    absolute = element.find("LaneChangeTarget/AbsoluteTargetLane")
    relative = element.find("LaneChangeTarget/RelativeTargetLane")
    if absolute is not None:
        lane = int(_parse_whole(scope, absolute))
        return lambda mover, stage, place: lane
    if relative is None:
        scope.refuse(element, "has no target")
        return None
    name, lanes = parse_entity(scope, relative), int(_parse_whole(scope, relative))

    def find(mover: Mover, stage: Stage, place: LanePlace) -> int:
        other = place
        if name != mover.entity.name:
            other = find_own_lane(stage, scope, relative, name)
        roads = stage.open_map()
        assert roads is not None
        lane = count_lanes(other.lane, lanes * other.along)
        found = find_same_lane(roads, place, other._replace(lane=lane))
        if found is None:
            message = f"no lane of road '{place.road}' leads to that of '{name}'"
            stage.fail(scope, relative, message)
        return found

    return find


def _parse_whole(scope: Scope, element: Element) -> float:
    number = scope.get_number(element, "value")
    if not math.isfinite(number) or number != int(number) or abs(number) > 1000:
        scope.refuse(element, f'value="{number:g}" is no number of lanes')
        return 0
    return number


def find_same_lane(roads: RoadMap, place: LanePlace, other: LanePlace) -> int | None:
    """Find the lane at a place connected to another, ahead or behind; None without one."""
    if other.road == place.road:
        return other.lane
    for along in (1, -1):
        ways = range(-20, 21)
        for lane in ways:
            start = place._replace(lane=lane, along=place.along * along, offset_m=0.0)
            if not lane or not roads.has_lane(start):
                continue
            covered_m, at = 0.0, start
            while covered_m < MAX_SEARCH_M and at.road != other.road:
                followed = roads.shift(at, SEARCH_STEP_M, choose_straightest(roads, at))
                if followed is None:
                    break
                at, covered_m = followed, covered_m + SEARCH_STEP_M
            if at.road == other.road and at.lane == other.lane:
                return lane
    return None


def parse_lane_offset(
    scope: Scope, element: Element
) -> Callable[[Mover, Stage], Process | None] | None:
    """Parse a `LaneOffsetAction`."""
    found = element.find("LaneOffsetActionDynamics")
    absolute = element.find("LaneOffsetTarget/AbsoluteTargetLaneOffset")
    relative = element.find("LaneOffsetTarget/RelativeTargetLaneOffset")
    target = absolute if absolute is not None else relative
    if found is None or target is None:
        scope.refuse(element, "has no dynamics or no target")
        return None
    shape = scope.get(found, "dynamicsShape")
    limit = scope.get_number(found, "maxLateralAcc", math.inf)
    if shape not in SHAPES or (math.isfinite(limit) and shape == "linear"):
        hint = "write sinusoidal, cubic or step"
        scope.refuse(found, f"a lateral acceleration has no limit with shape '{shape[:20]}'", hint)
        return None
    offset_m = scope.get_number(target, "value")
    name = parse_entity(scope, target) if target is relative else None
    is_kept = scope.get_flag(element, "continuous")

    def start(mover: Mover, stage: Stage) -> Process:
        place = find_own_lane(stage, scope, element, mover.entity.name)
        end_m = offset_m
        if name is not None:
            other = find_own_lane(stage, scope, target, name)
            other_m, left = _measure_offset(stage, scope, target, place, other)
            end_m = other_m + left * offset_m
        change_m = abs(end_m - place.offset_m)
        time_s = math.sqrt(change_m * SHAPES[shape].peak_curvature / limit)
        dynamics = Dynamics(SHAPES[shape], "time", time_s if math.isfinite(time_s) else 0.0)
        transition = Transition(dynamics, place.offset_m, end_m)
        return _start_offset(mover, stage, scope, element, place, transition, is_kept=is_kept)

    return start


def _measure_offset(
    stage: Stage, scope: Scope, element: Element, place: LanePlace, other: LanePlace
) -> tuple[float, int]:
    """Measure where another entity is in the lane of a place, and which way is to its left."""
    roads = stage.open_map()
    assert roads is not None
    lane = find_same_lane(roads, place, other)
    if lane is None:
        stage.fail(scope, element, f"no lane of road '{place.road}' leads to that of the entity")
    turned = 1 if place.road == other.road else place.along * other.along
    beside = place._replace(lane=lane, offset_m=other.offset_m * turned)
    offset_m = roads.find_left(beside) - roads.find_left(place._replace(offset_m=0.0))
    return offset_m, other.along * turned


def _start_offset(
    mover: Mover,
    stage: Stage,
    scope: Scope,
    element: Element,
    place: LanePlace,
    transition: Transition,
    *,
    is_kept: bool = False,
) -> Process:
    assert mover.pose is not None
    place = place._replace(offset_m=transition.value)
    if transition.is_done:  # at once
        roads = stage.open_map()
        assert roads is not None
        point, _ = roads.locate(place)
        stage.check_jump(scope, element, mover, point)
        mover.pose = mover.pose._replace(point=point)
    mover.pose = mover.pose._replace(lane=place)
    change = OffsetChange(transition, place.along, is_kept=is_kept)
    mover.assign(change, "lateral")
    path = mover.processes.get("path")
    if path is not None:
        path.is_done = True
    change.advance(mover, stage, 0.0)
    return change
