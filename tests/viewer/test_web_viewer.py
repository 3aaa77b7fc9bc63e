"""The web view of a recording, in a real browser without a screen."""

import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.roads.road_network import build_road
from advercity.viewer.archetypes import LANE_COLOURS
from advercity.viewer.recording import RerunRecording
from advercity.viewer.viewer_process import format_page_address, format_stream_address, open_page

HINT = "the web view is not tested; `scripts/setup_peers` installs Playwright and Chromium"
playwright: Any = pytest.importorskip("playwright.sync_api", reason=HINT)

PATIENCE_S = 150
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
ALONE = ("--no-sandbox", "--disable-background-networking", "--disable-component-update")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", "0")  # where scripts/setup_peers puts it
    with playwright.sync_playwright() as browsers:
        executable = shutil.which("chromium") or browsers.chromium.executable_path
        if not Path(executable).is_file():
            pytest.skip(HINT)
        arguments = [*SOFTWARE_GL, *ALONE]
        browser = browsers.chromium.launch(executable_path=executable, args=arguments)
        yield browser.new_page(viewport={"width": 1600, "height": 900})
        browser.close()


@pytest.fixture
def recording(tmp_path: Path, specs: dict[str, Spec]) -> Path:
    """The road plan of the urban crossing."""
    spec = specs["ui_fog_day_sparse"]
    path = tmp_path / "road.rrd"
    with RerunRecording(spec, build_road(spec.road).lanes, file=path):
        pass
    return path


@pytest.fixture
def address(recording: Path) -> Iterator[str]:
    """Where the served view of the recording is found."""
    port, web_port = free_port(), free_port()
    with open_page(str(recording), port=port, web_port=web_port):
        page_address = format_page_address(format_stream_address(port), web_port=web_port)
        yield f"{page_address}&renderer=webgl"


def shot(page: Any) -> NDArray[np.uint8]:
    data = np.frombuffer(page.screenshot(timeout=120_000), np.uint8)
    image: Any = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return image


def drawn(image: NDArray[np.uint8], kind: str) -> int:
    """Pixels in the colour of the borders of a kind of lane; nothing else of the page has it."""
    apart = np.abs(image[..., ::-1].astype(np.int32) - LANE_COLOURS[kind])
    return int(np.count_nonzero(apart.max(axis=-1) <= 12))


def test_the_web_view_shows_the_road(page: Any, address: str, tmp_path: Path) -> None:
    errors: list[object] = []

    def note(error: object) -> None:
        errors.append(error)

    page.on("pageerror", note)
    page.goto(address)
    end = time.monotonic() + PATIENCE_S
    image = shot(page)
    while not drawn(image, "crossing") and time.monotonic() < end:
        time.sleep(3)
        image = shot(page)
    cv2.imwrite(str(tmp_path / "view.png"), image)
    assert errors == []
    assert drawn(image, "sidewalk") > 200
    assert drawn(image, "crossing") > 50
