"""Annotated objects of a frame as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.carla_frame import matrix_from_carla_pose, mirror_angle, mirror_points

UNCLASSIFIED = "vehicle"
"""Class of a vehicle of unknown kind in foreign folders."""
_Speed = TypeVar("_Speed", float, NDArray[np.float64])


@dataclass(frozen=True, eq=False)
class Boxes:
    """The n objects annotated by one agent.

    Attributes:
        ids: (n,) int64, the same for the same object in all frames and agents of a scenario.
        classes: (n,) text: car, van, truck, bicycle, motorcycle or pedestrian; others if foreign.
        world_from_box: (n, 4, 4); origin in the middle of the box, x forward, y left, z up.
        locations: (n, 3) points moving with the body: on the ground, of people half-way up.
        sizes: (n, 3) full length, width and height in metres.
        speeds_m_s: (n,).
        distances_m: (n,) from the agent's origin.
        bearings_rad: (n,) direction from the agent; 0 ahead, positive to the left.
        lidar_hits: (n,) beams of the noise-free LiDAR hitting it; -1 if unknown.
        lidar_points: (n,) points returned by it in this weather.
        visible_fraction: (n,) largest fraction of it shown by one of the agent's cameras, 0 to 1.
        is_parked: (n,) whether it is a parked car.
        towed_by: (n,) int64 id of a semi-trailer's tractor unit; 0 for all others.
    """

    ids: NDArray[np.int64]
    classes: NDArray[np.str_]
    world_from_box: NDArray[np.float64]
    locations: NDArray[np.float64]
    sizes: NDArray[np.float64]
    speeds_m_s: NDArray[np.float64]
    distances_m: NDArray[np.float64]
    bearings_rad: NDArray[np.float64]
    lidar_hits: NDArray[np.int64]
    lidar_points: NDArray[np.int64]
    visible_fraction: NDArray[np.float64]
    is_parked: NDArray[np.bool_]
    towed_by: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ids)

    def steady(self, sizes: Mapping[int, Sequence[float]]) -> Boxes:
        """Return the boxes, some of them steady: these hold all poses of a gait.

        Args:
            sizes: Full length, width and height in metres by id.
        """
        rows = np.flatnonzero(np.isin(self.ids, list(sizes)))
        world_from_box, found = self.world_from_box.copy(), self.sizes.copy()
        world_from_box[rows, :3, 3] = self.locations[rows]
        found[rows] = np.reshape([sizes[number] for number in self.ids[rows].tolist()], (-1, 3))
        return replace(self, world_from_box=world_from_box, sizes=found)

    def select(self, where: NDArray[np.bool_]) -> Boxes:
        """Select objects by a mask (n,), as `boxes.lidar_points >= 5`."""
        return Boxes(*(getattr(self, item.name)[where] for item in fields(self)))


def parse_boxes(objects: dict[Any, dict[str, Any]]) -> Boxes:
    """Convert objects of a frame's YAML, by id; there they are left-handed, degrees, km/h."""
    items = list(objects.values())
    centres = [np.add(item["location"], item["center"]) for item in items]
    box_poses = [
        matrix_from_carla_pose([*centre, *item["angle"]])
        for centre, item in zip(centres, items, strict=True)
    ]
    return Boxes(
        ids=np.array(list(objects), dtype=np.int64),
        classes=np.array([_parse_class(item) for item in items], dtype=np.str_),
        world_from_box=np.reshape(box_poses, (-1, 4, 4)).astype(np.float64),
        locations=mirror_points(np.reshape([item["location"] for item in items], (-1, 3))),
        sizes=np.reshape([item["extent"] for item in items], (-1, 3)) * 2.0,
        speeds_m_s=to_m_s(_parse_column(items, "speed")),
        distances_m=_parse_column(items, "dist"),
        bearings_rad=mirror_angle(np.deg2rad(_parse_column(items, "bearing"))),
        lidar_hits=np.array([int(item["lidar_hits"]) for item in items], dtype=np.int64),
        lidar_points=np.array([int(item["lidar_points"]) for item in items], dtype=np.int64),
        visible_fraction=_parse_column(items, "visible_fraction"),
        is_parked=np.array([item.get("parked", False) for item in items], dtype=np.bool_),
        towed_by=np.array([item.get("towed_by", 0) for item in items], dtype=np.int64),
    )


def to_m_s(speed_km_h: _Speed) -> _Speed:
    """Convert speeds of a frame's YAML, km/h."""
    # Imported here: its models take longer to build than opening a dataset.
    from advercity_dsl.units import M_S_PER_KM_H

    return speed_km_h * M_S_PER_KM_H


def _parse_class(item: dict[str, Any]) -> str:
    return "pedestrian" if item["class"] == "walker" else item["class"]


def _parse_column(items: list[dict[str, Any]], key: str) -> NDArray[np.float64]:
    return np.array([item[key] for item in items], dtype=np.float64)
