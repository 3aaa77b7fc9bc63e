"""Sites as OpenDRIVE: what ASAM's checker remarks, and records by hand."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_exports.site_opendrive import format_site
from advercity_exports.tidy_opendrive import tidy_road

from advercity.roads.sumo_network import write_sumo_network
from tests.exports.readers import needs_readers, run_reader


@needs_readers
@pytest.mark.parametrize("road", ["ui", "unj", "ri", "rsnj", "rcnj"])
def test_asams_checker_has_no_remarks(road: str, specs: dict[str, Spec], tmp_path: Path) -> None:
    declared = specs[f"{road}_clear_day_sparse"].road
    path = tmp_path / "site.xodr"
    path.write_bytes(format_site(declared, write_sumo_network(declared, tmp_path)))
    assert run_reader("read_opendrive.py", path) == {"site.xodr": []}


CURVE = """<geometry s="20" x="20" y="0" hdg="0" length="9.9">
    <paramPoly3 aU="0" bU="10" cU="0" dU="0" aV="0" bV="0" cV="4" dV="0" pRange="normalized"/>
  </geometry>"""
ROAD = f"""<road length="29.9">
  <planView>
    <geometry s="0" x="0" y="0" hdg="0" length="8"><line/></geometry>
    <geometry s="8" x="8" y="0" hdg="0" length="12"><line/></geometry>
    {CURVE}
  </planView>
  <elevationProfile>
    <elevation s="0" a="1" b="0.05" c="0" d="0"/>
    <elevation s="4" a="1.2" b="0.05" c="0" d="0"/>
    <elevation s="20" a="2" b="0.01" c="0" d="0"/>
  </elevationProfile>
  <lanes><laneSection s="0"/><laneSection s="24.95"/></lanes>
</road>"""


def read(element: ElementTree.Element | None, name: str) -> float:
    assert element is not None
    return float(element.attrib[name])


def test_a_curve_has_its_length_and_all_along_the_road_moves_with_it() -> None:
    road = ElementTree.fromstring(ROAD)
    tidy_road(road)
    # u = 10 p and v = 4 p²: a parabola, whose length is known in closed form.
    slope = 0.8
    length = 10 * (np.sqrt(1 + slope**2) / 2 + np.arcsinh(slope) / (2 * slope))
    line, curve = road.findall("planView/geometry")
    assert (read(line, "s"), read(line, "length")) == (0, 20)
    assert read(curve, "length") == pytest.approx(length, abs=1e-8)
    assert read(road, "length") == pytest.approx(20 + length, abs=1e-8)
    first, last = road.findall("elevationProfile/elevation")
    assert (read(first, "a"), read(first, "b"), read(last, "s")) == (1, 0.05, 20)
    # At the end, 9.9 m further by the file, it is 0.099 m higher, as before.
    assert read(last, "b") * length == pytest.approx(0.099, abs=1e-7)
    sections = [read(item, "s") for item in road.findall("lanes/laneSection")]
    assert sections == [0, pytest.approx(20 + length / 2, abs=1e-8)]


@pytest.mark.parametrize(
    ("found", "changed"),
    [
        ('x="8" y="0" hdg="0"', 'x="8" y="0.01" hdg="0"'),
        ('x="8" y="0" hdg="0"', 'x="8" y="0" hdg="0.001"'),
        ('s="4" a="1.2" b="0.05"', 's="4" a="1.21" b="0.05"'),
        ('s="4" a="1.2" b="0.05"', 's="4" a="1.2" b="0.04"'),
        ('s="4" a="1.2" b="0.05" c="0"', 's="4" a="1.2" b="0.05" c="0.01"'),
    ],
)
def test_records_that_differ_stay(found: str, changed: str) -> None:
    road = ElementTree.fromstring(ROAD.replace(found, changed))
    tidy_road(road)
    is_line = "hdg" in found
    assert len(road.findall("planView/geometry")) == (3 if is_line else 2)
    assert len(road.findall("elevationProfile/elevation")) == (2 if is_line else 3)
