"""Damages declarations and specs at random, as `benchmarks/fuzz.py` does by the thousand."""

from pathlib import Path

import pytest

from benchmarks.fuzz_declarations import check_declaration, check_spec

BATCHES = 20


@pytest.mark.parametrize("batch", range(BATCHES))
def test_damaged_files_are_read_or_refused_with_a_message(batch: int, tmp_path: Path) -> None:
    for number in range(batch, 400, BATCHES):
        folder = tmp_path / str(number)
        folder.mkdir()
        check = check_spec if number % 4 == 0 else check_declaration
        assert check(number, 2, folder) in ("read", "refused")
