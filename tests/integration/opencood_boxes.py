"""Prints how many points OpenCOOD or HEAL find in each box they read, a JSON list per sample.

    python tests/opencood_boxes.py DATASET

Run by the interpreter that has one of the two installed, which wants an older numpy than ours.
"""

import json
import sys
from pathlib import Path

import numpy as np
import opencood.hypes_yaml  # pyright: ignore[reportMissingImports]
from opencood.data_utils.datasets import build_dataset  # pyright: ignore[reportMissingImports]
from opencood.hypes_yaml.yaml_utils import load_yaml  # pyright: ignore[reportMissingImports]

CONFIGURATIONS = (
    "point_pillar_early_fusion.yaml",
    "point_pillar_intermediate_fusion.yaml",
    "opv2v/LiDAROnly/lidar_disco.yaml",
)
"""Two that OpenCOOD has, one that HEAL has."""
SLACK_M = 0.05


def main() -> None:
    """Read every sample as a test set, with every configuration that there is."""
    folder = Path(opencood.hypes_yaml.__file__).parent
    for name in CONFIGURATIONS:
        if (folder / name).exists():
            settings = load_yaml(str(folder / name))
            settings["root_dir"] = settings["validate_dir"] = settings["test_dir"] = sys.argv[1]
            dataset = build_dataset(settings, visualize=True, train=False)
            for index in range(len(dataset)):
                sample = dataset.collate_batch_test([dataset[index]])
                boxes = dataset.post_processor.generate_gt_bbx(sample).numpy()
                cloud = np.asarray(sample["ego"]["origin_lidar"][0])[:, -4:-1]
                print(json.dumps([_points_in(box, cloud) for box in boxes]))


def _points_in(box: np.ndarray, cloud: np.ndarray) -> int:
    """How many of points (n, 3) lie in a box given by its corners (8, 3)."""
    edges = np.stack([box[0] - box[3], box[1] - box[0], box[4] - box[0]])
    sizes = np.linalg.norm(edges, axis=1)
    from_middle = (cloud - box.mean(axis=0)) @ (edges / sizes[:, None]).T
    return int((np.abs(from_middle) <= sizes / 2 + SLACK_M).all(axis=1).sum())


if __name__ == "__main__":
    main()
