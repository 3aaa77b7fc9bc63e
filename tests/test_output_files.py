"""Files that users ask for replace only what the program wrote."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from advercity.data_folder import find_data_folder
from advercity.errors import InputError
from advercity.output_files import RECORD_FILE, open_output, open_output_folder, write_output

REFUSAL = "exists, and there is no record that advercity wrote it as it is; rename or delete it"


def test_an_earlier_output_is_replaced_until_it_is_changed(tmp_path: Path) -> None:
    path = tmp_path / "new" / "table.csv"
    write_output(path, b"1\n")
    write_output(path, b"2\n")
    assert path.read_bytes() == b"2\n"
    path.write_bytes(b"2\nmine\n")
    with pytest.raises(InputError, match=REFUSAL):
        write_output(path, b"3\n")
    assert path.read_bytes() == b"2\nmine\n"
    assert list(path.parent.iterdir()) == [path]


def test_a_file_is_known_in_another_process_until_it_is_renamed(tmp_path: Path) -> None:
    write_output(tmp_path / "a", b"first")
    code = "from pathlib import Path; from advercity.output_files import write_output as write\n"
    code += f"write(Path({str(tmp_path / 'a')!r}), b'second')"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "a").read_bytes() == b"second"
    (tmp_path / "a").rename(tmp_path / "b")
    with pytest.raises(InputError, match="no record that advercity wrote it"):
        write_output(tmp_path / "b", b"third")


def test_equal_content_is_no_loss(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"from another machine")
    write_output(tmp_path / "a", b"from another machine")
    assert (tmp_path / "a").read_bytes() == b"from another machine"


def test_an_output_that_would_be_refused_is_so_before_it_is_made(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    made: list[Path] = []
    with pytest.raises(InputError, match=REFUSAL), open_output(tmp_path / "a") as partial:
        made.append(partial)
    assert not made


def test_the_files_of_a_folder_are_written_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "b").write_text("mine")
    message = f"{tmp_path / 'b'}: {REFUSAL}"
    with pytest.raises(InputError, match=message), open_output_folder(tmp_path) as folder:
        for name in "abc":
            (folder / name).write_text("ours")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"b": "mine"}


@pytest.mark.parametrize("kind", ["link", "broken link", "fifo", "folder"])
def test_what_is_no_file_is_neither_replaced_nor_followed(tmp_path: Path, kind: str) -> None:
    target, path = tmp_path / "target", tmp_path / "output.png"
    if kind == "link":
        write_output(target, b"of ours, and linked on purpose")
    if kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.symlink_to(target)
    before = sorted((one.name, one.lstat().st_ino) for one in tmp_path.iterdir())
    with pytest.raises(InputError, match=r"output\.png: (exists|is a folder)"):
        write_output(path, b"new")
    assert sorted((one.name, one.lstat().st_ino) for one in tmp_path.iterdir()) == before


def test_a_damaged_record_knows_no_file_and_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path / "data"))
    write_output(tmp_path / "a", b"1")
    (find_data_folder() / RECORD_FILE).write_bytes(b"\xff\0damage\n")
    with pytest.raises(InputError, match=REFUSAL):
        write_output(tmp_path / "a", b"2")
    write_output(tmp_path / "b", b"3")
    write_output(tmp_path / "b", b"4")


def test_without_a_folder_for_the_record_outputs_are_written_and_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path / "file"))
    write_output(tmp_path / "a", b"1")
    with pytest.raises(InputError, match=REFUSAL):
        write_output(tmp_path / "a", b"2")
    assert (tmp_path / "a").read_bytes() == b"1"


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path) -> None:
    code = "import os; from pathlib import Path; from advercity.output_files import open_output\n"
    code += f"with open_output(Path({str(tmp_path / 'a')!r})) as path: path.touch(); os._exit(9)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    (left,) = tmp_path.iterdir()
    write_output(tmp_path / "b", b"")
    assert not left.exists()


def test_a_file_of_the_user_with_the_same_content_as_an_output_is_not_replaced(
    tmp_path: Path,
) -> None:
    mine = tmp_path / "mine" / "map.xodr"
    mine.parent.mkdir()
    mine.write_bytes(b"a map")
    write_output(tmp_path / "map.xodr", b"a map")
    with pytest.raises(InputError, match="no record that advercity wrote it"):
        write_output(mine, b"another map")
    write_output(mine, b"a map")
    with pytest.raises(InputError, match="no record that advercity wrote it"):
        write_output(mine, b"another map")
    assert mine.read_bytes() == b"a map"
