"""Rays that spread around a viewpoint, and which of them may meet a box."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.poses import Matrix

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

_TURN_RAD = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Fan:
    """How rays spread around a viewpoint, which tells for most of them what they cannot meet.

    Rays come in columns of one bearing. They need not start at the viewpoint, but lie in the
    upright half-plane of their bearing.

    Attributes:
        world_from_fan: (4, 4); bearings turn about its z axis.
        bearing_rad: (m,) float32 of every column of rays, ascending, from 0 to 2 pi.
        elevation_rad: (c,) float32 of the rays of each column, ascending; None if a column is one
            ray.
        single_rad: (m,) float32 elevation where a column is one ray, seen from the viewpoint; None
            if rays point anywhere in their half-plane.
        spread_rad: How far a ray may stray from its bearing and elevation.
        reach_m: How far from the fan's origin the viewpoint may be.
    """

    world_from_fan: Matrix
    bearing_rad: Floats
    elevation_rad: Floats | None = None
    single_rad: Floats | None = None
    spread_rad: float = 0.0
    reach_m: float = 0.0

    def rows(self, where: Rows) -> "Fan":
        """The fan of those rays alone; `where` ascends."""
        width = 1 if self.elevation_rad is None else len(self.elevation_rad)
        single_rad = None if self.single_rad is None else self.single_rad[where]
        if self.elevation_rad is not None:
            single_rad = self.elevation_rad[where % width]
        return Fan(
            self.world_from_fan,
            self.bearing_rad[where // width],
            single_rad=single_rad,
            spread_rad=self.spread_rad,
            reach_m=self.reach_m,
        )

    def towards(self, corners: Array) -> tuple[Rows, Rows]:
        """Pairs of a ray and a box of the world that it may meet: ray, box (p,) each.

        They come box by box.

        Args:
            corners: (k, c, 3) of what the boxes are the hulls of, metres.
        """
        view = self._view(corners)
        # A run that begins before the seam goes on behind it.
        begins = np.stack([view.first - _TURN_RAD, view.first], axis=1).ravel()
        ends = begins + np.repeat(view.span, 2)
        start = self.bearing_rad.searchsorted(begins.astype(np.float32))
        stop = self.bearing_rad.searchsorted(ends.astype(np.float32))
        start[1::2] = np.maximum(start[1::2], stop[::2])
        if self.elevation_rad is not None:
            low = self.elevation_rad.searchsorted(view.bottom)
            high = self.elevation_rad.searchsorted(view.top, side="right")
            return _pairs(start, stop, low, high, len(self.elevation_rad))
        low = np.zeros(len(corners), np.intp)
        ray, box = _pairs(start, stop, low, low + 1, 1)
        if self.single_rad is None:
            return ray, box
        elevation = self.single_rad.take(ray)
        seen = (elevation >= view.bottom.take(box)) & (elevation <= view.top.take(box))
        kept = np.flatnonzero(seen)
        return ray[kept], box[kept]

    def _view(self, corners: Array) -> "_View":
        """Where the boxes stand as the fan sees them."""
        own = (corners - self.world_from_fan[:3, 3]) @ self.world_from_fan[:3, :3]
        middle = own.mean(axis=1)
        bearing = np.arctan2(middle[:, 1], middle[:, 0])
        cos, sin = np.cos(bearing)[:, None], np.sin(bearing)[:, None]
        ahead = own[..., 0] * cos + own[..., 1] * sin
        aside = np.arctan2(own[..., 1] * cos - own[..., 0] * sin, ahead)
        nearest = ahead.min(axis=1)
        beside = nearest > self.reach_m
        room = self.spread_rad + np.arcsin(self.reach_m / np.where(beside, nearest, np.inf))
        right, left = aside.min(axis=1) - room, aside.max(axis=1) + room
        near = np.where(beside, nearest - self.reach_m, 1e-9)
        far = np.hypot(own[..., 0], own[..., 1]).max(axis=1) + self.reach_m
        low, high = own[..., 2].min(axis=1) - self.reach_m, own[..., 2].max(axis=1) + self.reach_m
        bottom = np.arctan2(low, np.where(low < 0.0, near, far)) - self.spread_rad
        top = np.arctan2(high, np.where(high > 0.0, near, far)) + self.spread_rad
        return _View(
            first=np.where(beside, np.mod(bearing + right, _TURN_RAD), 0.0),
            span=np.where(beside, np.minimum(left - right, _TURN_RAD), _TURN_RAD),
            bottom=np.where(beside, bottom, -np.pi).astype(np.float32),
            top=np.where(beside, top, np.pi).astype(np.float32),
        )


@dataclass(frozen=True, eq=False)
class _View:
    """Where k boxes stand: from which bearing on, over what angle, between which elevations."""

    first: Array
    span: Array
    bottom: Floats
    top: Floats


def _pairs(start: Rows, stop: Rows, low: Rows, high: Rows, width: int) -> tuple[Rows, Rows]:
    """Rays of columns `start` to `stop`, two runs (2k,) a box, at places `low` to `high` (k,)."""
    across = np.repeat(np.maximum(high - low, 0), 2)
    count = np.maximum(stop - start, 0) * across
    run = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(run)) - (np.cumsum(count) - count).take(run)
    column = step // across.take(run)
    first = start * width + np.repeat(low, 2)
    return first.take(run) + column * (width - across).take(run) + step, run // 2
