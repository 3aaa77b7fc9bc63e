"""Completes descriptions of frames by other programs to advercity's form.

OPV2V and V2XSet say less of an object than advercity does. V2V4Real has poses as right-handed
matrices, and objects in the frame of the agent's LiDAR (its devkit, ucla-mobility/V2V4Real).
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from advercity.dataset.boxes import UNCLASSIFIED
from advercity.dataset.carla_frame import (
    carla_pose_from_matrix,
    matrix_from_carla_pose,
    mirror_angle,
    mirror_points,
    mirror_pose,
)
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.geometry import poses
from advercity.geometry.poses import Matrix

UNKNOWN_COUNT = -1
OBJECT_GROUPS = {"vehicles": UNCLASSIFIED, "walkers": "walker"}
"""Keys of a frame with objects, and the class of objects without one of their own."""
POSES = ("lidar_pose", "true_ego_pos", "predicted_ego_pos")
IDS_OF_AN_AGENT = 100
"""V2V4Real numbers objects seen by one agent only from 100 times the agent's number."""


def has_matrices(description: Mapping[str, Any]) -> bool:
    """Return whether poses of a frame are matrices, and its points right-handed."""
    return np.ndim(description["lidar_pose"]) == 2


def complete_description(found: Mapping[str, Any], *, number: int) -> dict[str, Any]:
    """Complete the description of a frame: left-handed, with every field read by views.

    Unknown numbers become NaN, unknown counts `UNKNOWN_COUNT`.

    Args:
        found: The frame's YAML.
        number: Number of the agent.

    Raises:
        LookupError, TypeError or ValueError: It is no description of a frame.
    """
    groups = {name: found.get(name) or {} for name in OBJECT_GROUPS}
    done = {"ego_speed": math.nan, **found}
    if has_matrices(found):
        world_from_lidar = _parse_matrix(found["lidar_pose"])
        for key in POSES:
            if key in found:
                done[key] = carla_pose_from_matrix(_parse_matrix(found[key])).tolist()
        groups = {
            name: dict(_place_object(*item, world_from_lidar, number) for item in group.items())
            for name, group in groups.items()
        }
    place = done.get("true_ego_pos")
    world_from_agent = None if place is None else matrix_from_carla_pose(place)
    for name, group in groups.items():
        done[name] = {
            key: _complete_object(item, OBJECT_GROUPS[name], world_from_agent)
            for key, item in group.items()
        }
    return done


def count_sensors(description: Mapping[str, Any], kind: str) -> int:
    """Count the sensors of a kind in a frame: cameraN, lidarN_pose, radarN_pose, thermalN."""
    return sum(
        re.fullmatch(rf"{kind}\d*(_pose)?", key) is not None for key in map(str, description)
    )


def audit_description(found: Mapping[str, Any], ledger: Ledger) -> None:
    """Record which keys of a frame, of its cameras and of its objects are not read."""
    standard = load_standard("opv2v")

    def audit(row: str, keys: Iterable[Any]) -> None:
        names = [re.sub(r"\d+", "N", str(key)) for key in keys]
        standard.audit_columns(row, names, ledger, kind=f"{row} key", line=0)

    audit("frame", found)
    for key, item in found.items():
        if re.fullmatch(r"camera\d+", str(key)):
            audit("camera", item)
    for group in OBJECT_GROUPS:
        for item in (found.get(group) or {}).values():
            audit("object", item)


def _parse_matrix(rows: Any) -> Matrix:
    matrix = np.asarray(rows, np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("a pose is no matrix of 4 by 4 numbers")
    return matrix


def _place_object(
    key: int, item: Mapping[str, Any], world_from_lidar: Matrix, number: int
) -> tuple[int, dict[str, Any]]:
    """Place an object of V2V4Real in the world; also returns its id, the same for all agents."""
    centre = np.add(item["location"], item["center"])
    # The devkit uses the formula of CARLA's poses in the right-handed frame.
    lidar_from_box = mirror_pose(matrix_from_carla_pose([*centre, *item["angle"]]))
    pose = carla_pose_from_matrix(world_from_lidar @ lidar_from_box).tolist()
    shared = int(item.get("ass_id", key))
    placed = {
        **item,
        "class": str(item.get("obj_type", UNCLASSIFIED)).lower(),
        "location": pose[:3],
        "center": (0.0, 0.0, 0.0),
        "angle": pose[3:],
    }
    return (int(key) + IDS_OF_AN_AGENT * number if shared < 0 else shared), placed


def _complete_object(
    item: Mapping[str, Any], actor_class: str, world_from_agent: Matrix | None
) -> dict[str, Any]:
    distance_m, bearing_rad = math.nan, math.nan
    if world_from_agent is not None:
        way = mirror_points(item["location"]) - world_from_agent[:3, 3]
        heading = poses.to_yaw_pitch_roll(world_from_agent)[0]
        distance_m = float(np.linalg.norm(way))
        bearing_rad = math.remainder(math.atan2(way[1], way[0]) - heading, math.tau)
    return {
        "class": actor_class,
        "center": (0.0, 0.0, 0.0),
        "speed": math.nan,
        "dist": distance_m,
        "bearing": mirror_angle(math.degrees(bearing_rad)),
        "lidar_hits": UNKNOWN_COUNT,
        "lidar_points": UNKNOWN_COUNT,
        "visible_fraction": math.nan,
        **item,
    }
