"""Mistakes of authors, each with the diagnostics that the compiler prints.

A case is a file, or a folder of files, copied into the small library; the text next to it is the
whole output. `python tests/compiler/test_diagnostics.py` writes all texts again, for review.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import pytest

from advercity.compiler.crossing import compile_library
from advercity.errors import InputError

FOLDER = Path(__file__).parent
CASES = sorted(path for path in (FOLDER / "cases").iterdir() if path.suffix != ".txt")


def compile_case(case: Path, folder: Path) -> str:
    shutil.copytree(FOLDER / "base", folder)
    if case.is_dir():
        shutil.copytree(case, folder, dirs_exist_ok=True)
    else:
        shutil.copy(case, folder)
    try:
        specs = compile_library(folder)
    except InputError as error:
        return str(error).replace(f"{folder}/", "") + "\n"
    raise AssertionError(f"{case.name} compiles to {[spec.id for spec in specs]}")


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_a_mistake_is_reported_with_position_and_hint(case: Path, tmp_path: Path) -> None:
    expected = case.with_suffix(".txt").read_text(encoding="utf-8")
    assert compile_case(case, tmp_path / "library") == expected


def test_every_text_has_a_case() -> None:
    texts = {path.stem for path in (FOLDER / "cases").glob("*.txt")}
    assert texts == {path.stem for path in CASES}


def write_texts() -> None:
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder:
            text = compile_case(case, Path(folder) / "library")
        case.with_suffix(".txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(write_texts())
