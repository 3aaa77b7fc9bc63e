"""Runs commands in this process."""

from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.cli import main
from advercity.compiler import write_specs


class Ran:
    """How a command ended."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


Command = Callable[..., Ran]


@pytest.fixture
def advercity(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs the command line in this process."""

    def run(*arguments: str | Path) -> Ran:
        monkeypatch.setattr("sys.argv", ["advercity", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        code = left.value.code
        return Ran(code if isinstance(code, int) else 0, captured.out, captured.err)

    return run


@pytest.fixture
def spec_file(specs: dict[str, Spec], tmp_path: Path) -> Path:
    """A compiled spec on disk."""
    write_specs([specs["rcnj_fog_day_sparse"]], tmp_path / "compiled")
    return tmp_path / "compiled" / "rcnj_fog_day_sparse.json"
