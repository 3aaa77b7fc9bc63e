import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.dataset.image_codec import (
    encode_deep_png,
    encode_label_png,
    encode_photo_png,
    from_flow_colours,
    to_flow_colours,
)
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


@pytest.mark.parametrize("shape", [(3, 5), (3, 5, 3)])
def test_images_of_16_bits_are_encoded_without_loss(shape: tuple[int, ...]) -> None:
    image = create_generator("deep", *shape).integers(0, 1 << 16, shape, np.uint16)
    found = cv2.imdecode(np.frombuffer(encode_deep_png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None
    np.testing.assert_array_equal(found[..., ::-1] if image.ndim == 3 else found, image)


def test_flow_is_coded_as_in_the_images_of_kitti() -> None:
    # Its development kit: u = (I(u, v, 1) - 2^15) / 64, known where I(u, v, 3) is 1.
    shift = np.array([[(0, 0), (1.5, -2), (-512, 511.98), (600, 0), (np.nan, np.nan)]], np.float32)
    coded = to_flow_colours(shift)
    assert coded.tolist() == [
        [[32768, 32768, 1], [32864, 32640, 1], [0, 65535, 1], [0, 0, 0], [0, 0, 0]]
    ]
    known = [[True, True, True, False, False]]
    found = from_flow_colours(coded)
    np.testing.assert_array_equal(np.isfinite(found).all(axis=2), known)
    np.testing.assert_allclose(found[0, :3], shift[0, :3], atol=1 / 128)


def test_a_strided_array_is_encoded_as_its_values() -> None:
    every = noise(16, 16, 3)
    np.testing.assert_array_equal(decoded(encode_photo_png(every[::2, ::2])), every[::2, ::2])


def test_areas_of_one_value_take_almost_no_bytes() -> None:
    assert len(encode_label_png(np.full((256, 256, 3), 7, np.uint8))) < 256 * 256 * 3 / 100


def test_smooth_images_take_fewer_bytes_than_their_pixels() -> None:
    slope = np.add.outer(np.arange(100), np.arange(200))[..., None] + np.zeros(3)
    assert len(encode_photo_png(slope.astype(np.uint8))) < 100 * 200 * 3 / 3
