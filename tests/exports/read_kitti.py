"""Reads an export with the KITTI reader of nuscenes-devkit and with pykitti."""

import functools
import json
import sys

import numpy as np
import nuscenes.utils.kitti  # pyright: ignore[reportMissingImports]
import pykitti.utils  # pyright: ignore[reportMissingImports]
from nuscenes.utils.geometry_utils import points_in_box  # pyright: ignore[reportMissingImports]
from nuscenes.utils.kitti import KittiDB  # pyright: ignore[reportMissingImports]

# It reads rotations in single precision, and takes them for none by the rounding.
nuscenes.utils.kitti.Quaternion = functools.partial(nuscenes.utils.kitti.Quaternion, atol=1e-6)
root = sys.argv[1]
found = []
database = KittiDB(root, splits=("training",))
for token in database.tokens:
    name = token.rpartition("_")[2]
    boxes = database.get_boxes(token)
    cloud = database.get_pointcloud(token, root=root).points
    scan = pykitti.utils.load_velo_scan(f"{root}/training/velodyne/{name}.bin")
    # The reader of nuScenes turns its boxes so that y is ahead.
    turned = np.stack([-cloud[1], cloud[0], cloud[2]])
    ones = np.ones((1, len(scan)))
    calib = pykitti.utils.read_calib_file(f"{root}/training/calib/{name}.txt")
    cam = calib["Tr_velo_to_cam"].reshape(3, 4) @ np.vstack([scan[:, :3].T, ones])
    rect = calib["R0_rect"].reshape(3, 3) @ cam
    pixels = calib["P2"].reshape(3, 4) @ np.vstack([rect, ones])
    (packet,) = pykitti.utils.load_oxts_packets_and_poses([f"{root}/training/oxts/{name}.txt"])
    found.append(
        {
            "boxes": [
                {
                    "name": box.name,
                    "centre": [box.center[1], -box.center[0], box.center[2]],
                    "ahead": [
                        box.rotation_matrix[1, 0],
                        -box.rotation_matrix[0, 0],
                        box.rotation_matrix[2, 0],
                    ],
                    "wlh": list(box.wlh),
                    "points": int(points_in_box(box, turned, wlh_factor=1.0001).sum()),
                }
                for box in boxes
            ],
            "points": len(scan),
            "pixels": np.vstack([pixels[:2] / pixels[2], pixels[2]]).T.tolist(),
            "oxts": [packet.packet.lat, packet.packet.lon, packet.packet.vf, packet.packet.az],
            "rotation": packet.T_w_imu[:3, :3].tolist(),
        }
    )
print(json.dumps(found))
