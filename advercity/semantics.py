"""Semantic tags and colours of CARLA 0.9.12, and colours of actors' boxes."""

from enum import IntEnum

import numpy as np


class Semantic(IntEnum):
    """Semantic tag of a surface; the value is its id in CARLA 0.9.12."""

    UNLABELED = 0
    BUILDING = 1
    FENCE = 2
    OTHER = 3
    PEDESTRIAN = 4
    POLE = 5
    ROAD_LINE = 6
    ROAD = 7
    SIDEWALK = 8
    VEGETATION = 9
    VEHICLE = 10
    WALL = 11
    TRAFFIC_SIGN = 12
    SKY = 13
    GROUND = 14
    BRIDGE = 15
    RAIL_TRACK = 16
    GUARD_RAIL = 17
    TRAFFIC_LIGHT = 18
    STATIC = 19
    DYNAMIC = 20
    WATER = 21
    TERRAIN = 22


OPAQUE_TO_RADIO = frozenset(
    {
        Semantic.BUILDING,
        Semantic.WALL,
        Semantic.BRIDGE,
        Semantic.GROUND,
        Semantic.TERRAIN,
        Semantic.ROAD,
        Semantic.SIDEWALK,
    }
)
"""Classes opaque to radio waves; plants, poles and signs are too thin."""


PALETTE = np.array(
    [
        (0, 0, 0),
        (70, 70, 70),
        (100, 40, 40),
        (55, 90, 80),
        (220, 20, 60),
        (153, 153, 153),
        (157, 234, 50),
        (128, 64, 128),
        (244, 35, 232),
        (107, 142, 35),
        (0, 0, 142),
        (102, 102, 156),
        (220, 220, 0),
        (70, 130, 180),
        (81, 0, 81),
        (150, 100, 100),
        (230, 150, 140),
        (180, 165, 180),
        (250, 170, 30),
        (110, 190, 160),
        (170, 120, 50),
        (45, 60, 150),
        (145, 170, 100),
    ],
    dtype=np.uint8,
)
"""RGB of each tag, shape (23, 3)."""

ACTOR_COLOURS = {
    "car": (66, 133, 244),
    "van": (0, 172, 193),
    "truck": (171, 71, 188),
    "bicycle": (124, 179, 66),
    "motorcycle": (255, 179, 0),
    "pedestrian": (229, 57, 53),
}
"""RGB of boxes by class of actor, in videos and in the live view."""
