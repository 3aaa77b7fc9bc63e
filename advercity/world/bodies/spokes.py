"""Wheels of bicycles and motorcycles."""

import numpy as np

from advercity.world.shapes import Floats, Surface, hoop, tube, xyz

SPOKES = 10
"""All look alike: a wheel that turns by a tenth looks the same."""


def tyre(hub: Floats, radius_m: float, half_width_m: float) -> Surface:
    """A round tyre that stands on the ground."""
    angle = 2 * np.pi * np.arange(6) / 6
    profile = np.column_stack(
        [radius_m - half_width_m + half_width_m * np.cos(angle), half_width_m * np.sin(angle)]
    )
    return hoop(profile, hub, sides=20)


def spokes(hub: Floats, radius_m: float) -> list[Surface]:
    """Axle and spokes."""
    angle = 2 * np.pi * np.arange(SPOKES // 2) / SPOKES
    along = np.column_stack([np.cos(angle), np.zeros(len(angle)), np.sin(angle)]) * 0.95 * radius_m
    axle = tube([hub - xyz(0, 0.05, 0), hub + xyz(0, 0.05, 0)], 0.03, sides=6)
    return [axle, *(tube([hub - arm, hub + arm], 0.006, sides=3) for arm in along)]
