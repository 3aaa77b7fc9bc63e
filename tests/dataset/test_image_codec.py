import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.dataset.image_codec import encode_label_png, encode_photo_png
from advercity.randomness import create_generator

Image = NDArray[np.uint8]


def decoded(content: bytes) -> Image:
    """By another program; RGB."""
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image if image.ndim == 2 else image[..., ::-1], np.uint8)


def noise(*shape: int) -> Image:
    return create_generator("png", *shape).integers(0, 256, shape, np.uint8)


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 7, 3), (270, 480, 3)])
def test_photographs_are_encoded_without_loss(shape: tuple[int, ...]) -> None:
    np.testing.assert_array_equal(decoded(encode_photo_png(noise(*shape))), noise(*shape))


@pytest.mark.parametrize("shape", [(1, 1), (5, 3), (1, 1, 3), (64, 48), (64, 48, 3)])
def test_labels_are_encoded_without_loss(shape: tuple[int, ...]) -> None:
    areas = noise(*shape) // 64
    np.testing.assert_array_equal(decoded(encode_label_png(areas)), areas)


def test_a_strided_array_is_encoded_as_its_values() -> None:
    every = noise(16, 16, 3)
    np.testing.assert_array_equal(decoded(encode_photo_png(every[::2, ::2])), every[::2, ::2])


def test_areas_of_one_value_take_almost_no_bytes() -> None:
    assert len(encode_label_png(np.full((256, 256, 3), 7, np.uint8))) < 256 * 256 * 3 / 100


def test_smooth_images_take_fewer_bytes_than_their_pixels() -> None:
    slope = np.add.outer(np.arange(100), np.arange(200))[..., None] + np.zeros(3)
    assert len(encode_photo_png(slope.astype(np.uint8))) < 100 * 200 * 3 / 3
