import hashlib
import socket
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import psutil
import pytest
from advercity_dsl import Spec

from advercity.dataset.store import DatasetStore
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError, RunError
from advercity.pipeline import (
    RunOptions,
    RunResources,
    create_executor,
    raise_failures,
    run_scenarios,
)
from advercity.testing import RecordingListener
from tests.requirements import require

OptionsFor = Callable[[Path], RunOptions]
FRAMES = 6


@pytest.fixture
def nodes(stunts: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Any]:
    """A Ray cluster of a head that works on nothing and two nodes with one core each."""
    # Else Ray takes loopback addresses for those of a network card.
    monkeypatch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
    require("ray")
    from ray.cluster_utils import Cluster

    cluster = Cluster(
        initialize_head=True,
        head_node_args={"num_cpus": 0, "include_dashboard": False, "node_ip_address": "127.0.0.1"},
    )
    for _ in range(2):
        cluster.add_node(num_cpus=1, node_ip_address="127.0.0.1")
    yield cluster
    cluster.shutdown()


def tree(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def lose_a_node(nodes: Any, stunts: Path, output: Path) -> None:
    """As soon as something is done: let the next process hang, and kill the node that it is on."""
    while not list(output.glob(".staging/*/*.json")):
        time.sleep(0.05)
    (stunts / "1.hang").touch()
    told = stunts.with_suffix(".hanging")
    while not told.exists() or not told.read_text():
        time.sleep(0.05)
    above = {process.pid for process in psutil.Process(int(told.read_text())).parents()}
    (lost,) = [
        node
        for node in nodes.worker_nodes
        if above & {info.process.pid for infos in node.all_processes.values() for info in infos}
    ]
    nodes.remove_node(lost, allow_graceful=False)


@pytest.mark.sumo
@pytest.mark.slow
def test_a_cluster_that_loses_a_node_makes_what_one_machine_makes(
    nodes: Any,
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
) -> None:
    from advercity_cluster.ray_executor import RayExecutor

    alone, shared = tmp_path / "alone", tmp_path / "shared"
    chosen = replace(options(alone), frames=slice(0, FRAMES))
    raise_failures(run_scenarios(few[:2], chosen, listener=listener, resources=RunResources(2)))
    cluster = RayExecutor(str(shared), nodes.address, frames_per_task=2)
    losing = Thread(target=lose_a_node, args=(nodes, stunts, shared), daemon=True)
    losing.start()
    results = cluster.run(few[:2], chosen, listener=listener, resources=RunResources())
    raise_failures(results)
    losing.join()
    assert len(nodes.worker_nodes) == 1
    assert [result.frames for result in results] == [FRAMES, FRAMES]
    assert tree(shared) == tree(alone)
    assert verify_dataset(shared) == []
    again = cluster.run(few[:1], chosen, listener=listener, resources=RunResources())
    assert again[0].error is None
    assert tree(shared) == tree(alone)


@pytest.mark.parametrize("url", ["memory://dataset", "{folder}/dataset", "file://{folder}/dataset"])
def test_a_store_keeps_files_whatever_it_is_made_of(url: str, tmp_path: Path) -> None:
    store = DatasetStore(url.format(folder=tmp_path))
    store.write("ui/101/000060.yaml", b"one")
    store.write("ui/101/000060.yaml", b"two")
    store.write("ui/manifest.json", b"{}")
    assert store.read("ui/101/000060.yaml") == b"two"
    assert store.read("ui/101/000061.yaml") is None
    assert store.list_files("ui") == ["ui/101/000060.yaml", "ui/manifest.json"]
    store.remove("ui/manifest.json")
    store.remove("nothing")
    assert store.list_files("ui") == ["ui/101/000060.yaml"]
    store.remove("ui")
    assert store.list_files("ui") == []


def test_a_store_without_a_driver_is_bad_input() -> None:
    with pytest.raises(InputError, match="`output` nowhere://x: cannot be reached"):
        DatasetStore("nowhere://x")


def test_a_store_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"ui/a\.png cannot be written"):
        DatasetStore(str(tmp_path / "file")).write("ui/a.png", b"")


@pytest.mark.parametrize(
    ("name", "output", "address", "message"),
    [
        ("local", "out", "auto", "`cluster_address` goes with the `executor` of a cluster"),
        ("slurm", "out", None, "`executor` slurm: is not installed; there is local, ray"),
        ("local", "s3://bucket/out", None, "a store needs an `executor`, such as ray"),
    ],
)
def test_an_executor_that_does_not_fit_is_bad_input(
    name: str, output: str, address: str | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        create_executor(RunOptions(output, executor=name, cluster_address=address))


@pytest.mark.parametrize("address", ["127.0.0.1:{port}", "ray://127.0.0.1:{port}"])
def test_a_cluster_that_does_not_answer_is_one_message_at_once(
    address: str, specs: dict[str, Spec], tmp_path: Path
) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        url = address.format(port=unused.getsockname()[1])
    executor = create_executor(RunOptions(tmp_path / "output", executor="ray", cluster_address=url))
    assert executor is not None
    with pytest.raises(RunError) as told:
        executor.run(
            [specs["ui_fog_day_sparse"]],
            RunOptions(tmp_path),
            resources=RunResources(),
            listener=RecordingListener(),
        )
    assert str(told.value).startswith(f"`cluster_address` {url}: no Ray cluster answers there: ")
    assert "\n" not in str(told.value)
    assert not (tmp_path / "output").exists()
