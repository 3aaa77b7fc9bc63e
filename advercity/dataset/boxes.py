"""Annotated objects as arrays, in the right-handed frames of the rest of advercity."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.carla_frame import matrix_from_pose

M_S_PER_KM_H = 1 / 3.6


@dataclass(frozen=True, eq=False)
class Boxes:
    """Annotated objects of one viewpoint, n of them.

    Attributes:
        ids: (n,) int64, the same for the same object in all frames and viewpoints of a scenario.
        classes: (n,) text: car, van, truck, bicycle, motorcycle or pedestrian.
        world_from_box: (n, 4, 4); origin in the middle of the box, x forward, y left, z up.
        sizes: (n, 3) full length, width and height in metres.
        speeds_m_s: (n,).
        distances_m: (n,) from the viewpoint.
        bearings_rad: (n,) where the viewpoint sees it; 0 ahead, positive to the left.
        lidar_hits: (n,) rays of the noise-free LiDAR that met it.
    """

    ids: NDArray[np.int64]
    classes: NDArray[np.str_]
    world_from_box: NDArray[np.float64]
    sizes: NDArray[np.float64]
    speeds_m_s: NDArray[np.float64]
    distances_m: NDArray[np.float64]
    bearings_rad: NDArray[np.float64]
    lidar_hits: NDArray[np.int64]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.ids)


def boxes_of(objects: dict[Any, dict[str, Any]]) -> Boxes:
    """Of objects as they stand in a frame's YAML, by id; left-handed, degrees, km/h."""
    items = list(objects.values())
    centres = [np.add(item["location"], item["center"]) for item in items]
    box_poses = [
        matrix_from_pose([*centre, *item["angle"]])
        for centre, item in zip(centres, items, strict=True)
    ]
    return Boxes(
        ids=np.array(list(objects), dtype=np.int64),
        classes=np.array([_class_of(item) for item in items], dtype=np.str_),
        world_from_box=np.reshape(box_poses, (-1, 4, 4)).astype(np.float64),
        sizes=np.reshape([item["extent"] for item in items], (-1, 3)) * 2.0,
        speeds_m_s=_column(items, "speed") * M_S_PER_KM_H,
        distances_m=_column(items, "dist"),
        bearings_rad=-np.deg2rad(_column(items, "bearing")),
        lidar_hits=_column(items, "lidar_hits").astype(np.int64),
    )


def _class_of(item: dict[str, Any]) -> str:
    return "pedestrian" if item["class"] == "walker" else item["class"]


def _column(items: list[dict[str, Any]], key: str) -> NDArray[np.float64]:
    return np.array([item[key] for item in items], dtype=np.float64)
