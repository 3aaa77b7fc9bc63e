"""The common form of benchmarks, and the program that runs them all."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """A script that prints a table of three values, as benchmarks do."""
    path = tmp_path / "script.py"
    path.write_text(
        "import sys\n"
        f"sys.path.insert(0, {str(BENCHMARKS)!r})\n"
        "from measurement import Measurement, format_table\n"
        "print(format_table([Measurement('fast', 2.0, 'a peer', at_most=2.5),\n"
        "    Measurement('known', 0.12345, 'all'),\n"
        "    Measurement('slow', float(sys.argv[1]), 'a peer', at_least=0.5)]))\n"
    )
    return path


@pytest.mark.parametrize(("value", "verdict"), [("0.6", "met"), ("0.4", "MISSED")])
def test_a_table_shows_which_values_meet_their_goals(
    script: Path, value: str, verdict: str
) -> None:
    child = subprocess.run(
        [sys.executable, str(script), value], capture_output=True, text=True, check=True
    )
    assert child.stdout.splitlines()[2:] == [
        "| fast | 2 | a peer | at most 2.5 | met |",
        "| known | 0.123 | all |  |  |",
        f"| slow | {value} | a peer | at least 0.5 | {verdict} |",
    ]


def run_bench(folder: Path, body: str) -> subprocess.CompletedProcess[str]:
    """Run all benchmarks, of which there is one, in a copy of the folder."""
    for name in ("bench.py", "measurement.py"):
        (folder / name).write_text((BENCHMARKS / name).read_text())
    (folder / "only.py").write_text(
        f"from measurement import Measurement\ndef run_benchmark(*, quick):\n    {body}\n"
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
def test_a_missed_goal_is_marked_and_is_no_failure(tmp_path: Path) -> None:
    child = run_bench(tmp_path, "return [Measurement('slow', 0.4, 'a peer', at_least=0.5)]")
    assert child.returncode == 0, child.stderr
    assert "| slow | 0.4 | a peer | at least 0.5 | MISSED |" in child.stdout
    (row,) = json.loads((tmp_path / "out.json").read_text())["figures"]
    assert (row["value"], row["holds"]) == (0.4, False)


@pytest.mark.render
def test_a_failed_benchmark_is_named_and_fails_the_program(tmp_path: Path) -> None:
    child = run_bench(tmp_path, "raise RuntimeError('no such peer')")
    assert child.returncode == 1
    assert "only FAILED" in child.stdout
    assert "no such peer" in child.stderr


def test_every_benchmark_and_every_stage_of_a_frame_exists() -> None:
    code = (
        "import bench, frame, importlib\n"
        "for name in bench.NAMES: importlib.import_module(name).run_benchmark\n"
        "for calls in frame.STAGES.values():\n"
        "    for owner, name in calls: getattr(owner, name)\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=BENCHMARKS, check=True)
