"""Plans of roads."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Road, Spec

from advercity.compiler import load_declaration
from advercity.errors import InputError
from advercity.media import write_image
from advercity.roads.plan_drawing import PlanCanvas, draw_plan, draw_plan_canvas
from advercity.roads.road_network import build_road
from tests.roads.imported_roads import AT_JUNCTION, DATA

ASPHALT = (120, 120, 120)


def test_a_plan_shows_roads_and_agents(specs: dict[str, Spec], tmp_path: Path) -> None:
    road = specs["rcnj_clear_day_sparse"].road
    write_image(draw_plan(build_road(road)), tmp_path / "plan.png")
    image = cv2.imread(str(tmp_path / "plan.png"))
    assert image is not None
    assert max(image.shape) >= 1600
    asphalt = (image == ASPHALT).all(axis=-1).mean()
    assert 0.01 < asphalt < 0.5
    assert (image == (40, 40, 220)).all(axis=-1).sum() > 50, "the ego is red"


def test_a_spec_adds_what_its_cameras_see(specs: dict[str, Spec]) -> None:
    spec = specs["rcnj_clear_day_sparse"]
    assert (draw_plan(build_road(spec.road)) != draw_plan(build_road(spec.road), spec)).any()


def test_crossings_are_drawn_with_bars(specs: dict[str, Spec]) -> None:
    """Across a street of ui, asphalt and paint alternate every 0.5 m."""
    network = build_road(specs["ui_clear_day_sparse"].road)
    canvas = draw_plan_canvas(network)
    lane = next(lane for lane in network.lanes if lane.kind == "crossing")
    start, end = ((lane.left + lane.right) / 2)[[0, -1], :2]
    along = np.linspace(start, end, 2000) - [canvas.low[0], canvas.high[1]]
    column, row = (along * [canvas.px_per_m, -canvas.px_per_m]).astype(int).T
    is_paint = canvas.image[row, column].min(axis=1) > 190
    bars = int(np.linalg.norm(end - start))  # a bar and a gap are 1 m
    drawn = np.count_nonzero(np.diff(is_paint.astype(int)) == 1)
    assert 0.75 * bars < drawn <= bars + 1, "the ego's route covers some"


def test_the_same_road_gives_the_same_plan(specs: dict[str, Spec]) -> None:
    spec = specs["ui_clear_day_sparse"]
    np.testing.assert_array_equal(
        draw_plan(build_road(spec.road), spec), draw_plan(build_road(spec.road), spec)
    )


def test_labels_cover_no_other_label() -> None:
    """Of three at one place, the needed ones are below each other, and the third is left out."""
    canvas = PlanCanvas(np.array([0.0, 0.0]), np.array([100.0, 100.0]), 400)
    empty = canvas.image.copy()
    canvas.text((50, 50), "left out", (1, 2, 3))
    canvas.text((50, 50), "first", (250, 0, 0), needed=True)
    canvas.text((50, 50), "second", (0, 0, 250), needed=True)
    canvas.draw_labels()

    first, second = ((canvas.image == c).all(axis=-1) for c in ((250, 0, 0), (0, 0, 250)))
    assert 0 < np.flatnonzero(first.any(axis=1)).max() < np.flatnonzero(second.any(axis=1)).min()
    changed = (canvas.image != empty).any(axis=-1)
    assert np.flatnonzero(changed.any(axis=1)).size < 40, "two lines of text"


def test_a_map_is_drawn_to_where_its_junctions_and_agents_are(tmp_path: Path) -> None:
    """A street that leads 2 km out of the map does not make all else small."""
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
    text = text.replace('<node id="2" lat="48.0018"', '<node id="2" lat="48.018"')
    (tmp_path / "crossroads.osm").write_text(text, encoding="utf-8")
    (tmp_path / "road.yaml").write_text(yaml.safe_dump(AT_JUNCTION))
    road = load_declaration(tmp_path / "road.yaml").declaration
    assert isinstance(road, Road)
    canvas = draw_plan_canvas(build_road(road))
    assert canvas.high[1] - canvas.low[1] < 400
    assert canvas.px_per_m >= 4


def test_a_picture_needs_the_name_of_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end the name in \.png"):
        write_image(np.zeros((4, 4, 3), np.uint8), tmp_path / "plan.doc")


@pytest.mark.parametrize("name", ["plan.png", "plan.jpg"])
def test_a_picture_is_written_without_a_word(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_image(np.full((8, 8, 3), 200, np.uint8), tmp_path / name)
    assert (tmp_path / name).stat().st_size > 0
    assert capfd.readouterr() == ("", "")
