"""The layout of a declared road: its streets, and junctions with their paths and crossings.

The SUMO network, the lanes and the meshes of the road are all made from one layout, so they agree.
"""

from dataclasses import dataclass

import numpy as np
from advercity_dsl.road import Crossing, Junction, Movement, Road, StripKind
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.geometry import curves, polyline
from advercity.geometry.polyline import Points
from advercity.roads.arms import (
    JunctionArm,
    build_arms,
    complete_stop_signs,
    list_movements,
)
from advercity.roads.streets import StreetLayout, lay_out_streets

CROSSING_SETBACK_M = 0.6
"""Distance from the end of a street to the near edge of its crossing."""
MIN_CORNER_RADIUS_M = 0.5
"""Smallest radius of the inner border of a turn."""


@dataclass(frozen=True)
class JunctionCorner:
    """The corner between two neighbouring arms, counter-clockwise.

    Attributes:
        kerb: (n, 3) edge of the roadway, from the first arm to the second.
        sidewalk_outer_edge: (n, 3) outer edge of the sidewalk around it, a point for each
            of `kerb`; None where one of the arms has no sidewalk.
        outer_edge: (m, 3) outer edge of all strips, from the first arm to the second.
    """

    kerb: Points
    sidewalk_outer_edge: Points | None
    outer_edge: Points


@dataclass(frozen=True)
class ConnectingPath:
    """A movement through a junction.

    Attributes:
        id: `<junction>: <movement>`.
        movement: The declared movement.
        centre: (n, 3) from the end of one lane to the start of the other.
        left: (n, 3) left border, a point for each of `centre`.
        right: (n, 3) right border, likewise.
    """

    id: str
    movement: Movement
    centre: Points
    left: Points
    right: Points


@dataclass(frozen=True)
class CrossingLayout:
    """A zebra crossing over an arm.

    Attributes:
        street: Id of the crossed street.
        centre: (2, 3) from kerb to kerb.
        width_m: Width across `centre`.
    """

    street: str
    centre: Points
    width_m: float


@dataclass(frozen=True)
class JunctionLayout:
    """A junction with everything in it.

    Attributes:
        id: Declared id.
        declared: The declaration, with the stop signs of an all-way stop.
        arms: Ends of its streets, counter-clockwise.
        roadway_outline: (n, 3) edge of its roadway, counter-clockwise, open.
        corners: One per arm, from it to the next.
        connecting_paths: One per declared movement.
        crossings: Zebra crossings.
        median: (4, 3) the piece of median through it, or None.
    """

    id: str
    declared: Junction
    arms: tuple[JunctionArm, ...]
    roadway_outline: Points
    corners: tuple[JunctionCorner, ...]
    connecting_paths: tuple[ConnectingPath, ...]
    crossings: tuple[CrossingLayout, ...]
    median: Points | None

    def find_arm(self, street: str) -> JunctionArm:
        """Find the arm of a street."""
        return next(arm for arm in self.arms if arm.street.id == street)

    def turn_angle(self, source: str, target: str) -> float:
        """Compute the angle in radians from a street into another, positive to the left."""
        return self.find_arm(source).turn_angle(self.find_arm(target))

    def height_at(self, points: Points) -> NDArray[np.float64]:
        """Compute heights (n,) of the roadway at points (n, 2) inside the outline."""
        return interpolate_mean_value_height(self.roadway_outline, points)


def lay_out_junction(
    name: str, declared: Junction, streets: dict[str, StreetLayout]
) -> JunctionLayout:
    """Lay out a declared junction between sampled streets; InputError where they do not fit."""
    arms = build_arms(name, streets)
    corners = tuple(
        _build_corner(arm, following, declared.corner_radius_m)
        for arm, following in zip(arms, (*arms[1:], arms[0]), strict=True)
    )
    outline = np.concatenate([corner.kerb for corner in corners])
    by_street = {arm.street.id: arm for arm in arms}
    return JunctionLayout(
        id=name,
        declared=complete_stop_signs(declared, arms),
        arms=arms,
        roadway_outline=outline,
        corners=corners,
        connecting_paths=tuple(
            _build_connecting_path(name, item, by_street, outline, declared.turn_radius_m or np.inf)
            for item in list_movements(declared, arms)
        ),
        crossings=tuple(
            _lay_out_crossing(item, by_street[item.street]) for item in declared.crossings
        ),
        median=_build_median(name, declared.median, by_street) if declared.median else None,
    )


def _build_corner(arm: JunctionArm, following: JunctionArm, radius_m: float) -> JunctionCorner:
    u, v = arm.roadway_edge_offset(leftwards=True), following.roadway_edge_offset(leftwards=False)
    kerb = _connect_arms(arm, u, following, v, radius_m)
    here, there = arm.sidewalk_offsets(leftwards=True), following.sidewalk_offsets(leftwards=False)
    first = arm.point_at(arm.outer_edge_offset(leftwards=True))
    last = following.point_at(following.outer_edge_offset(leftwards=False))
    if here is None or there is None:
        return JunctionCorner(kerb, None, _join_lines(first, kerb, last))
    width = max(abs(here[1] - here[0]), abs(there[1] - there[0]))
    inner_radius_m = max(radius_m - width, MIN_CORNER_RADIUS_M)
    back = _connect_arms(arm, here[1], following, there[1], inner_radius_m)
    # Ribbons between the two lines need a point of one for each of the other.
    count = max(len(kerb), len(back))
    kerb, back = (
        line if len(line) == count else polyline.resample_polyline(line, count)
        for line in (kerb, back)
    )
    return JunctionCorner(kerb, back, _join_lines(first, back, last))


