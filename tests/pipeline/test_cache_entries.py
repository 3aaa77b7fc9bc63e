"""Entries of the cache are checked, made again where they are bad, and kept within a size."""

import hashlib
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from advercity.atomic_files import format_partial_name, open_partial_path
from advercity.cli import main
from advercity.errors import InputError, RunError
from advercity.pipeline.cache_entries import (
    clear_cache,
    list_entries,
    load_entry,
    load_or_build_entry,
    prune_cache,
    read_checksum,
)

KEYS = [digit * 64 for digit in "abcdef"]
Get = Callable[..., bytes]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an empty cache."""
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ADVERCITY_CACHE_SIZE", raising=False)
    return tmp_path / "cache"


@pytest.fixture
def built() -> list[str]:
    """Names of the entries that were built."""
    return []


@pytest.fixture
def get(built: list[str]) -> Get:
    """Loads or builds a trace whose content begins with its key."""

    def get(key: str, content: bytes = b" data", kind: str = "traces") -> bytes:
        def build(partial: Path) -> None:
            built.append(key[0])
            partial.write_bytes(key[:1].encode() + content)

        return load_or_build_entry(f"{kind}/{key}.npz", build, Path.read_bytes)

    return get


def flip(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1] + b"!")


def empty(path: Path) -> None:
    path.write_bytes(b"")


def zero(path: Path) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def copy_other(path: Path) -> None:
    other = path.with_name(f"{KEYS[1]}.npz")
    shutil.copy(other, path)
    shutil.copy(f"{other}.sha256", f"{path}.sha256")


def make_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("damage", [flip, empty, zero, copy_other, make_pipe])
def test_a_bad_or_foreign_entry_is_made_again_and_one_line_says_so(
    damage: Callable[[Path], None],
    get: Get,
    built: list[str],
    cache: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert (get(KEYS[0]), get(KEYS[0]), get(KEYS[1])) == (b"a data", b"a data", b"b data")
    assert built == ["a", "b"]
    path = cache / "traces" / f"{KEYS[0]}.npz"
    damage(path)
    assert get(KEYS[0]) == get(KEYS[0]) == b"a data"
    assert built == ["a", "b", "a"]
    (record,) = caplog.records
    assert record.getMessage().startswith(f"{path}: ")
    assert record.getMessage().endswith("; it is made again")


def test_an_entry_that_cannot_be_parsed_is_made_again(get: Get, built: list[str]) -> None:
    def refuse(path: Path) -> bytes:
        raise RunError(f"{path}: not a trace")

    get(KEYS[0])
    assert load_entry(f"traces/{KEYS[0]}.npz", refuse) is None
    assert load_entry(f"traces/{KEYS[1]}.npz", refuse) is None


def test_checksums_are_in_the_form_of_sha256sum(get: Get, cache: Path) -> None:
    get(KEYS[0])
    done = subprocess.run(
        ["sha256sum", "-c", f"traces/{KEYS[0]}.npz.sha256"],
        cwd=cache,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == f"traces/{KEYS[0]}.npz: OK\n"


def test_an_entry_that_is_edited_with_its_checksum_has_another_one(get: Get, cache: Path) -> None:
    """So a dataset that was made with it is of another identity."""
    get(KEYS[0])
    name = f"traces/{KEYS[0]}.npz"
    before = read_checksum(name)
    (cache / name).write_bytes(b"edited")
    digest = hashlib.sha256(b"edited").hexdigest()
    (cache / f"{name}.sha256").write_text(f"{digest}  {name}\n")
    assert get(KEYS[0]) == b"edited"
    assert read_checksum(name) == digest != before


def age(cache: Path, key: str, hours: float) -> None:
    used = time.time() - 3600 * hours
    os.utime(cache / "traces" / f"{key}.npz.sha256", (used, used))


def test_entries_used_longest_ago_make_room(
    get: Get,
    built: list[str],
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    for number, key in enumerate(KEYS[:4]):
        get(key, bytes(999))
        age(cache, key, hours=10 - number)
    get(KEYS[0])  # used now
    monkeypatch.setenv("ADVERCITY_CACHE_SIZE", "3 kB")
    get(KEYS[4], bytes(999))
    assert [entry.path.name[0] for entry in list_entries()] == ["d", "a", "e"]
    assert "2 entries removed, 2.0 kB" in caplog.text
    assert not list(cache.glob("traces/b*"))
    # As if used before the clock was set back by half a day.
    age(cache, KEYS[3], hours=-12)
    assert prune_cache(2000).count == 1
    assert [entry.path.name[0] for entry in list_entries()] == ["a", "e"]
    # What was used within the hour may be in use: it stays, even beyond the limit.
    assert prune_cache(0).count == 0
    assert clear_cache().count == 2
    assert not any(path.is_file() for path in cache.rglob("*"))


def test_only_entries_and_abandoned_partial_files_are_removed(
    get: Get, cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    get(KEYS[0])
    get("mine")  # the name of a file of somebody, not of an entry
    ended = subprocess.Popen(["true"])
    ended.wait()
    looks_like_ours = (
        f"traces/{KEYS[1]}.npz",
        f"networks/{KEYS[1]}/road.net.xml",
        f"worlds/.partial-00000000-{ended.pid}-00000000-00000000/w.npz",
        f"traces/{KEYS[2]}.npz",
        f"traces/{KEYS[2]}.npz.sha256",
    )
    names = ("notes.txt", "traces/x.npz", "traces/.partial-x/y", *looks_like_ours)
    precious = [cache / name for name in names]
    for path in precious:
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text("mine")
    with open_partial_path(cache / "worlds" / "w.npz") as partial:
        partial.write_bytes(b"")
        machine = partial.parent.name.split("-")[1]
        (cache / "worlds" / format_partial_name(machine, ended.pid, "0" * 8)).mkdir()
        assert clear_cache().count == 1
        assert partial.parent.exists()
        assert len(list((cache / "worlds").iterdir())) == 2
    assert all(path.read_text() == "mine" for path in precious)
    assert (cache / "traces" / "mine.npz").exists()
    assert "files are no entries of this version, kept; delete them if none is yours" in caplog.text


@pytest.mark.parametrize("suffix", ["", ".sha256"])
def test_a_folder_in_place_of_an_entry_is_one_message_and_stays(
    suffix: str, get: Get, built: list[str], cache: Path
) -> None:
    get(KEYS[0])
    path = cache / "traces" / f"{KEYS[0]}.npz{suffix}"
    path.unlink()
    path.mkdir()
    (path / "notes.txt").write_text("mine")
    with pytest.raises(RunError, match=f"{path}: is a folder where the cache has a file; move it"):
        get(KEYS[0])
    assert built == ["a"]
    clear_cache()
    assert (path / "notes.txt").read_text() == "mine"


def test_an_entry_whose_checksum_is_a_device_counts_as_absent(
    get: Get, built: list[str], cache: Path
) -> None:
    get(KEYS[0])
    checksum = cache / "traces" / f"{KEYS[0]}.npz.sha256"
    checksum.unlink()
    checksum.symlink_to("/dev/zero")
    assert list_entries() == []
    assert get(KEYS[0]) == b"a data"
    assert built == ["a", "a"]
    assert len(list_entries()) == 1


def test_a_link_in_place_of_an_entry_is_replaced_and_its_target_stays(
    get: Get, built: list[str], cache: Path, tmp_path: Path
) -> None:
    get(KEYS[0])
    path, target = cache / "traces" / f"{KEYS[0]}.npz", tmp_path / "mine"
    target.write_text("mine")
    path.unlink()
    path.symlink_to(target)
    assert get(KEYS[0]) == b"a data"
    assert built == ["a", "a"]
    path.unlink()
    path.symlink_to(target)
    clear_cache()
    assert target.read_text() == "mine"


@pytest.mark.parametrize("name", ["traces", f"networks/{KEYS[0]}"])
def test_the_entries_in_a_linked_folder_stay_and_do_not_count(
    cache: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    def build(partial: Path) -> None:
        partial.write_bytes(bytes(2000))

    for entry in (f"traces/{KEYS[0]}.npz", f"networks/{KEYS[0]}/road.net.xml"):
        load_or_build_entry(entry, build, Path.read_bytes)
        os.utime(cache / f"{entry}.sha256", (0, 0))
    shared, folder = tmp_path / "shared", cache / name
    folder.rename(shared)
    folder.symlink_to(shared)
    (path,) = (path for path in shared.iterdir() if path.suffix != ".sha256")
    path.write_bytes(b"mine")
    assert prune_cache(2000).count == 0
    assert clear_cache().count == 1
    assert path.read_bytes() == b"mine"
    assert f"{folder}: is a link to {shared}, whose entries stay" in caplog.text
    assert "no entries of this version" not in caplog.text


def test_a_size_without_a_unit_is_refused_before_anything_is_built(
    get: Get, built: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_CACHE_SIZE", "10")
    with pytest.raises(InputError, match="ADVERCITY_CACHE_SIZE 10: not a positive number"):
        get(KEYS[0])
    assert built == []


def test_a_cache_that_cannot_be_written_is_one_message(get: Get, cache: Path) -> None:
    cache.write_text("")
    with pytest.raises(RunError, match=r"cannot be written: .*; set ADVERCITY_CACHE to a folder"):
        get(KEYS[0])


def test_the_commands_show_prune_and_clear(
    get: Get, cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: str) -> list[str]:
        monkeypatch.setattr("sys.argv", ["advercity", "cache", *arguments])
        with pytest.raises(SystemExit):
            main()
        return capsys.readouterr().out.splitlines()

    get(KEYS[0], bytes(1999))
    get(KEYS[1])
    age(cache, KEYS[0], hours=3)
    age(cache, KEYS[1], hours=2)
    lines = run("show")
    assert lines[0] == f"{cache}, limit 10.0 GB (ADVERCITY_CACHE_SIZE)"
    assert lines[3].split()[:4] == ["traces", "2", "2.0", "kB"]
    assert run("prune", "--size", "1 kB") == ["1 entry removed, 2.0 kB"]
    assert run("clear") == ["1 entry removed, 6 B"]
    assert list_entries() == []
