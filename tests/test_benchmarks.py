"""The common form of what benchmarks find."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """Prints a table of three figures and ends as benchmarks do."""
    path = tmp_path / "script.py"
    path.write_text(
        "import sys\n"
        f"sys.path.insert(0, {str(BENCHMARKS)!r})\n"
        "from figures import Figure, finish\n"
        "sys.exit(finish([Figure('fast', 2.0, 'a peer', at_most=2.5),\n"
        "    Figure('known', 0.12345, 'all'),\n"
        "    Figure('slow', float(sys.argv[1]), 'a peer', at_least=0.5)]))\n"
    )
    return path


@pytest.mark.parametrize(("value", "verdict", "code"), [("0.6", "holds", 0), ("0.4", "FAILS", 1)])
def test_a_benchmark_says_which_of_its_figures_are_as_wanted(
    script: Path, value: str, verdict: str, code: int
) -> None:
    child = subprocess.run(
        [sys.executable, str(script), value], capture_output=True, text=True, check=False
    )
    assert child.stdout.splitlines()[2:] == [
        "| fast | 2 | a peer | at most 2.5 | holds |",
        "| known | 0.123 | all |  |  |",
        f"| slow | {value} | a peer | at least 0.5 | {verdict} |",
    ]
    assert child.returncode == code
