"""Lanes of a stretch of road: who may use them, and their borders in space."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from advercity.errors import InputError
from advercity.geometry.polyline import Points
from advercity.roads.opendrive.document import Lane, LaneSection, Road, SpeedLimit
from advercity.roads.opendrive.lane_types import LANE_USES
from advercity.roads.opendrive.profiles import (
    Profile,
    Values,
    evaluate_piece,
    evaluate_profile,
)
from advercity.roads.opendrive.reference_line import sample_offset_points
from advercity.roads.plain_edges import PlainLane

STEP_M = 0.5
"""Largest distance between stations; needless points are dropped afterwards."""
MIN_LENGTH_M = 0.01
"""Shorter stretches have no direction."""
MIN_WIDTH_M = 0.05
"""A lane that is nowhere wider is ignored."""
MAX_WIDTH_M = 60.0


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of a road with the same lanes and limits from end to end.

    Attributes:
        road: Its road.
        section: Its section of lanes.
        stations_m: (n,) stations of the points of its lanes.
        ribbons: Its lanes by id, from left to right, without lanes of bare ground.
    """

    road: Road
    section: LaneSection
    stations_m: Values
    ribbons: dict[int, PlainLane]


def build_stretches(road: Road) -> Iterator[Stretch]:
    """Split a road where its lanes or limits change, and sample its lanes."""
    for section, (begins_m, ends_m) in zip(road.sections, pairwise(_place_ends(road)), strict=True):
        limits = [road.speeds, *(lane.speeds for lane in section.lanes.values())]
        begins = [0.0] + [section.begins_m] * (len(limits) - 1)
        changes = {
            base_m + limit.begins_m
            for base_m, group in zip(begins, limits, strict=True)
            for limit in group
        }
        if road.is_loop:
            changes.add(road.length_m / 2)
        inner = (at for at in sorted(changes) if begins_m < at < ends_m)
        for first_m, last_m in pairwise([begins_m, *inner, ends_m]):
            if last_m - first_m > MIN_LENGTH_M:
                yield _build_stretch(road, section, first_m, last_m)


def _place_ends(road: Road) -> list[float]:
    """Place the stations where sections begin, and the end of the last.

    Editors leave sections of some millimetres, which link lanes: they grow to have a direction.
    """
    begins = [section.begins_m for section in road.sections]
    ends = [*begins[1:], road.length_m]
    # Of two sections with one begin, the first is void. The last may begin at the end or beyond it,
    # as numbers of a file are rounded and roads end where their geometry does.
    void = [first == last for first, last in pairwise(begins)]
    grown_m = [
        2 * MIN_LENGTH_M * (first - MIN_LENGTH_M < last and not is_void)
        for first, last, is_void in zip(begins, ends, [*void, False], strict=True)
    ]
    placed = [begins[0]]
    for end_m, least_m in zip(ends, grown_m, strict=True):
        placed.append(max(end_m, placed[-1] + least_m))
    placed[-1] = road.length_m
    for index in reversed(range(1, len(grown_m))):
        placed[index] = max(min(placed[index], placed[index + 1] - grown_m[index]), begins[0])
    return placed


def _build_stretch(road: Road, section: LaneSection, first_m: float, last_m: float) -> Stretch:
    stations = _place_stations(road, section, first_m, last_m)
    ids = sorted(section.lanes, reverse=True)
    borders_m = _compute_borders(road, section, stations)
    points = sample_offset_points(road, stations, borders_m)
    _level_lanes(points, section, ids)
    ribbons: dict[int, PlainLane] = {}
    for index, lane_id in enumerate(ids):
        lane = section.lanes[lane_id]
        use = LANE_USES.get(lane.type)
        widest_m = float(np.abs(borders_m[:, index] - borders_m[:, index + 1]).max())
        if widest_m > MAX_WIDTH_M:
            raise InputError(
                f"line {lane.line}: <lane>: is {widest_m:g} m wide; lanes are at most"
                f" {MAX_WIDTH_M:g} m wide"
            )
        if use is None or widest_m < MIN_WIDTH_M:
            continue
        speed = _find_limit(lane.speeds, max(first_m - section.begins_m, 0.0))
        if speed is None and not use.is_walked:
            speed = _find_limit(road.speeds, first_m)
        left, right = points[:, index], points[:, index + 1]
        ribbons[lane_id] = PlainLane(use, speed or use.speed_m_s, left, right)
    return Stretch(road, section, stations, ribbons)


def _find_limit(limits: tuple[SpeedLimit, ...], at_m: float) -> float | None:
    found = [item.speed_m_s for item in limits if item.begins_m <= at_m + MIN_LENGTH_M]
    return found[-1] if found else None


def _place_stations(road: Road, section: LaneSection, first_m: float, last_m: float) -> Values:
    profiles: list[Profile] = [road.elevation, road.superelevation, road.lane_offset]
    changes = [item.begins_m for profile in profiles for item in profile]
    changes += [item.begins_m for item in road.geometries]
    changes += [item.station_m for item in road.cross_sections]
    changes += [
        section.begins_m + item.begins_m
        for lane in section.lanes.values()
        for item in (*lane.widths, *lane.borders)
    ]
    inner = [at for at in changes if first_m + MIN_LENGTH_M < at < last_m - MIN_LENGTH_M]
    count = int(np.ceil((last_m - first_m) / STEP_M))
    return np.unique([*np.linspace(first_m, last_m, count + 1), *inner])


def _compute_borders(road: Road, section: LaneSection, stations: Values) -> Values:
    """Compute the borders (n, k + 1) of k lanes from left to right, as distances to the left."""
    middle = evaluate_piece(road.lane_offset, stations, float(stations[-1]) - MIN_LENGTH_M)
    along_m = np.maximum(stations - section.begins_m, 0.0)
    left, right = [middle], [middle]
    for lane_id in sorted(section.lanes, key=abs):
        borders, side = (left, 1.0) if lane_id > 0 else (right, -1.0)
        borders.append(_compute_outer_edge(section.lanes[lane_id], borders[-1], along_m, side))
    return np.stack([*left[:0:-1], *right], axis=1)


def _compute_outer_edge(lane: Lane, inner_m: Values, along_m: Values, side: float) -> Values:
    # By the standard, widths hold if a lane has both.
    if lane.widths or not lane.borders:
        return inner_m + side * np.maximum(evaluate_profile(lane.widths, along_m), 0.0)
    # Borders are distances from the reference line; some maps write them without the side's sign.
    border_m = side * np.abs(evaluate_profile(lane.borders, along_m))
    return side * np.maximum(side * border_m, side * inner_m)


def _level_lanes(points: Points, section: LaneSection, ids: list[int]) -> None:
    """Give level lanes, and the lanes outside them, the height of the inner border."""
    middle = sum(lane_id > 0 for lane_id in ids)
    left = [(index, index + 1) for index in range(middle - 1, -1, -1)]
    right = [(index + 1, index) for index in range(middle, len(ids))]
    for side in (left, right):
        is_level = False
        for outer, inner in side:
            is_level = is_level or section.lanes[ids[min(outer, inner)]].is_level
            if is_level:
                points[:, outer, 2] = points[:, inner, 2]
