"""Roll vehicles with banked lanes of maps, and set them on the slope beside a lane's middle."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from advercity_dsl import Road
from numpy.typing import NDArray

from advercity.geometry.plane import compute_directions, compute_headings
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.road_network import build_road
from advercity.traffic.body_states import BodyCurves
from advercity.traffic.motion_spline import MotionSpline

Lean = Callable[[BodyCurves], BodyCurves]
"""Rolls a body in upright motion along the middle of lanes."""
MIN_RISE_M = 0.01
"""Minimum height between the borders of a banked lane; less is rounding of a map."""
MAX_ASIDE_M = 4.0
"""Maximum distance of a body from the middle of the lane beneath it."""
MAX_BELOW_M = 2.0
"""Maximum height between a body and its lane; farther lanes are a level below or above."""
SMOOTHING_TICKS = 4
"""Ticks over which a change of the roll is spread."""


def stay_upright(motion: BodyCurves) -> BodyCurves:
    """Leave a body upright, as on a level road."""
    return motion


def build_lean(road: Road, tick_s: float) -> Lean:
    """Build the function to roll the bodies of a road; declared roads are level across."""
    lanes = [] if road.imported is None else list(build_road(road).lanes)
    driven = [lane for lane in lanes if lane.kind == "driving" and lane.length_m > 0]
    rises = [np.abs(lane.left[:, 2] - lane.right[:, 2]).max() for lane in driven]
    if max(rises, default=0.0) < MIN_RISE_M:
        return stay_upright
    banking = _Banking(driven)
    return lambda motion: banking.lean(motion, tick_s)


class _Banking:
    """Slopes across lanes."""

    def __init__(self, lanes: list[LaneSegment]) -> None:
        middles = [(lane.left + lane.right) / 2 for lane in lanes]
        across = [lane.left - lane.right for lane in lanes]
        # The part of the gradient across the lane; the other is the pitch of the body.
        gradients = [
            line[:, 2:] * line[:, :2] / np.maximum((line[:, :2] ** 2).sum(axis=1), 1e-6)[:, None]
            for line in across
        ]
        self._lines = _build_lines(middles)
        # Lines whose height is a component of the gradient, for the same interpolation.
        self._components = [
            _build_lines(
                [
                    np.column_stack([middle[:, :2], gradient[:, axis]])
                    for middle, gradient in zip(middles, gradients, strict=True)
                ]
            )
            for axis in (0, 1)
        ]
        self._tree = shapely.STRtree(self._lines)

    def lean(self, motion: BodyCurves, tick_s: float) -> BodyCurves:
        """Roll a body by the slope to its left, and lift it by its offset from the middle."""
        slopes, lifts = self._sample(motion)
        slope, lift = (
            MotionSpline.from_samples(values, tick_s, ticks=SMOOTHING_TICKS).derivatives
            for values in (slopes, lifts)
        )
        # A pitched body turns about its own axis, not about a level one.
        level = compute_directions(motion.pitch[0]).real
        across = level * slope[0]
        rate = level * slope[1] / (1 + across * across)
        roll = np.stack([compute_headings(1 + 1j * across), rate])
        return replace(motion, height=motion.height + lift, roll=roll)

    def _sample(self, motion: BodyCurves) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Sample the slope (n,) to the left, and the height (n,) above the middle of the lane."""
        plan, heights, yaw = motion.plan[0], motion.height[0], motion.yaw[0]
        points = shapely.points(plan.real, plan.imag)
        which, lines = self._tree.query(points, predicate="dwithin", distance=MAX_ASIDE_M)
        at = shapely.line_locate_point(self._lines[lines], points[which])
        feet = shapely.line_interpolate_point(self._lines[lines], at)
        gaps = np.abs(shapely.get_z(feet) - heights[which])
        near = shapely.distance(points[which], feet)
        order = np.lexsort((near, which))
        order = order[gaps[order] < MAX_BELOW_M]
        # The nearest of the lanes beneath each place.
        found, first = np.unique(which[order], return_index=True)
        chosen = order[first]
        gradient = [
            shapely.get_z(shapely.line_interpolate_point(lines_[lines[chosen]], at[chosen]))
            for lines_ in self._components
        ]
        slopes, lifts = np.zeros(len(plan)), np.zeros(len(plan))
        ahead = compute_directions(yaw[found])
        slopes[found] = gradient[1] * ahead.real - gradient[0] * ahead.imag
        lifts[found] = gradient[0] * (plan.real[found] - shapely.get_x(feet[chosen]))
        lifts[found] += gradient[1] * (plan.imag[found] - shapely.get_y(feet[chosen]))
        return slopes, lifts


def _build_lines(lines: list[NDArray[np.float64]]) -> NDArray[np.object_]:
    return np.array([shapely.LineString(line) for line in lines], dtype=np.object_)
