"""Files are complete or absent, links are never written through, leftovers are swept."""

import os
import subprocess
from pathlib import Path

import pytest

from advercity.atomic_files import (
    format_partial_name,
    open_partial_path,
    remove_abandoned_partials,
    write_atomically,
    write_file,
)
from advercity.errors import InputError, describe_cause, report_write_errors


def test_a_file_keeps_its_content_where_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "data"
    write_atomically(path, b"old")
    with pytest.raises(ZeroDivisionError), open_partial_path(path) as partial:
        partial.write_bytes(b"ne")
        raise ZeroDivisionError
    assert path.read_bytes() == b"old"
    assert [item.name for item in path.parent.iterdir()] == ["data"]


def test_a_link_is_replaced_or_refused_and_never_written_through(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"mine")
    link.symlink_to(target)
    with pytest.raises(OSError):
        write_file(link, b"ours")
    assert link.is_symlink()
    write_atomically(link, b"ours")
    assert (target.read_bytes(), link.read_bytes()) == (b"mine", b"ours")


def test_a_file_keeps_its_content_under_another_name(tmp_path: Path) -> None:
    backup, path = tmp_path / "backup", tmp_path / "data"
    backup.write_bytes(b"mine")
    for write in (write_file, write_atomically):
        path.unlink(missing_ok=True)
        path.hardlink_to(backup)
        write(path, b"ours")
        assert (backup.read_bytes(), path.read_bytes()) == (b"mine", b"ours")


def test_partial_files_of_ended_processes_and_old_ones_are_swept(tmp_path: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    with open_partial_path(tmp_path / "data") as partial:
        partial.write_bytes(b"x")
        own = partial.parent
        machine = own.name.split("-")[1]
        names = {
            "dead": format_partial_name(machine, ended.pid, "0" * 8),
            "elsewhere": format_partial_name("0" * 8, ended.pid, "0" * 8),
            "old": format_partial_name("0" * 8, 1, "0" * 8),
            "stranger": own.name.replace(f"-{os.getpid()}-", f"-{ended.pid}-"),
            "notes": ".partial-notes",
        }
        for name in names.values():
            (tmp_path / name).mkdir()
        os.utime(tmp_path / names["old"], (0, 0))
        assert remove_abandoned_partials(tmp_path) == 2
        left = {own.name, names["elsewhere"], names["stranger"], names["notes"]}
        assert {path.name for path in tmp_path.iterdir()} == left


def test_a_cause_is_never_none(tmp_path: Path) -> None:
    assert describe_cause(OSError("Cannot call rmtree on a symbolic link")).startswith("Cannot")
    assert describe_cause(OSError()) == "OSError"
    assert describe_cause(OSError(28, "No space left on device")) == "No space left on device"
    with pytest.raises(InputError, match="the output: cannot be written: x"), report_write_errors():
        raise OSError("x")


def test_an_error_that_takes_no_name_passes_as_it_is(tmp_path: Path) -> None:
    class EncoderError(OSError):
        """As those of PyAV."""

        filename = property(lambda _: None)  # pyright: ignore[reportAssignmentType]

    with pytest.raises(EncoderError), open_partial_path(tmp_path / "plan.mp4"):
        raise EncoderError
    with pytest.raises(OSError, match=r"plan\.mp4"), open_partial_path(tmp_path / "plan.mp4"):
        raise OSError(28, "No space left on device")


def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "weather.yaml"
    path.write_bytes(b"mine")
    path.chmod(0o600)
    write_atomically(path, b"more")
    assert path.read_bytes() == b"more"
    assert path.stat().st_mode & 0o777 == 0o600
