"""Videos and overview images of a small dataset."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from advercity.dataset import overview_images
from advercity.dataset.overview_images import write_videos
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from tests.builders import TWO_ROADS_FRAMES


def test_videos_have_an_image_per_frame(two_roads: Path, tmp_path: Path) -> None:
    import av

    written = write_videos(two_roads / "ui_clear_night_dense", tmp_path)
    assert len(written) == 8
    for path in written:
        with av.open(str(path)) as container:
            frames = list(container.decode(video=0))
            assert len(frames) == TWO_ROADS_FRAMES
            assert container.streams.video[0].average_rate == 10
            assert np.std(frames[0].to_ndarray(format="rgb24")) > 5
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in written}


def test_an_unknown_video_is_refused(two_roads: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such video; front, mosaic, semantic, lidar"):
        write_videos(two_roads, tmp_path, ["drone"])


def test_boxes_are_drawn_around_their_objects(two_roads: Path) -> None:
    """What is drawn lies on or around the pixels of actors, where all of them are ahead."""
    view = open_dataset(two_roads)[0]["cav1"]
    drawn = (overview_images.draw_camera_boxes(view, 0) != view.image(0)).any(axis=-1)
    is_actor = np.isin(view.semantic(0), (4, 10))
    around = cv2.dilate(is_actor.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert np.count_nonzero(drawn) > 20
    assert np.count_nonzero(drawn & around) / np.count_nonzero(drawn) > 0.9


def test_the_top_view_is_centred_on_the_first_agent(two_roads: Path) -> None:
    image = overview_images.draw_top_view(open_dataset(two_roads)[0], 200)
    assert tuple(image[100, 100]) == overview_images.AGENT_VIEW_COLOURS[0]
