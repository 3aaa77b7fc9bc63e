"""Playing a storyboard step by step: entities move, events begin and end."""

import math
from bisect import bisect_right

import numpy as np

from advercity.errors import InputError
from advercity.recordings.openscenario.stage import ACROSS_RAD, Mover, Pose, Sample, Stage
from advercity.recordings.openscenario.storyboard import Storyboard
from advercity.recordings.openscenario.trajectories import MAX_TIME_S, TimedFollower

STEP_S = 0.05
"""Longest step; times of conditions are steps, too."""
MAX_SAMPLES = 2_000_000
"""Places of all entities together."""
UNENDED_S = 60.0
"""Length of a scenario without an end."""
MIN_STEP_S = 1e-6
STANDING_M_S = 0.01
MAX_ASIDE = math.sin(ACROSS_RAD)


def play(storyboard: Storyboard, stage: Stage) -> None:
    """Play a storyboard to its end; movers have their samples then.

    Raises:
        InputError: It takes too long, or cannot go on.
    """
    _check_size(stage, storyboard.last_s)
    for name, action in storyboard.init:
        if not action.is_private or name in stage.movers:
            action.start(stage.movers.get(name), stage)
    while True:
        for story in storyboard.stories:
            story.update(stage)
        is_over = _is_over(storyboard, stage)
        for mover in stage.movers.values():
            _record(mover, stage, is_last=is_over)
        if is_over:
            return
        step_s = _find_step(storyboard, stage.time_s)
        for mover in stage.movers.values():
            _advance(mover, stage, step_s)
        stage.time_s += step_s
        stage.step += 1
        if stage.step % 1000 == 0:
            _check_size(stage, stage.time_s)


def _check_size(stage: Stage, end_s: float) -> None:
    if len(stage.movers) * end_s / STEP_S > MAX_SAMPLES:
        raise InputError(
            f"{stage.scope.source.path}: {len(stage.movers)} entities up to {end_s:,.0f} s have"
            f" more than {MAX_SAMPLES:,} places, with one every {STEP_S:g} s; shorten the scenario"
        )


def _is_over(storyboard: Storyboard, stage: Stage) -> bool:
    if storyboard.stop_trigger is not None and storyboard.stop_trigger.fires(stage):
        return True
    if stage.time_s >= MAX_TIME_S:
        return True
    if storyboard.stories and storyboard.is_complete:
        return storyboard.stop_trigger is None or stage.time_s >= UNENDED_S
    is_busy = any(mover.processes for mover in stage.movers.values())
    if stage.time_s < UNENDED_S - MIN_STEP_S or (is_busy and stage.time_s < storyboard.last_s):
        return False
    stage.scope.findings.ledger.leave_out(f"end, which is not reached after {UNENDED_S:g} s")
    return True


def _find_step(storyboard: Storyboard, time_s: float) -> float:
    """Find the step to the next multiple of `STEP_S`, or time of a condition."""
    count = math.floor(time_s / STEP_S + MIN_STEP_S) + 1
    following_s = count * STEP_S
    index = bisect_right(storyboard.times_s, time_s + MIN_STEP_S)
    if index < len(storyboard.times_s):
        following_s = min(following_s, storyboard.times_s[index])
    return following_s - time_s


def _record(mover: Mover, stage: Stage, *, is_last: bool) -> None:
    path = mover.processes.get("path")
    is_dense = isinstance(path, TimedFollower) and path.is_dense(stage.time_s) and stage.step > 0
    if mover.pose is not None and (is_last or not is_dense):
        mover.samples.append(Sample(stage.time_s, mover.pose))


def _advance(mover: Mover, stage: Stage, step_s: float) -> None:
    before, speed_m_s = mover.pose, mover.speed_m_s
    if before is None and "path" not in mover.processes:
        return
    mover.run("speed", stage, step_s)
    is_led = mover.run("path", stage, step_s)
    if mover.pose is None:
        return
    if before is not None and not is_led:
        # The mean of both speeds is exact for a constant acceleration.
        _drive_on(mover, stage, step_s, (speed_m_s + mover.speed_m_s) / 2)
    if before is not None:
        mover.travelled_m += abs(mover.pose.point - before.point)
    mover.acceleration_m_s2 = (mover.speed_m_s - speed_m_s) / step_s
    is_standing = abs(mover.speed_m_s) < STANDING_M_S
    mover.standing_s = mover.standing_s + step_s if is_standing else 0.0


def _drive_on(mover: Mover, stage: Stage, step_s: float, speed_m_s: float) -> None:
    """Move along the lane; off the road, or across it, straight on."""
    pose = mover.pose
    assert pose is not None
    mover.lane_offset_m = None
    mover.run("lateral", stage, step_s)
    distance_m = speed_m_s * step_s
    if not distance_m and mover.lane_offset_m is None:
        return
    place = stage.find_lane(pose)
    roads = stage.open_map()
    if place is None or roads is None:
        ahead = distance_m * complex(np.exp(1j * pose.heading))
        mover.pose = pose._replace(point=pose.point + ahead)
        return
    changed_m = mover.lane_offset_m
    offset_m = place.offset_m if changed_m is None else changed_m * place.along
    aside_m = (offset_m - place.offset_m) * place.along
    sign = 1 if distance_m >= 0 else -1
    facing = place._replace(along=place.along * sign)
    choose = stage.choose_way(mover, facing)
    moved = roads.advance(facing, abs(distance_m), offset_m, choose)
    if moved is None:
        if not mover.is_at_end:
            name = "end of a road at which an actor stops"
            plural = "ends of roads at which actors stop"
            stage.scope.findings.ledger.leave_out(name, plural=plural)
        mover.is_at_end = True
        mover.speed_m_s = 0.0
        mover.processes.pop("speed", None)
        return
    moved = moved._replace(along=moved.along * sign)
    point, heading = roads.locate(moved)
    if distance_m:
        # This part of the way, which is as long as the distance, leads aside.
        aside = min(max(aside_m / distance_m, -MAX_ASIDE), MAX_ASIDE)
        heading += math.asin(aside)
    else:  # at rest it does not turn
        heading = pose.heading
    mover.pose = Pose(point, heading, lane=moved)
