"""What cameras and LiDARs saw, read back from the files of a dataset."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from advercity_dsl import Agent, Spec
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.dataset import pcd
from advercity.dataset.carla_frame import mirror
from advercity.dataset.opv2v import PROTOCOL, folder_name, frame_name
from advercity.dataset.reading import Picture
from advercity.errors import InputError
from advercity.poses import Matrix
from advercity.semantics import PALETTE
from advercity.sensors.lidar import PointCloud

_TAG_OF_COLOUR = {tuple(colour): tag for tag, colour in enumerate(PALETTE.tolist())}


def stored_spec(scenario: Path) -> Spec:
    """The spec that a scenario's folder was made from; InputError if there is none."""
    path = scenario / PROTOCOL
    try:
        return Spec.model_validate(yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader))
    except (OSError, yaml.YAMLError, ValidationError) as error:
        raise InputError(f"{path}: no scenario of advercity: {error}") from error


def stored_frames(scenario: Path, spec: Spec) -> list[int]:
    """Indices of the frames that are there."""
    first = int(frame_name(spec, 0))
    agent = folder_name(spec.agents[0])
    return sorted(int(path.stem) - first for path in (scenario / agent).glob("*.pcd"))


class Stored:
    """The files of one viewpoint in one frame."""

    def __init__(self, scenario: Path, spec: Spec, agent: Agent, index: int) -> None:
        self._stem = scenario / folder_name(agent) / frame_name(spec, index)

    def pictures(self, poses: list[Matrix]) -> tuple[Picture, ...]:
        """Images and semantic tags of its cameras, which stood at `poses`."""
        return tuple(
            Picture(
                pose,
                self._image(f"_camera{index}.png"),
                _tags(self._image(f"_semantic{index}.png")),
            )
            for index, pose in enumerate(poses)
        )

    def cloud(self) -> PointCloud:
        """Its point cloud, in the LiDAR's right-handed frame."""
        table = pcd.read(self._path(".pcd"))
        points = mirror(np.column_stack([table["x"], table["y"], table["z"]]))
        return PointCloud(
            points=points.astype(np.float32),
            intensity=table["intensity"],
            ring=table["ring"],
            range_m=np.linalg.norm(points, axis=1).astype(np.float32),
            semantic=table["tag"],
            instance=table["object_id"],
        )

    def visible(self) -> dict[int, int]:
        """Rays of the noise-free LiDAR that met each actor that is annotated."""
        path = self._path(".yaml")
        try:
            said: Any = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
            objects = said["vehicles"] | said["walkers"]
            return {int(key): int(item["lidar_hits"]) for key, item in objects.items()}
        except (OSError, yaml.YAMLError, LookupError, TypeError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {error}") from error

    def _image(self, suffix: str) -> NDArray[np.uint8]:
        path = self._path(suffix)
        image: Any = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise InputError(f"{path}: is missing or no picture")
        return np.ascontiguousarray(image[..., ::-1])

    def _path(self, suffix: str) -> Path:
        return self._stem.with_name(self._stem.name + suffix)


def _tags(painted: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tags (h, w) of a picture (h, w, 3) in CARLA's colours."""
    tags = np.zeros(painted.shape[:2], np.uint8)
    for colour, tag in _TAG_OF_COLOUR.items():
        tags[(painted == colour).all(axis=-1)] = tag
    return tags
