"""Reads the radars of an export with nuscenes-devkit."""

import json
import sys

from nuscenes import NuScenes  # pyright: ignore[reportMissingImports]
from nuscenes.utils.data_classes import RadarPointCloud  # pyright: ignore[reportMissingImports]

nusc = NuScenes(version="v1.0-trainval", dataroot=sys.argv[1], verbose=False)
found = []
for sample in nusc.sample:
    for channel, token in sample["data"].items():
        if channel.startswith("RADAR"):
            path = nusc.get_sample_data_path(token)
            points = RadarPointCloud.from_file(path).points
            counts = {}
            for annotation in (nusc.get("sample_annotation", one) for one in sample["anns"]):
                instance = nusc.get("instance", annotation["instance_token"])
                if annotation["num_radar_pts"]:
                    counts[instance["object_id"]] = [annotation["num_radar_pts"]]
            found.append({"channel": channel, "points": points.T.tolist(), "counts": counts})
print(json.dumps(found))
