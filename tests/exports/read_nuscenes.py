"""Reads an export with nuscenes-devkit, renders a sample, and evaluates the truth as a detector's.

python read_nuscenes.py EXPORT SCRATCH
"""

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from nuscenes import NuScenes  # pyright: ignore[reportMissingImports]
from nuscenes.eval.common.config import (  # pyright: ignore[reportMissingImports]
    config_factory,
)
from nuscenes.eval.detection.evaluate import (  # pyright: ignore[reportMissingImports]
    DetectionEval,
)
from nuscenes.eval.detection.utils import (  # pyright: ignore[reportMissingImports]
    category_to_detection_name,
)
from nuscenes.utils.data_classes import (  # pyright: ignore[reportMissingImports]
    LidarPointCloud,
)
from nuscenes.utils.geometry_utils import (  # pyright: ignore[reportMissingImports]
    points_in_box,
)

root, scratch = sys.argv[1], Path(sys.argv[2])
nusc = NuScenes(version="v1.0-trainval", dataroot=root, verbose=False)
nusc.list_scenes()


def count_samples_before(sample: Any) -> int:
    """Number of a sample in its scene."""
    return count_samples_before(nusc.get("sample", sample["prev"])) + 1 if sample["prev"] else 0


def read_sample(sample: Any) -> dict[str, Any]:
    """Boxes and points of a sample, and where the devkit projects them."""
    lidar = sample["data"]["LIDAR_TOP"]
    path, boxes, _ = nusc.get_sample_data(lidar)
    points = LidarPointCloud.from_file(path).points[:3]
    ego = nusc.get("ego_pose", nusc.get("sample_data", lidar)["ego_pose_token"])
    scene = nusc.get("scene", sample["scene_token"])
    log = nusc.get("log", scene["log_token"])
    mask = nusc.get("map", log["map_token"])["mask"]
    pixels = {}
    for channel, token in sample["data"].items():
        if channel.startswith("CAM"):
            found, _, _ = nusc.explorer.map_pointcloud_to_image(lidar, token)
            pixels[channel] = found[:2].T.tolist()
    return {
        "scene": scene["name"],
        "frame": count_samples_before(sample),
        "ego": ego["translation"],
        "on_mask": bool(mask.is_on_mask(*ego["translation"][:2])),
        "pixels": pixels,
        "boxes": [
            {
                "object": nusc.get("instance", annotation["instance_token"])["object_id"],
                "name": box.name,
                "global": annotation["translation"],
                "rotation": annotation["rotation"],
                "size": annotation["size"],
                "points": int(points_in_box(box, points, wlh_factor=1.0001).sum()),
                "velocity": nusc.box_velocity(box.token).tolist(),
                "written_velocity": annotation["velocity"],
                "attribute": nusc.get("attribute", annotation["attribute_tokens"][0])["name"],
                "visibility": annotation["visibility_token"],
            }
            for box, annotation in (
                (box, nusc.get("sample_annotation", box.token)) for box in boxes
            )
        ],
    }


def evaluate() -> dict[str, Any]:
    """Hand in every annotation as a detection, and return the devkit's figures."""
    results: dict[str, list[Any]] = {}
    for sample in nusc.sample:
        rows = results[sample["token"]] = []
        for token in sample["anns"]:
            annotation = nusc.get("sample_annotation", token)
            if not annotation["num_lidar_pts"] + annotation["num_radar_pts"]:
                continue  # the evaluation takes these from the truth, and not from detections
            velocity = nusc.box_velocity(token)[:2]
            rows.append(
                {
                    "sample_token": sample["token"],
                    "translation": annotation["translation"],
                    "size": annotation["size"],
                    "rotation": annotation["rotation"],
                    "velocity": np.nan_to_num(velocity).tolist(),
                    "detection_name": category_to_detection_name(annotation["category_name"]),
                    "detection_score": 1.0,
                    "attribute_name": nusc.get("attribute", annotation["attribute_tokens"][0])[
                        "name"
                    ],
                }
            )
    path = scratch / "results.json"
    meta = dict.fromkeys(("use_camera", "use_lidar", "use_radar", "use_map", "use_external"), False)
    path.write_text(json.dumps({"meta": meta, "results": results}))
    config = config_factory("detection_cvpr_2019")
    run = DetectionEval(nusc, config, str(path), "all", str(scratch), verbose=False)
    metrics, _ = run.evaluate()
    truth: dict[str, int] = {}
    for box in run.gt_boxes.all:
        truth[box.detection_name] = truth.get(box.detection_name, 0) + 1
    summary = metrics.serialize()
    return {
        "truth": truth,
        "ap": summary["mean_dist_aps"],
        "errors": summary["label_tp_errors"],
        "nds": summary["nd_score"],
        "map": summary["mean_ap"],
    }


picture = scratch / "sample.png"
nusc.render_sample(nusc.sample[0]["token"], out_path=str(picture), verbose=False)
samples = [read_sample(sample) for sample in nusc.sample]
print(
    json.dumps(
        {
            "samples": samples,
            "evaluation": evaluate(),
            "picture_bytes": picture.stat().st_size,
            "sweeps": sum(not one["is_key_frame"] for one in nusc.sample_data),
            "readings": len(nusc.sample_data),
            "chains": [len(nusc.sample_data), len(nusc.instance), len(nusc.sample_annotation)],
        }
    )
)
