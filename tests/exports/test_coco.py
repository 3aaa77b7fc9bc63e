"""COCO's annotations, as pycocotools reads and evaluates them."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_exports.coco import FIRST_RIDER_SEGMENT
from numpy.testing import assert_array_equal

from advercity.dataset.agent_view import AgentView
from advercity.dataset.image_codec import from_instance_colours
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.semantics import Semantic
from tests.requirements import require

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
"""Of pycocotools with NumPy 2, where it decodes masks."""
FAR_TRUCK = 204


@pytest.fixture(scope="module")
def exported(masked_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_dataset("coco", masked_dataset, tmp_path_factory.mktemp("coco") / "out").output


def load(exported: Path) -> Any:
    api = require("pycocotools.coco")
    with contextlib.redirect_stdout(io.StringIO()):
        return api.COCO(str(exported / "annotations/instances.json"))


def find_view(dataset: Path, image: dict[str, Any]) -> AgentView:
    scenario = open_dataset(dataset).scenarios[0]
    assert scenario.path.name == image["scenario"]
    return scenario.frame(image["frame"])[image["agent"]]


def test_masks_decode_to_the_images_of_ids(exported: Path, masked_dataset: Path) -> None:
    coco = load(exported)
    assert len(coco.imgs) == 2 * 5 * 4
    masks = 0
    for image in coco.imgs.values():
        view = find_view(masked_dataset, image)
        instance = view.instance(image["camera"])
        assert instance.shape == (image["height"], image["width"])
        pixels = (exported / "images" / image["file_name"]).read_bytes()
        assert pixels == view.path(f"_camera{image['camera']}.png").read_bytes()
        painted = np.zeros_like(instance)
        for row in coco.imgToAnns[image["id"]]:
            mask = coco.annToMask(row).astype(bool)
            assert not painted[mask].any()
            painted[mask] = row["object_id"]
            assert row["area"] == mask.sum() > 0
            rows, columns = np.nonzero(mask)
            left, top, width, height = row["bbox"]
            assert (left, top) == (columns.min(), rows.min())
            assert (left + width, top + height) == (columns.max() + 1, rows.max() + 1)
            masks += 1
        assert_array_equal(painted, instance)
    assert masks > 40


def test_boxes_have_the_visible_fractions_of_the_dataset(
    exported: Path, masked_dataset: Path
) -> None:
    coco = load(exported)
    occluded = 0
    for row in coco.anns.values():
        if row["iscrowd"]:
            continue
        image = coco.imgs[row["image_id"]]
        objects = find_view(masked_dataset, image).extras["objects"]
        shown = objects[str(row["object_id"])]["cameras"][f"camera{image['camera']}"]
        assert row["visible_fraction"] == shown["visible_fraction"]
        occluded += shown["occlusion"] > 0.2
    assert occluded > 3
    names = {row["id"]: row["name"] for row in coco.dataset["categories"]}
    assert names == {1: "person", 2: "bicycle", 3: "car", 4: "motorcycle", 8: "truck"}


@pytest.mark.parametrize("kind", ["bbox", "segm"])
def test_truth_as_prediction_has_an_average_precision_of_one(exported: Path, kind: str) -> None:
    coco = load(exported)
    detections = [
        {
            "image_id": row["image_id"],
            "category_id": row["category_id"],
            "score": 1.0,
            **({"bbox": row["bbox"]} if kind == "bbox" else {"segmentation": row["segmentation"]}),
        }
        for row in coco.anns.values()
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        run = require("pycocotools.cocoeval").COCOeval(coco, coco.loadRes(detections), kind)
        run.evaluate()
        run.accumulate()
        run.summarize()
    assert run.stats[0] == pytest.approx(1.0)


def test_segments_are_actors_and_classes(exported: Path, masked_dataset: Path) -> None:
    document = json.loads((exported / "annotations/panoptic.json").read_text())
    categories = {row["id"]: row for row in document["categories"]}
    images = {row["id"]: row for row in document["images"]}
    assert len(document["annotations"]) == 40
    for row in document["annotations"]:
        picture = cv2.imread(str(exported / "panoptic" / row["file_name"]), cv2.IMREAD_COLOR_RGB)
        assert picture is not None
        segments = from_instance_colours(np.asarray(picture, np.uint8))
        image = images[row["image_id"]]
        view = find_view(masked_dataset, image)
        instance, tags = view.instance(image["camera"]), view.semantic(image["camera"])
        assert {one["id"] for one in row["segments_info"]} == {*np.unique(segments).tolist()}
        for one in row["segments_info"]:
            mask = segments == one["id"]
            assert one["area"] == mask.sum()
            category = categories[one["category_id"]]
            if one["id"] >= FIRST_RIDER_SEGMENT:
                rider = (instance == one["id"] - FIRST_RIDER_SEGMENT) & (
                    tags == Semantic.PEDESTRIAN
                )
                assert category["name"] == "person"
                assert_array_equal(mask, rider)
            elif category["isthing"]:
                alone = (tags == Semantic.VEHICLE) | (category["name"] != "bicycle")
                assert_array_equal(mask, (instance == one["id"]) & alone)
            else:
                tag = Semantic[category["name"].upper()]
                assert_array_equal(mask, (tags == tag) & (instance == 0))


def test_riders_are_people_and_the_boxes_of_bicycles_hold_the_machines_alone(
    exported: Path, masked_dataset: Path
) -> None:
    coco = load(exported)
    parts = {
        kind: {row["image_id"]: row for row in coco.anns.values() if row.get("class") == kind}
        for kind in ("bicycle", "rider")
    }
    both = parts["bicycle"].keys() & parts["rider"].keys()
    assert len(both) > 3
    for number in both:
        machine, rider = parts["bicycle"][number], parts["rider"][number]
        assert (machine["category_id"], rider["category_id"]) == (2, 1)
        assert machine["object_id"] == rider["object_id"]
        image = coco.imgs[number]
        objects = find_view(masked_dataset, image).extras["objects"]
        shown = objects[str(rider["object_id"])]["cameras"][f"camera{image['camera']}"]
        assert machine["area"] + rider["area"] == shown["visible_px"]
        assert rider["bbox"][1] + rider["bbox"][3] <= machine["bbox"][1]


def test_actors_that_no_agent_annotates_are_ignored(exported: Path) -> None:
    """A truck is beyond the range of all LiDARs, and still in some images."""
    coco = load(exported)
    crowds = [row for row in coco.anns.values() if row["iscrowd"]]
    assert {(row["object_id"], row["category_id"]) for row in crowds} == {(FAR_TRUCK, 3)}


def test_without_images_of_ids_there_are_boxes_and_a_line_that_says_so(
    two_roads: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = export_dataset("coco", two_roads, tmp_path / "out").output
    assert "40 of 40 cameras have no images of actors' ids" in caplog.text
    assert "`truth: [instance]` in the rig" in caplog.text
    coco = load(folder)
    assert len(coco.imgs) == 2 * 3 * 5 * 4
    assert coco.anns and all(row["segmentation"] == [] for row in coco.anns.values())
    assert not (folder / "panoptic").exists()


def test_an_image_of_ids_that_was_not_asked_for_is_explained(two_roads: Path) -> None:
    view = open_dataset(two_roads)[0]["cav1"]
    with pytest.raises(InputError, match=r"camera0 of cav1 has no images of kind instance; ask"):
        view.instance(0)
