"""Bodies that move on the world, from one frame to the next, and rays aimed at them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.traffic.trace import Frame

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

SKIN_M = 0.01
"""Room around a box for what single precision leaves uncertain."""
_STEEPEST = np.float32(1e-9)
_CORNERS = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0]), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Aim:
    """p rays in the frames of the bodies that they are aimed at.

    Attributes:
        pair: (p,) rows of the pairs that may meet.
        origins: (p, 3) float32 where each ray enters its body's box.
        directions: (p, 3) float32.
        start_m: (p,) float32 how far along the ray that is.
        length_m: (p,) float32 from there until it leaves the box or ends.
    """

    pair: Rows
    origins: Floats
    directions: Floats
    start_m: Floats
    length_m: Floats


@dataclass(frozen=True, eq=False)
class Movers:
    """k bodies and where they go within a frame.

    Attributes:
        id: (k,) int32 of the actors.
        paint: (k,) int16 material of what is painted.
        scene: (k,) number of the `Shapes` that each is one of.
        body: (k,) its row there.
        before: (k, 4, 4) world from mesh at the frame before.
        now: (k, 4, 4) at the frame.
        low: (k, 3) float64 lower corner of each mesh's box in its frame, metres.
        high: (k, 3) upper corner.
        corners: (k, 8 or 16, 3) of the world whose hull holds the body all the while.
    """

    id: NDArray[np.int32]
    paint: NDArray[np.int16]
    scene: Rows
    body: Rows
    before: Matrix
    now: Matrix
    low: Array
    high: Array
    corners: Array

    @staticmethod
    def of(
        frame: Frame,
        before: Frame | None,
        *,
        paint: Sequence[int],
        shape: Sequence[tuple[int, int]],
        body_from_mesh: Sequence[Matrix],
        low: Array,
        high: Array,
    ) -> "Movers":
        """The actors of a frame; one that was not there before stays where it is.

        Args:
            frame: Now.
            before: One tick earlier; None if all rays are cast now.
            paint: Material of each actor.
            shape: Scene and row of each actor's shape.
            body_from_mesh: (4, 4) of each actor.
            low: (k, 3) lower corners of the shapes.
            high: (k, 3) upper corners.
        """
        states = frame.states
        mesh = np.array(body_from_mesh).reshape(-1, 4, 4)
        now = np.array([state.world_from_body for state in states]).reshape(-1, 4, 4) @ mesh
        earlier = {} if before is None else {state.actor.id: state for state in before.states}
        then = [earlier.get(state.actor.id, state).world_from_body for state in states]
        scene, row = np.array(shape, np.intp).reshape(-1, 2).T
        movers = Movers(
            id=np.array([state.actor.id for state in states], np.int32),
            paint=np.array(paint, np.int16),
            scene=scene,
            body=row,
            before=now if before is None else np.array(then).reshape(-1, 4, 4) @ mesh,
            now=now,
            low=low - SKIN_M,
            high=high + SKIN_M,
            corners=np.empty((len(states), 8, 3)),
        )
        return replace(movers, corners=movers._hulls())

    def __len__(self) -> int:
        return len(self.id)

    def without(self, hidden: frozenset[int]) -> "Movers":
        """All but those actors."""
        if not hidden:
            return self
        seen = np.flatnonzero(~np.isin(self.id, list(hidden)))
        return Movers(
            id=self.id[seen],
            paint=self.paint[seen],
            scene=self.scene[seen],
            body=self.body[seen],
            before=self.before[seen],
            now=self.now[seen],
            low=self.low[seen],
            high=self.high[seen],
            corners=self.corners[seen],
        )

    def poses_at(self, share: Floats | None, mover: Rows) -> tuple[Floats, Floats]:
        """Turns (3, 3, p) and places (3, p) of movers (p,), in runs, at shares (p,) of the tick."""
        if share is None:
            turns = np.ascontiguousarray(self.now[:, :3, :3].transpose(1, 2, 0), np.float32)
            places = np.ascontiguousarray(self.now[:, :3, 3].T, np.float32)
            return turns.take(mover, axis=2), places.take(mover, axis=1)
        turns = np.empty((3, 3, len(mover)), np.float32)
        places = np.empty((3, len(mover)), np.float32)
        bounds = np.flatnonzero(np.diff(mover, prepend=-1, append=-1))
        for first, last in pairwise(bounds.tolist()):
            which = mover[first]
            moved = poses.between(self.before[which], self.now[which], share[first:last])
            turns[:, :, first:last] = moved[:, :3, :3].transpose(1, 2, 0)
            places[:, first:last] = moved[:, :3, 3].T
        return turns, places

    def aim(
        self, origins: Floats, directions: Floats, share: Floats | None, mover: Rows, limits: Floats
    ) -> Aim:
        """Pairs of a ray and the box of a mover that it meets before it ends.

        Args:
            origins: (n, 3) float32 of the world.
            directions: (n, 3) float32, unit vectors.
            share: (n,) of the time since the frame before; None for this frame.
            mover: (n,) that each ray is aimed at, in runs.
            limits: (n,) float32 where each ray ends, metres.
        """
        turns, places = self.poses_at(share, mover)
        x, y, z = origins.T - places
        own = _turned_back(turns, x, y, z)
        along = _turned_back(turns, *directions.T)
        slope = 1.0 / np.where(np.abs(along) < _STEEPEST, _STEEPEST, along)
        low = np.ascontiguousarray(self.low.T, np.float32).take(mover, axis=1)
        high = np.ascontiguousarray(self.high.T, np.float32).take(mover, axis=1)
        one, other = (low - own) * slope, (high - own) * slope
        enter = np.minimum(one, other).max(axis=0).clip(0.0)
        leave = np.minimum(np.maximum(one, other).min(axis=0), limits)
        pair = np.flatnonzero(leave > enter)
        start_m = enter[pair]
        ahead = along.take(pair, axis=1)
        return Aim(
            pair=pair,
            origins=np.ascontiguousarray((own.take(pair, axis=1) + start_m * ahead).T),
            directions=np.ascontiguousarray(ahead.T),
            start_m=start_m,
            length_m=leave[pair] - start_m,
        )

    def _hulls(self) -> Array:
        """Corners (k, 8 or 16, 3) of where each box is at the beginning and at the end.

        Between them a corner goes along an arc; boxes are made larger by how far it bulges.
        """
        if self.before is self.now:
            return _moved(self.now, self._box_corners(np.zeros(len(self))))
        turns = np.einsum("kji,kjl->kil", self.before[:, :3, :3], self.now[:, :3, :3])
        cosine = np.clip((np.trace(turns, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)
        farthest = np.linalg.norm(np.maximum(np.abs(self.low), np.abs(self.high)), axis=1)
        bulge = farthest * (1.0 - np.cos(np.arccos(cosine) / 2.0))
        corners = self._box_corners(bulge)
        return np.concatenate([_moved(self.before, corners), _moved(self.now, corners)], axis=1)

    def _box_corners(self, larger_m: Array) -> Array:
        low, high = self.low - larger_m[:, None], self.high + larger_m[:, None]
        return low[:, None] + _CORNERS * (high - low)[:, None]


def _moved(world_from_body: Matrix, points: Array) -> Array:
    """Points (k, c, 3) of bodies in the world."""
    turned = points @ world_from_body[:, :3, :3].swapaxes(1, 2)
    return turned + world_from_body[:, None, :3, 3]


def _turned_back(turns: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Vectors (3, p) of the world in the frames that turns (3, 3, p) lead from."""
    return np.stack([turns[0, i] * x + turns[1, i] * y + turns[2, i] * z for i in range(3)])
