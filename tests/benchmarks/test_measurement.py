"""The common form of what benchmarks find."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """Prints a table of three figures, as benchmarks do."""
    path = tmp_path / "script.py"
    path.write_text(
        "import sys\n"
        f"sys.path.insert(0, {str(BENCHMARKS)!r})\n"
        "from measurement import Figure, table\n"
        "print(table([Figure('fast', 2.0, 'a peer', at_most=2.5),\n"
        "    Figure('known', 0.12345, 'all'),\n"
        "    Figure('slow', float(sys.argv[1]), 'a peer', at_least=0.5)]))\n"
    )
    return path


@pytest.mark.parametrize(("value", "verdict"), [("0.6", "holds"), ("0.4", "MISSED")])
def test_a_benchmark_says_which_of_its_figures_are_as_wanted(
    script: Path, value: str, verdict: str
) -> None:
    child = subprocess.run(
        [sys.executable, str(script), value], capture_output=True, text=True, check=True
    )
    assert child.stdout.splitlines()[2:] == [
        "| fast | 2 | a peer | at most 2.5 | holds |",
        "| known | 0.123 | all |  |  |",
        f"| slow | {value} | a peer | at least 0.5 | {verdict} |",
    ]


def benched(folder: Path, body: str) -> subprocess.CompletedProcess[str]:
    """All benchmarks, which are one, in a copy of the folder."""
    for name in ("bench.py", "figures.py"):
        (folder / name).write_text((BENCHMARKS / name).read_text())
    (folder / "only.py").write_text(
        f"from measurement import Figure\ndef figures(*, quick):\n    {body}\n"
    )
    bench = (folder / "bench.py").read_text()
    (folder / "bench.py").write_text(
        re.sub(r"NAMES = \[.*?\]", "NAMES = ['only']", bench, flags=re.DOTALL)
    )
    return subprocess.run(
        [sys.executable, str(folder / "bench.py"), "--output", str(folder / "out")],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.render
def test_a_missed_goal_is_told_and_is_no_failure(tmp_path: Path) -> None:
    child = benched(tmp_path, "return [Figure('slow', 0.4, 'a peer', at_least=0.5)]")
    assert child.returncode == 0, child.stderr
    assert "| slow | 0.4 | a peer | at least 0.5 | MISSED |" in child.stdout
    (row,) = json.loads((tmp_path / "out.json").read_text())["figures"]
    assert (row["value"], row["holds"]) == (0.4, False)


@pytest.mark.render
def test_a_broken_benchmark_is_a_failure_and_named(tmp_path: Path) -> None:
    child = benched(tmp_path, "raise RuntimeError('no such peer')")
    assert child.returncode == 1
    assert "only broke" in child.stdout
    assert "no such peer" in child.stderr
