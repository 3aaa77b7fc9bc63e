import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parent.parent.parent
BATCHES = 20


def load_script() -> ModuleType:
    script = ROOT / "benchmarks" / "fuzz_declarations.py"
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("batch", range(BATCHES))
def test_damaged_files_are_read_or_rejected_with_a_message(batch: int, tmp_path: Path) -> None:
    check_mutation = load_script().check_mutation
    for number in range(batch, 400, BATCHES):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert check_mutation(number, 2, folder) in ("read", "rejected")
