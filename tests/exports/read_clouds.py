"""Reads a point cloud with Open3D or pypcd4, and prints its points and other values."""

import json
import sys

import numpy as np

reader, path, *fields = sys.argv[1:]
if reader == "open3d":
    import open3d  # pyright: ignore[reportMissingImports]

    cloud = open3d.io.read_point_cloud(path)
    found = {"points": np.asarray(cloud.points), "red": np.asarray(cloud.colors)[:, 0]}
else:
    import pypcd4  # pyright: ignore[reportMissingImports]

    table = pypcd4.PointCloud.from_path(path)
    found = {name: table.numpy((name,))[:, 0] for name in fields}
    found["points"] = table.numpy(("x", "y", "z"))
print(json.dumps({name: values.tolist() for name, values in found.items()}))
