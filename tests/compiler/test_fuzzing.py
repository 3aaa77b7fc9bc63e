import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parent.parent.parent
BATCHES = 20


def mutations() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "fuzz_declarations", ROOT / "benchmarks" / "fuzz_declarations.py"
    )
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("batch", range(BATCHES))
def test_damaged_files_are_read_whole_or_told_about(batch: int, tmp_path: Path) -> None:
    outcome = mutations().outcome
    for number in range(batch, 400, BATCHES):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert outcome(number, 2, folder) in ("read", "told")
