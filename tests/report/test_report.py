"""The report of a dataset is one page that holds everything it shows."""

import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_report.page import write_report

from advercity.dataset.manifest import Identity
from advercity.dataset.reader import Dataset
from tests.builders import SensorFramesOf, identify, write_scenario
from tests.command_line import Command

VOID_TAGS = {"meta", "img"}


class Page(HTMLParser):
    """A parsed page: its text, its references, and tags that are not closed in order."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.references: list[str] = []
        self.texts: list[str] = []
        self.rows: list[list[str]] = []
        self.open_tags: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag == "tr":
            self.rows.append([])
        if tag not in VOID_TAGS:
            self.open_tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)
        if self.open_tags and self.open_tags[-1] in ("td", "th", "a") and self.rows:
            self.rows[-1].append(data)


@pytest.fixture(scope="module")
def page(two_roads: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    output = tmp_path_factory.mktemp("report") / "report.html"
    write_report(two_roads, output)
    return Page(output)


def test_a_report_lists_every_scenario_with_its_frames(page: Page, two_roads: Path) -> None:
    assert page.open_tags == []
    for scenario in Dataset(two_roads).scenarios:
        row = next(row for row in page.rows if row[:1] == [scenario.id])
        assert f"{len(scenario)} of {scenario.manifest.length}" in row
        assert ["traffic", scenario.manifest.identity.trace_sha256] in page.rows


def test_a_report_needs_no_other_file_and_no_network(page: Page) -> None:
    images = [one for one in page.references if not one.startswith("#")]
    assert len(images) > 2
    for one in images:
        match = re.fullmatch(r"data:image/(jpeg|png);base64,(.+)", one)
        assert match
        decoded = cv2.imdecode(np.frombuffer(b64decode(match[2]), np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        assert decoded.std() > 1


def test_links_of_a_report_lead_to_its_scenarios(page: Page, two_roads: Path) -> None:
    links = [one for one in page.references if one.startswith("#")]
    assert links == [f"#{scenario.id}" for scenario in Dataset(two_roads).scenarios]


def test_texts_of_a_dataset_are_no_markup(
    advercity: Command,
    spec: Spec,
    sensor_frames_of: SensorFramesOf,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    missed = ("<script>alert(1)</script> & more",)

    def identify_with_missed(one: Spec, *, format: str) -> Identity:
        found = identify(one, format=format)
        return found.model_copy(update={"missed_conflicts": missed})

    monkeypatch.setattr("tests.builders.identify", identify_with_missed)
    scenario = write_scenario(tmp_path / "dataset", spec, sensor_frames_of)
    output = tmp_path / "report.html"
    ran = advercity("report", scenario, "--output", output)
    assert (ran.code, ran.out.strip()) == (0, str(output))
    assert "<script" not in output.read_text()
    assert any(missed[0] in text for text in Page(output).texts)


def test_a_report_is_not_written_over_files_of_others_nor_into_a_dataset(
    advercity: Command, two_roads: Path, tmp_path: Path
) -> None:
    others = tmp_path / "mine.html"
    others.write_text("mine")
    assert advercity("report", two_roads, "--output", others).code == 2
    assert others.read_text() == "mine"
    inside = next(path for path in two_roads.iterdir() if path.is_dir()) / "report.html"
    assert advercity("report", two_roads, "--output", inside).code == 2
    assert not inside.exists()
