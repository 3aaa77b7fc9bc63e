"""Scenarios as other programs write them, by hand: no function of advercity takes part."""

from pathlib import Path
from typing import Any

import yaml

PCD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z rgb
SIZE 4 4 4 4
TYPE F F F U
COUNT 1 1 1 1
WIDTH {count}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {count}
DATA ascii
{rows}
"""


def write_frame(
    agent: Path,
    name: str,
    description: dict[str, Any],
    points: tuple[tuple[float, float, float], ...] = ((10.0, 1.0, -1.0),),
) -> None:
    """Write YAML and PCD of a frame; every point has the intensity 0.4, red 102 of 255."""
    agent.mkdir(parents=True, exist_ok=True)
    (agent / f"{name}.yaml").write_text(yaml.dump(description, default_flow_style=False))
    rows = "\n".join(f"{x} {y} {z} {102 << 16}" for x, y, z in points)
    (agent / f"{name}.pcd").write_text(PCD.format(count=len(points), rows=rows))


def describe_opv2v(**changes: Any) -> dict[str, Any]:
    """Describe a frame as OPV2V does.

    The agent stands at (100, 50), seen from above it looks along positive y of the left-handed
    world. Its LiDAR is 1.9 m above, its camera 2.5 m ahead. A car at (110, 70) is turned by 45
    degrees: published functions of OpenCOOD place it 20 m ahead and 10 m to the left.
    """
    return {
        "camera0": {
            "cords": [100.0, 52.5, 1.0, 0.0, 90.0, 0.0],
            "extrinsic": [[1, 0, 0, -2.5], [0, 1, 0, 0], [0, 0, 1, 0.9], [0, 0, 0, 1]],
            "intrinsic": [[335.64, 0.0, 400.0], [0.0, 335.64, 300.0], [0.0, 0.0, 1.0]],
        },
        "ego_speed": 18.0,
        "lidar_pose": [100.0, 50.0, 1.9, 0.0, 90.0, 0.0],
        "plan_trajectory": [[100.0, 51.0, 18.0]],
        "predicted_ego_pos": [100.2, 50.1, 0.0, 0.0, 90.0, 0.0],
        "true_ego_pos": [100.0, 49.5, 0.0, 0.0, 90.0, 0.0],
        "vehicles": {
            7: {
                "angle": [0.0, 45.0, 0.0],
                "center": [0.0, 0.0, 0.75],
                "extent": [2.4, 1.0, 0.75],
                "location": [110.0, 70.0, 0.0],
                "speed": 36.0,
            }
        },
        **changes,
    }


def describe_v2v4real(**changes: Any) -> dict[str, Any]:
    """Describe a frame as V2V4Real does: poses as matrices, objects in the LiDAR's frame.

    The agent stands at (5, 6) of the map and looks along its positive y.
    """
    pose = [[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 6.0], [0.0, 0.0, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0]]
    car = {"center": [0.0, 0.0, 0.0], "extent": [2.25, 0.9, 0.8], "location": [10.0, 3.0, -1.2]}
    return {
        "lidar_pose": pose,
        "true_ego_pos": pose,
        "vehicles": {
            4: {**car, "angle": [0.0, 30.0, 0.0], "obj_type": "Truck", "ass_id": 12},
            9: {**car, "angle": [0.0, 0.0, 0.0], "obj_type": "Car", "ass_id": -1},
        },
        **changes,
    }
