"""Colours of LiDAR points: by intensity, by class, or by kind of return."""

import cv2
import numpy as np
from advercity_dsl.weather_parts import load_weather_parts
from numpy.typing import NDArray

from advercity.run_options import CloudColour
from advercity.semantics import PALETTE
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.sensors.point_kinds import find_point_kind

KIND_COLOURS: dict[int, tuple[int, int, int]] = {
    PointKind.SURFACE: (150, 150, 150),
    PointKind.SPRAY: (90, 230, 210),
    PointKind.GHOST: (255, 80, 200),
    PointKind.NOISE: (110, 110, 70),
    PointKind.STRAY: (255, 140, 60),
    **{
        find_point_kind(name): part.colour
        for name, part in load_weather_parts().found.items()
        if part.colour is not None
    },
}
"""Colours of the points of each kind; parts of the weather have theirs in their records."""
KIND_COLOUR_TABLE = np.zeros((256, 3), np.uint8)
KIND_COLOUR_TABLE[list(KIND_COLOURS)] = list(KIND_COLOURS.values())


def colour_points(cloud: PointCloud, cloud_colour: CloudColour) -> NDArray[np.uint8]:
    """Compute RGB (n, 3) of points; intensity runs from dark blue to red, classes as in CARLA."""
    if cloud_colour == "class":
        return PALETTE[cloud.semantic]
    if cloud_colour == "kind":
        return KIND_COLOUR_TABLE[cloud.kind]
    return colour_intensities(cloud.intensity)


def colour_intensities(intensity: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Compute RGB (n, 3) of intensities (n,) from 0 to 1, from dark blue to red."""
    levels = np.rint(np.clip(intensity, 0, 1) * 255).astype(np.uint8)
    coloured = cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_TURBO)
    return coloured.reshape(-1, 3)[:, ::-1].astype(np.uint8)
