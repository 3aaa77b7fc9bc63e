"""The comparison of imported OpenDRIVE maps with samples of their files."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from advercity_dsl import MapFile
from maps import (
    ROAD,
    compare,
    compare_map,
    main,
    measure_unpaved_part,
    sample_file,
    sample_import,
)
from opendrive_links import list_links, list_missing_links
from opendrive_samples import OpenDriveMap

from advercity.roads.lane_segments import LaneSegment
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network
from advercity.roads.road_network import build_road

DATA = Path(__file__).parents[1] / "data/maps"
TOWN07 = os.environ.get("ADVERCITY_TOWN07")
HINT = "CARLA's Town07 is not tested; ADVERCITY_TOWN07 names its OpenDRIVE file"
STREET = """<OpenDRIVE><road id="1" length="100" junction="-1">
  <type s="0" type="rural"><speed max="20"/></type>
  <planView><geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView>
  <lanes><laneSection s="0"><right>
    <lane id="-1" type="driving"><width sOffset="0" a="4"/></lane>
    <lane id="-2" type="driving"><width sOffset="0" a="3"/></lane>
    <lane id="-3" type="sidewalk"><width sOffset="0" a="2"/></lane>
  </right></laneSection></lanes></road></OpenDRIVE>"""


def segment(
    middle: float, width_m: float, *, id: str = "a_0", x: Sequence[float] = (0, 100), z: float = 0
) -> LaneSegment:
    """A lane that leads east at `y = middle`."""
    left, right = (np.array([[at, middle + side * width_m / 2, z] for at in x]) for side in (1, -1))
    return LaneSegment(id, "driving", left, right)


def read(text: str) -> OpenDriveMap:
    return OpenDriveMap(ElementTree.fromstring(text))


def compare_street(*lanes: LaneSegment, offset_m: Sequence[float] = (0, 0)) -> dict[str, float]:
    of_file = sample_file(read(STREET).sample_vehicle_lanes(0.5))
    of_import = sample_import(lanes, {"a_0": 20.0, "a_1": 15.0}, offset_m)
    there, back = compare(of_file, of_import), compare(of_import, of_file)
    return {
        "missing": there.distance_m.max(),
        "invented": back.distance_m.max(),
        "width": there.width_m.max(),
        "heading": there.heading_deg.max(),
        "height": there.height_m.max(),
        "speed": there.has_other_speed.mean(),
    }


def test_lanes_as_in_the_file_differ_in_nothing() -> None:
    found = compare_street(segment(-2, 4), segment(-5.5, 3))
    assert found == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-9)
    moved = compare_street(
        segment(-1002, 4, x=(-500, -400)), segment(-1005.5, 3, x=(-500, -400)), offset_m=(500, 1000)
    )
    assert moved == pytest.approx(found, abs=1e-9), "in the coordinates of the map"


@pytest.mark.parametrize(
    ("lanes", "expected"),
    [
        pytest.param([segment(-2, 4)], {"missing": 3.5, "width": 1}, id="a lane less"),
        pytest.param(
            [segment(-2, 4), segment(-5.5, 3), segment(2, 4)], {"invented": 4}, id="a lane more"
        ),
        pytest.param(
            [segment(-2, 4), segment(-5.5, 3, x=(0, 98))], {"missing": 1.5}, id="a lane too short"
        ),
        pytest.param(
            [segment(-1.8, 4.4), segment(-5.5, 3)],
            {"missing": 0.2, "invented": 0.2, "width": 0.4},
            id="a lane too wide",
        ),
        pytest.param(
            [segment(-2, 4), segment(-5.5, 3, id="a_1")], {"speed": 0.5}, id="a lane with a limit"
        ),
        pytest.param([segment(-2, 4), segment(-5.5, 3, z=0.7)], {"height": 0.7}, id="a lane high"),
    ],
)
def test_what_differs_shows(lanes: list[LaneSegment], expected: dict[str, float]) -> None:
    found = compare_street(*lanes)
    assert found == pytest.approx(dict.fromkeys(found, 0.0) | expected, abs=1e-4)


def test_lanes_that_lead_back_are_not_those_that_lead_on() -> None:
    turned = segment(-2, 4)
    turned = LaneSegment("a_0", "driving", turned.right[::-1], turned.left[::-1])
    assert compare_street(turned, segment(-5.5, 3))["missing"] == pytest.approx(3.5)


def test_paving_that_is_missing_is_a_part_of_the_lanes() -> None:
    """Lanes 7 m wide and 100 m long, of which the last 20.3 m are not paved."""
    lanes = list(read(STREET).sample_vehicle_lanes(0.5))
    whole, short = (shapely.box(-500, -8, end, 0) for end in (-400, -420.3))
    assert measure_unpaved_part(lanes, whole, (500, 0)) == 0
    assert measure_unpaved_part(lanes, short, (500, 0)) == pytest.approx(0.2, abs=1e-3)


def test_links_of_a_junction_are_asked_of_the_network() -> None:
    path = DATA / "junction.xodr"
    opendrive = read(path.read_text(encoding="utf-8"))
    imported = import_map(MapFile(source="opendrive", file=path.name), ROAD, path.parent)
    lanes = build_road(ROAD.model_copy(update={"imported": imported})).lanes
    connections = parse_packed_network(imported.network).connections
    assert len(list_links(opendrive)) > 3
    assert list_missing_links(opendrive, lanes, connections, imported.offset_m) == []
    missing = list_missing_links(opendrive, lanes, (), imported.offset_m)
    assert len(missing) == len(list_links(opendrive))


def test_a_map_is_compared_with_what_becomes_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(DATA / "bend.xodr")]) == 0
    row = capsys.readouterr().out.splitlines()[-1].split(" | ")
    # Two lanes in each of two roads, 100 m and an arc of 50 m.
    assert row[1:3] == ["2", "4"]
    assert float(row[3]) == pytest.approx(0.3, abs=0.01)
    assert row[9:12] == ["0.0%", "0%", "0 of 2"]
    assert row[12].startswith("as in the file")


def test_a_map_that_is_refused_is_named_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty.xodr").write_text("<OpenDRIVE/>")
    assert main([str(tmp_path)]) == 0
    row = capsys.readouterr().out.splitlines()[-1].split(" | ")
    assert row[0].endswith("/empty")
    assert row[12].startswith("refused: empty.xodr: ")


@pytest.mark.slow
@pytest.mark.skipif(TOWN07 is None, reason=HINT)
def test_town07_is_compared(tmp_path: Path) -> None:
    shutil.copy(str(TOWN07), tmp_path / "Town07.xodr")
    found = compare_map(tmp_path / "Town07.xodr")
    assert found.row[1:3] == ("277", "282")
    assert "TRACEBACK" not in found.row[-1]
