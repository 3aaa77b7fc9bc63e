"""Videos and overview images of a small dataset."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.dataset import overview_images
from advercity.dataset.overview_images import write_contact_sheet, write_videos
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from tests.builders import TWO_ROADS_FRAMES, frame_of, sensor_frame_of, write_scenario


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


def test_a_cloud_is_drawn_from_above_with_its_front_up_and_its_left_left() -> None:
    """Pixels of a metre: 60 m to every side; brightness by the root of the intensity."""
    fields = [("x", "f4"), ("y", "f4"), ("intensity", "f4"), ("object_id", "i4")]
    rows = [(19.5, 9.5, 1.0, 0), (-30.5, -40.5, 0.25, 0), (0.5, 5.5, 0.0, 7), (61, 0, 1, 0)]
    drawn = overview_images.draw_lidar_top_view(np.array(rows, fields), 120)
    expected = np.zeros((120, 120, 3), np.uint8)
    expected[60 - 20, 60 - 10] = 255
    expected[60 + 30, 60 + 40] = 70 + 185 // 2
    expected[60 - 1, 60 - 6] = (255, 200, 60)
    np.testing.assert_array_equal(drawn, expected)


def write_rigs(spec: Spec, root: Path, *yaws_deg: tuple[float, ...]) -> Path:
    """A frame of a scenario whose agents have cameras to these directions, of different sizes."""
    data = spec.model_dump(mode="json")
    data["agents"] = data["agents"][: len(yaws_deg)]
    for index, (agent, yaws) in enumerate(zip(data["agents"], yaws_deg, strict=True)):
        mounts = [{"x_m": 1.2, "z_m": 1.5, "yaw_deg": yaw} for yaw in yaws]
        size = {"width_px": 1600 - 400 * index, "height_px": 800 + 100 * index}
        agent["sensors"]["camera"] |= {"mounts": mounts, **size}
    rigged = Spec.model_validate(data)

    def sense(index: int):
        frame = frame_of(rigged, index)
        return tuple(sensor_frame_of(agent, frame) for agent in rigged.agents)

    return write_scenario(root, rigged, sense)


@pytest.mark.parametrize(
    "yaws_deg",
    [
        [(0,)],
        [(0, 120, -120), (30,)],
        [(55, 0, -55, 110, 180, -110), (0, 90), (180, 5, -5)],
    ],
)
def test_a_sheet_and_videos_show_every_camera_of_any_rig(
    yaws_deg: list[tuple[float, ...]], spec: Spec, tmp_path: Path
) -> None:
    scenario = write_rigs(spec, tmp_path / "dataset", *yaws_deg)
    write_contact_sheet(scenario, tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet is not None
    heights = [384 * (800 + 100 * index) / (1600 - 400 * index) for index in range(len(yaws_deg))]
    assert sheet.shape[0] == sum(20 + round(height) for height in heights)
    assert sheet.shape[1] == max(
        384 * (len(yaws) + 1) + round(height)
        for yaws, height in zip(yaws_deg, heights, strict=True)
    )
    assert len(write_videos(scenario, tmp_path / "videos")) == len(yaws_deg) + 3


def test_a_row_of_a_sheet_goes_from_left_over_front_to_rear(spec: Spec, tmp_path: Path) -> None:
    view = open_dataset(write_rigs(spec, tmp_path, (180, -90, 0, 90)))[0]["cav1"]
    sheet = tmp_path / "sheet.png"
    write_contact_sheet(tmp_path / spec.id, sheet)
    drawn = cv2.imread(str(sheet), cv2.IMREAD_COLOR_RGB)
    assert drawn is not None
    for cell, camera in enumerate((3, 2, 1, 0)):
        wanted = cv2.resize(view.image(camera), (384, 192), interpolation=cv2.INTER_AREA)
        np.testing.assert_array_equal(drawn[20:212, 384 * cell : 384 * (cell + 1)], wanted)


def test_a_sheet_shows_the_frame_and_agents_that_are_asked_for(
    two_roads: Path, tmp_path: Path
) -> None:
    scenario = two_roads / "ui_clear_night_dense"
    frames = open_dataset(scenario)
    agents = list(frames[0].views)
    last_name = frames[len(frames) - 1].name

    write_contact_sheet(scenario, tmp_path / "middle.png")
    write_contact_sheet(scenario, tmp_path / "last.png", frame=last_name)
    write_contact_sheet(scenario, tmp_path / "one.png", agents=agents[-1:])

    whole, last, one = (cv2.imread(str(tmp_path / f"{it}.png")) for it in ("middle", "last", "one"))
    assert whole is not None and last is not None and one is not None
    assert whole.shape == last.shape and (whole != last).any()
    np.testing.assert_array_equal(one, whole[-one.shape[0] :, : one.shape[1]])

    known = f"its frames are {frames[0].name} to {last_name}"
    with pytest.raises(InputError, match=f"has no frame '7'; {known}"):
        write_contact_sheet(scenario, tmp_path / "no.png", frame="7")
    with pytest.raises(InputError, match=f"has no agent 'cav9'; .*{agents[0]}"):
        write_contact_sheet(scenario, tmp_path / "no.png", agents=["cav9"])


def test_a_video_of_the_front_shows_the_camera_that_looks_ahead(spec: Spec, tmp_path: Path) -> None:
    view = open_dataset(write_rigs(spec, tmp_path, (180, 90, 20)))[0]["cav1"]
    assert overview_images.find_front_camera(view) == 2


def test_a_camera_that_the_rig_lacks_is_not_called_damaged(spec: Spec, tmp_path: Path) -> None:
    view = open_dataset(write_rigs(spec, tmp_path, (0, 90, 180)))[0]["cav1"]
    for read in (view.image, view.semantic, view.depth):
        with pytest.raises(InputError, match=r"^cav1 has cameras 0 to 2; there is no camera 3$"):
            read(3)
