"""Where tyres have polished a roadway and dripped on it, as a map seen from above."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.world.scene import Lane

TEXEL_M = 0.25
MARGIN_M = 2.0
STEP_M = 0.12
LARGEST = 4096
"""Texels along a side; a larger site gets larger ones."""
TRACK_M, TRACK_SIGMA_M = 0.78, 0.28
"""From a lane's middle to where tyres run, and the spread of it."""
NEUTRAL = 128


@dataclass(frozen=True, eq=False)
class WearMap:
    """How worn the ground is.

    Attributes:
        texels: (h, w) uint8 from south to north: above 128 polished, below stained.
        corner: South-western corner (x, y), metres.
        size: Width and height, metres.
    """

    texels: NDArray[np.uint8]
    corner: tuple[float, float]
    size: tuple[float, float]


def wear_map(lanes: Sequence[Lane]) -> WearMap:
    """Tracks of the tyres in every driving lane; across a lane, they are 0 in the mean."""
    driven = [_samples(lane) for lane in lanes if lane.kind == "driving"]
    if not driven:
        return WearMap(np.full((1, 1), NEUTRAL, dtype=np.uint8), (0.0, 0.0), (1.0, 1.0))
    points, wear = (np.concatenate(column) for column in zip(*driven, strict=True))
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    texel = max(TEXEL_M, float((high - low).max()) / LARGEST)
    width, height = np.ceil((high - low) / texel).astype(int)
    column, row = ((points - low) / texel).astype(int).T
    place = row * width + column
    count = np.bincount(place, minlength=width * height)
    total = np.bincount(place, wear, minlength=width * height)
    mean = total / np.maximum(count, 1)
    texels = np.round(NEUTRAL + 127 * mean.clip(-1, 1)).astype(np.uint8).reshape(height, width)
    return WearMap(
        texels, (float(low[0]), float(low[1])), (float(width * texel), float(height * texel))
    )


def _samples(lane: Lane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, 2) all over a lane, and how worn they are (n,), in [-1, 1]."""
    left, right = lane.left[:, :2], lane.right[:, :2]
    middle = (left + right) / 2
    station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    along = np.arange(0.0, station[-1], STEP_M)
    edges = [
        np.stack([np.interp(along, station, side[:, axis]) for axis in (0, 1)], axis=-1)
        for side in (left, right)
    ]
    width = float(np.linalg.norm(left - right, axis=1).mean())
    share = (np.arange(0.0, width, STEP_M) + STEP_M / 2) / width
    points = edges[0][:, None] * (1 - share[:, None]) + edges[1][:, None] * share[:, None]
    aside = np.abs(share - 0.5) * width
    wear = np.exp(-(((aside - TRACK_M) / TRACK_SIGMA_M) ** 2))
    wear -= 0.6 * np.exp(-((aside / 0.35) ** 2))
    wear = np.broadcast_to(wear - wear.mean(), points.shape[:2])
    return points.reshape(-1, 2), wear.reshape(-1)
