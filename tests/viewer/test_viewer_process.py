"""The viewer's server ends with the process that started it, and a taken port is named."""

import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.errors import RunError
from advercity.roads.road_network import build_road
from advercity.viewer.recording import RerunRecording
from advercity.viewer.viewer_process import open_page

SERVE = """
import sys, time
from advercity.viewer.viewer_process import open_page
with open_page(sys.argv[1], port=int(sys.argv[2]), web_port=int(sys.argv[3])):
    print("serves", flush=True)
    time.sleep(60)
"""


def is_free(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


@pytest.fixture
def recording(tmp_path: Path, specs: dict[str, Spec]) -> Path:
    spec, path = specs["ui_fog_day_sparse"], tmp_path / "road.rrd"
    with RerunRecording(spec, build_road(spec.road).lanes, file=path):
        pass
    return path


@pytest.fixture
def ports() -> tuple[int, int]:
    with socket.socket() as first, socket.socket() as second:
        first.bind(("127.0.0.1", 0))
        second.bind(("127.0.0.1", 0))
        return first.getsockname()[1], second.getsockname()[1]


def test_a_kill_of_the_command_ends_its_server(recording: Path, ports: tuple[int, int]):
    command = [sys.executable, "-c", SERVE, str(recording), *map(str, ports)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"serves\n"
        assert not any(map(is_free, ports))
        child.kill()
    until_s = time.monotonic() + 10
    while time.monotonic() < until_s and not all(map(is_free, ports)):
        time.sleep(0.1)
    assert all(map(is_free, ports))


@pytest.mark.parametrize("taken", [0, 1])
def test_a_port_that_another_server_has_is_named(
    recording: Path, ports: tuple[int, int], taken: int
):
    with socket.socket() as other:
        other.bind(("127.0.0.1", ports[taken]))
        other.listen()
        with (
            pytest.raises(RunError, match=f"port {ports[taken]} is taken, perhaps by a Rerun"),
            open_page(str(recording), port=ports[0], web_port=ports[1]),
        ):
            pass
