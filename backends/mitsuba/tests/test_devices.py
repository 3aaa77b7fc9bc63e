"""Finding a device for Mitsuba's kernels."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from advercity_mitsuba import MitsubaBackend, devices

from advercity.errors import BackendError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only searched folder."""
    monkeypatch.delenv(devices.LIBRARY_VARIABLE, raising=False)
    monkeypatch.setattr(devices, "find_library_folders", lambda: [tmp_path])
    return tmp_path


def test_an_old_llvm_is_never_loaded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("libLLVM-14.so.1", "libLLVM-15.so"):
        (folder / name).touch()
    asked: list[Path] = []
    monkeypatch.setattr(devices, "read_llvm_version", asked.append)
    with pytest.raises(BackendError, match=r"no LLVM library.*libllvm19"):
        devices.find_llvm()
    assert asked == []


def test_the_newest_llvm_that_loads_is_taken(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("libLLVM-15.so", "libLLVM.so.19.1", "libLLVM-17.so.1"):
        (folder / name).touch()
    versions = {"libLLVM-17.so.1": "17.0.6"}

    def read_version(library: Path) -> str | None:
        return versions.get(library.name)

    monkeypatch.setattr(devices, "read_llvm_version", read_version)
    assert devices.find_llvm() == (folder / "libLLVM-17.so.1", "17.0.6")


def test_what_is_no_library_has_no_version(tmp_path: Path) -> None:
    (tmp_path / "libLLVM-19.so").write_text("no library")
    assert devices.read_llvm_version(tmp_path / "libLLVM-19.so") is None


def test_a_chosen_library_that_does_not_load_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = tmp_path / "libLLVM.so.19.1"
    monkeypatch.setenv(devices.LIBRARY_VARIABLE, str(chosen))
    with pytest.raises(BackendError, match=str(chosen)):
        devices.find_llvm()


def test_kernels_are_compiled_by_the_llvm_that_the_device_names(
    backend: MitsubaBackend, tmp_path: Path
) -> None:
    if backend.capabilities().hardware:
        pytest.skip("CUDA compiles the kernels")
    library, _ = devices.find_llvm()
    (tmp_path / "llvm").mkdir()
    (tmp_path / "llvm" / library.name).symlink_to(library)
    script = (
        "import advercity_mitsuba; print(advercity_mitsuba.MitsubaBackend().capabilities().device);"
        "import drjit; print(*drjit.detail.llvm_version(), sep='.')"
    )
    environment = {key: os.environ[key] for key in os.environ if key != devices.LIBRARY_VARIABLE}
    # In a process of its own: in this one Dr.Jit has loaded its library already.
    child = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env={**environment, "ADVERCITY_DATA": str(tmp_path)},
    )
    assert child.returncode == 0, child.stderr
    device, loaded = child.stdout.split("\n")[:2]
    assert device.endswith(f"LLVM {loaded}")
