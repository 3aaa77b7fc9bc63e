"""Rerun's viewer as a process of its own: a window, or a page for browsers of this machine only."""

import os
import socket
import subprocess
import sys
import time
import webbrowser
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import rerun_cli

from advercity.errors import RunError
from advercity.processes import bind_to_this_process
from advercity.viewer.private_page import LOOPBACK_ADDRESS, forward_page

DEFAULT_PORT = 9876
"""Port of a live view, which is Rerun's own."""
WEB_PORT = 9090
"""Port of the page, which is Rerun's own."""
STREAM_SCHEMES = ("rerun+http://", "rerun+https://", "rerun://")
START_TIMEOUT_S = 30.0
Viewer = subprocess.Popen[bytes]


def format_stream_address(port: int = DEFAULT_PORT) -> str:
    """Return the address of a live view of this machine."""
    return f"rerun+http://{LOOPBACK_ADDRESS}:{port}/proxy"


def format_page_address(stream: str, *, web_port: int = WEB_PORT) -> str:
    """Return the address of the page of a stream."""
    return f"http://{LOOPBACK_ADDRESS}:{web_port}/?url={quote(stream, safe='')}"


def show(source: str, *, web: bool, map_tiles: bool = False, analytics: bool = False) -> None:
    """Show a recording or a stream in a window or a browser, until it is closed.

    Args:
        source: Recording (`.rrd`), or the address of a stream.
        web: In a browser, which is opened.
        map_tiles: Allow the page to fetch map tiles.
        analytics: Allow Rerun to send usage data, if its own settings do.

    Raises:
        RunError: The viewer fails.
    """
    if web:
        is_stream = source.startswith(STREAM_SCHEMES)
        stream = source if is_stream else format_stream_address()
        with open_page(source, map_tiles=map_tiles, analytics=analytics) as viewer:
            webbrowser.open(format_page_address(stream))
            exit_code = viewer.wait()
    else:
        with _run_viewer([source], analytics=analytics) as viewer:
            exit_code = viewer.wait()
    if exit_code != 0:
        hint = "" if web else "; without a screen, try `web`"
        raise RunError(f"the viewer ended with exit code {exit_code}{hint}")


@contextmanager
def open_page(
    source: str,
    *,
    port: int = DEFAULT_PORT,
    web_port: int = WEB_PORT,
    map_tiles: bool = False,
    analytics: bool = False,
) -> Generator[Viewer]:
    """Serve the page of a recording or a stream to browsers of this machine.

    Args:
        source: Recording (`.rrd`), or the address of a stream.
        port: Port at which the page finds a recording.
        web_port: Port of the page.
        map_tiles: Allow the page to fetch map tiles.
        analytics: Allow the page to use the Internet as it likes, to send usage data.

    Raises:
        RunError: The viewer does not start, or a port is taken.
    """
    inner_port = web_port if analytics else _find_free_port()
    options = ["--serve-web", "--web-viewer-port", str(inner_port)]
    check_port(web_port)
    if not source.startswith(STREAM_SCHEMES):
        check_port(port)
        options += ["--port", str(port)]
    with _run_viewer([*options, source], analytics=analytics) as viewer:
        _wait_for_page(viewer, inner_port)
        if analytics:
            yield viewer
        else:
            with forward_page(web_port, inner_port, map_tiles=map_tiles):
                yield viewer


def check_port(port: int, remedy: str = "close it") -> None:
    """Check that a port of this machine is free; RunError, with a remedy, if it is taken."""
    try:
        with socket.socket() as probe:
            # As in Rerun's server; else a port of a finished run counts as taken for a while.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((LOOPBACK_ADDRESS, port))
    except OSError as error:
        raise RunError(f"port {port} is taken, perhaps by a Rerun viewer; {remedy}") from error


def _find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK_ADDRESS, 0))
        return probe.getsockname()[1]


def _wait_for_page(viewer: Viewer, port: int) -> None:
    until_s = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < until_s and viewer.poll() is None:
        with suppress(OSError):
            return socket.create_connection((LOOPBACK_ADDRESS, port), timeout=1).close()
        time.sleep(0.1)
    raise RunError(f"the viewer for browsers does not answer at port {port}; try without `web`")


@contextmanager
def _run_viewer(arguments: list[str], *, analytics: bool) -> Generator[Viewer]:
    # Not by Rerun's module: the program would be its child and outlive a kill of this process.
    program = str(Path(rerun_cli.__file__).with_name("rerun"))
    command = bind_to_this_process([program, "--bind", LOOPBACK_ADDRESS, *arguments])
    with _choose_environment(analytics=analytics) as environment:
        viewer = subprocess.Popen(  # noqa: S603 - rerun's own program
            command, env=environment, start_new_session=True
        )
        try:
            yield viewer
        finally:
            viewer.terminate()
            viewer.wait()


@contextmanager
def _choose_environment(*, analytics: bool) -> Generator[dict[str, str]]:
    """Choose an environment in which Rerun sends no usage data; its own settings stay."""
    quiet = {**os.environ, "RUST_LOG": os.environ.get("RUST_LOG", "warn")}
    if analytics:
        yield quiet
        return
    with TemporaryDirectory() as folder:
        private = {**quiet, "XDG_CONFIG_HOME": folder}
        command = [sys.executable, "-m", "rerun", "analytics", "disable"]
        subprocess.run(command, env=private, capture_output=True, check=False)  # noqa: S603
        yield private