def _join_lines(*parts: Points) -> Points:
    return polyline.drop_repeated_points(np.vstack(parts))


def _connect_arms(
    arm: JunctionArm, u: float, following: JunctionArm, v: float, radius_m: float
) -> Points:
    start, end = arm.point_at(u), following.point_at(v)
    plane = curves.build_connecting_curve(
        start[:2], -arm.outward_direction, end[:2], following.outward_direction, radius_m=radius_m
    )
    along = polyline.polyline_stations(plane)
    z = np.interp(along / along[-1], [0.0, 1.0], [start[2], end[2]])
    return np.column_stack([plane, z])


def _build_connecting_path(
    name: str,
    movement: Movement,
    arms: dict[str, JunctionArm],
    outline: Points,
    turn_radius_m: float,
) -> ConnectingPath:
    source, target = arms[movement.from_street], arms[movement.to_street]
    leaving = source.street.find_lane(movement.from_lane, along=source.is_street_end)
    entering = target.street.find_lane(movement.to_lane, along=not target.is_street_end)
    out, into = -source.outward_direction, target.outward_direction
    leftwards = np.sign(out[0] * into[1] - out[1] * into[0])

    def through(first_t: float, last_t: float, left_m: float = 0.0) -> Points:
        """Connect two offsets around the centre of the middle path, which is `left_m` away."""
        start = source.point_at(source.to_arm_offset(first_t))
        end = target.point_at(target.to_arm_offset(last_t))
        # Borders of an arc are arcs around the same centre, so the lane keeps its width.
        radius = max(turn_radius_m - leftwards * left_m, MIN_CORNER_RADIUS_M)
        return curves.build_connecting_curve(start[:2], out, end[:2], into, radius_m=radius)

    centre = through(leaving.centre_t, entering.centre_t)
    half = leaving.width_m / 2
    count = max(2, int(np.ceil(polyline.polyline_length(centre))) + 1)
    left = through(leaving.inner_t, entering.inner_t, half)
    right = through(leaving.outer_t, entering.outer_t, -half)
    lines = [polyline.resample_polyline(line, count) for line in (centre, left, right)]
    z = interpolate_mean_value_height(outline, lines[0])
    # Lanes and paths share their end points exactly, so netconvert leaves no step between them.
    z[0], z[-1] = source.axis_end[2], target.axis_end[2]
    centre, left, right = (np.column_stack([line, z]) for line in lines)
    return ConnectingPath(f"{name}: {movement}", movement, centre, left, right)


def _lay_out_crossing(declared: Crossing, arm: JunctionArm) -> CrossingLayout:
    inward = CROSSING_SETBACK_M + declared.width_m / 2
    ends = [arm.point_at(arm.roadway_edge_offset(leftwards=side), inward) for side in (False, True)]
    return CrossingLayout(declared.street, np.stack(ends), declared.width_m)


def _build_median(name: str, between: tuple[str, str], arms: dict[str, JunctionArm]) -> Points:
    edges: list[Points] = []
    for street in between:
        arm = arms[street]
        widths = [
            [strip.outer_t for strip in strips if strip.kind is StripKind.MEDIAN]
            for strips in (arm.street.left_strips, arm.street.right_strips)
        ]
        if not all(widths):
            raise InputError(
                f"junctions.{name}.median: '{street}' has no median on both sides of its axis"
            )
        offsets = sorted(arm.to_arm_offset(side[-1]) for side in widths)
        edges += [arm.point_at(u) for u in offsets]
    return np.stack(edges)


def interpolate_mean_value_height(outline: Points, points: Points) -> NDArray[np.float64]:
    """Interpolate heights (n,) at points (n, 2) by mean value coordinates of a polygon's corners.

    The polygon (m, 3) is open and counter-clockwise, the points are inside it or on it. Heights in
    a plane are reproduced, and heights along every side are linear (Hormann and Floater, ACM
    Transactions on Graphics 25, 2006).
    """
    to_corner = outline[None, :, :2] - points[:, None]
    distance = np.linalg.norm(to_corner, axis=2)
    following = np.roll(to_corner, -1, axis=1)
    cross = to_corner[..., 0] * following[..., 1] - to_corner[..., 1] * following[..., 0]
    dot = (to_corner * following).sum(axis=2)
    half_angle = np.tan(np.arctan2(cross, dot) / 2)
    weight = (half_angle + np.roll(half_angle, 1, axis=1)) / np.maximum(distance, 1e-9)
    z = (weight @ outline[:, 2]) / weight.sum(axis=1)
    # At a corner all weights are infinite; its height is the limit.
    nearest = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) < 1e-6, outline[nearest, 2], z)


@dataclass(frozen=True)
class RoadLayout:
    """Streets and junctions by id, in the order of the declaration."""

    road: Road
    streets: dict[str, StreetLayout]
    junctions: dict[str, JunctionLayout]


def lay_out_road(road: Road) -> RoadLayout:
    """Lay out a declared road; InputError where streets cannot be joined as declared."""
    streets = dict(lay_out_streets(road))
    junctions = {
        name: lay_out_junction(name, item, streets) for name, item in road.junctions.items()
    }
    return RoadLayout(road=road, streets=streets, junctions=junctions)
