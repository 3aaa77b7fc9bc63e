"""Images and videos for people."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from advercity.errors import InputError
from advercity.media import LABEL_HEIGHT_PX, VideoWriter, draw_label_bar, write_image
from tests.requirements import require

IMAGE = np.full((32, 48, 3), 90, np.uint8)


@pytest.mark.parametrize("name", ["a.png", "new/a.jpg"])
def test_an_image_is_written_in_the_format_of_its_name(name: str, tmp_path: Path) -> None:
    write_image(IMAGE, tmp_path / name)
    read = cv2.imread(str(tmp_path / name))
    assert read is not None
    np.testing.assert_allclose(read, IMAGE, atol=2)


@pytest.mark.parametrize("name", ["a.doc", "a"])
def test_a_suffix_of_no_image_format_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end the name in \.png"):
        write_image(IMAGE, tmp_path / name)


def test_an_image_replaces_no_file_of_others(tmp_path: Path) -> None:
    (tmp_path / "image.png").write_text("mine")
    with pytest.raises(InputError, match=r"image\.png: exists, and there is no record"):
        write_image(IMAGE, tmp_path / "image.png")
    assert (tmp_path / "image.png").read_text() == "mine"


def test_a_label_bar_is_as_wide_as_asked_and_has_light_text() -> None:
    bar = draw_label_bar("cav1", 120)
    assert bar.shape == (LABEL_HEIGHT_PX, 120, 3)
    assert bar.max() > 200 and bar.min() < 40


@pytest.mark.parametrize(
    ("size", "even"), [((33, 49), (32, 48)), ((1, 1), (2, 2)), ((1, 90), (2, 90))]
)
def test_a_video_has_every_image_and_even_sizes(
    size: tuple[int, int], even: tuple[int, int], tmp_path: Path
) -> None:
    require("av")
    with VideoWriter(tmp_path / "a.mp4", tick_s=0.1) as video:
        for _ in range(4):
            video.append(np.full((*size, 3), 90, np.uint8))
    capture = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    sizes = []
    while (read := capture.read())[0]:
        sizes.append(read[1].shape)
    assert sizes == [(*even, 3)] * 4


def test_a_video_touches_no_file_of_a_similar_name(tmp_path: Path) -> None:
    require("av")
    (tmp_path / "a.partial.mp4").write_text("mine")
    with VideoWriter(tmp_path / "a.mp4", tick_s=0.1) as video:
        video.append(IMAGE)
    assert (tmp_path / "a.partial.mp4").read_text() == "mine"


def test_a_video_that_fails_leaves_nothing(tmp_path: Path) -> None:
    require("av")
    with pytest.raises(KeyError), VideoWriter(tmp_path / "a.mp4", tick_s=0.1) as video:
        video.append(IMAGE)
        raise KeyError
    assert list(tmp_path.iterdir()) == []
