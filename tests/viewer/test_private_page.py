"""The page of the live view, without a browser; `test_web_viewer` opens it in one."""

import socket
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from advercity.errors import RunError
from advercity.viewer.private_page import forward_page


@pytest.fixture
def source_port(tmp_path: Path) -> Iterator[int]:
    """Port at which a page is served as Rerun does."""
    (tmp_path / "index.html").write_text("the page")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.parametrize("map_tiles", [False, True])
def test_the_page_may_ask_this_machine_only_and_map_tiles_if_wanted(
    source_port: int, map_tiles: bool
) -> None:
    port = free_port()
    with forward_page(port, source_port, map_tiles=map_tiles):
        with urlopen(f"http://127.0.0.1:{port}/") as answer:
            policy = answer.headers["Content-Security-Policy"]
            assert answer.read() == b"the page"
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"http://127.0.0.1:{port}/nothing")
    elsewhere = [word for word in policy.split() if word.startswith("https:")]
    assert elsewhere == (["https://tile.openstreetmap.org"] if map_tiles else [])
    assert policy.startswith("default-src 'self' ")


def test_a_port_that_is_taken_is_named(source_port: int) -> None:
    with (
        pytest.raises(RunError, match=f"port {source_port} is taken"),
        forward_page(source_port, source_port, map_tiles=False),
    ):
        pass
