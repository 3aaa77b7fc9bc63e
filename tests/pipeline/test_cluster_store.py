"""Datasets in a store that speaks S3, on this machine; and who may write there."""

import hashlib
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity import open_dataset
from advercity.dataset.remote import upload_part, verify_store
from advercity.dataset.store import LEASE_FILE, DatasetLease, DatasetStore
from advercity.errors import InputError, RunError
from advercity.pipeline import RunOptions, RunResources, raise_failures, run_scenarios
from advercity.testing import RecordingListener
from tests.command_line import Command
from tests.requirements import require

OptionsFor = Callable[[Path], RunOptions]
FRAMES = 2


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Generator[str]:
    """URL of an empty bucket on a server of this machine."""
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    }.items():
        monkeypatch.setenv(name, value)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    name = hashlib.sha256(str(tmp_path).encode()).hexdigest()[:16]
    s3fs.S3FileSystem().mkdir(name)
    yield f"s3://{name}"
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


def digests(files: dict[str, bytes]) -> dict[str, str]:
    return {path: hashlib.sha256(content).hexdigest() for path, content in files.items()}


def in_folder(folder: Path) -> dict[str, str]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return digests({str(path.relative_to(folder)): path.read_bytes() for path in paths})


def in_store(url: str) -> dict[str, str]:
    store = DatasetStore(url)
    return digests({path: store.read(path) or b"" for path in store.list_files("")})


@pytest.mark.sumo
@pytest.mark.slow
def test_a_run_into_a_store_resumes_after_a_kill_with_the_bytes_of_one_machine(
    bucket: str,
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    require("ray")
    from advercity_cluster.ray_executor import RayExecutor

    url, spec = f"{bucket}/dataset", few[0]
    chosen = replace(options(tmp_path / "alone"), frames=slice(0, FRAMES))
    raise_failures(run_scenarios([spec], chosen, listener=listener))
    # What a driver leaves that is killed after the first of two tasks, in the middle of the second.
    half = replace(options(tmp_path / "half"), frames=slice(0, FRAMES // 2))
    raise_failures(run_scenarios([spec], half, listener=listener))
    store = DatasetStore(url)
    upload_part(store, tmp_path / "half" / spec.id)
    write = store.write

    def write_first_agent(path: str, content: bytes) -> None:
        if path.startswith(f"{spec.id}/-1/"):
            raise RunError("the machine stops")
        write(path, content)

    with monkeypatch.context() as patched, pytest.raises(RunError, match="stops"):
        patched.setattr(store, "write", write_first_agent)
        upload_part(store, tmp_path / "alone" / spec.id)
    assert len(store.list_files(f"{spec.id}/+101")) == 2 * len(store.list_files(f"{spec.id}/102"))
    store.write(LEASE_FILE, b"node process 1 0\n7\n")
    cluster = RayExecutor(url, frames_per_task=FRAMES // 2, patience_s=0.5)
    raise_failures(cluster.run([spec], chosen, listener=listener, resources=RunResources()))
    assert in_store(url) == in_folder(tmp_path / "alone")
    assert verify_store(url) == []
    store.write(f"{spec.id}/102/000060.pcd", b"changed")
    store.remove(f"{spec.id}/102/000061.pcd")
    assert [str(problem) for problem in verify_store(url)] == [
        f"{spec.id}/102/000060.pcd: changed",
        f"{spec.id}/102/000061.pcd: missing",
    ]
    store.remove(spec.id)
    assert [str(problem) for problem in verify_store(url)] == [f"{spec.id}/manifest.json: missing"]


def test_a_store_that_refuses_is_an_error(bucket: str) -> None:
    with pytest.raises(RunError, match=r"a cannot be written: .*bucket does not exist"):
        DatasetStore("s3://elsewhere/dataset").write("a", b"")
    with pytest.raises(RunError, match="it cannot be listed"):
        DatasetStore("s3://elsewhere/dataset").list_files("")
    with pytest.raises(InputError, match=r"no manifest\.json in its folders, so not a dataset"):
        verify_store(f"{bucket}/dataset")


def test_a_dataset_in_a_store_is_read_after_copying_it(advercity: Command) -> None:
    with pytest.raises(InputError, match="copy the dataset into a folder first"):
        open_dataset("s3://bucket/dataset")
    code, _, said = advercity("stats", "s3://bucket/dataset")
    assert code == 2
    assert "copy the dataset into a folder first" in said


@pytest.fixture(params=["folder", "bucket"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> DatasetStore:
    """A folder that machines share, and a bucket."""
    place = str(tmp_path) if request.param == "folder" else request.getfixturevalue("bucket")
    return DatasetStore(f"{place}/dataset")


def test_a_dataset_that_another_run_is_making_is_left_alone(store: DatasetStore) -> None:
    with (
        DatasetLease(store, timeout_s=6.0),
        pytest.raises(RunError, match=r"another run is making this dataset \(.* process \d+\)"),
        DatasetLease(store, timeout_s=6.0),
    ):
        pass
    with DatasetLease(store, timeout_s=6.0):
        pass
    assert store.list_files("") == []


def test_a_lease_that_is_not_renewed_is_taken_over(store: DatasetStore) -> None:
    store.write(LEASE_FILE, b"node process 1 0\n7\n")
    with DatasetLease(store, timeout_s=0.4) as lease:
        lease.check()
    assert store.read(LEASE_FILE) is None


def test_a_run_whose_lease_was_taken_over_fails_and_leaves_it(
    store: DatasetStore,
) -> None:
    with DatasetLease(store, timeout_s=0.2) as lease:
        store.write(LEASE_FILE, b"node process 2 0\n0\n")
        with pytest.raises(RunError, match="another run may have taken it over"):
            _check_again_and_again(lease)
    assert store.read(LEASE_FILE) == b"node process 2 0\n0\n"


def test_a_run_whose_store_stops_answering_fails(
    store: DatasetStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(*_: object) -> bytes:
        raise RunError("no answer")

    with DatasetLease(store, timeout_s=0.2) as lease:
        monkeypatch.setattr(DatasetStore, "read", silent)
        with pytest.raises(RunError, match="the lease on the output ran out"):
            _check_again_and_again(lease)


def _check_again_and_again(lease: DatasetLease) -> None:
    until_s = time.monotonic() + 30
    while time.monotonic() < until_s:
        lease.check()
        time.sleep(0.02)
