"""Runs commands in this process."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from advercity.cli import main


class Ran(NamedTuple):
    """How a command ended: exit code, data and messages."""

    code: int
    out: str
    err: str


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
