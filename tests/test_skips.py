"""Tests that are skipped say what to install for them."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_skips_are_listed_at_the_end_with_what_installs_what_they_lack(tmp_path: Path) -> None:
    for name in ("av", "playwright", "ray"):
        (tmp_path / f"{name}.py").write_text("raise ModuleNotFoundError(f'no {__name__}')\n")
    files = [
        "tests/test_media.py",
        "tests/pipeline/test_cluster.py",
        "tests/viewer/test_web_viewer.py",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-m", "", *files, "-k", "video or loses or viewer"],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]),
        },
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert Path.home().is_dir(), "the home of the tests, which is not that run's to delete"
    skips = [line for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    assert len(skips) >= 3, done.stdout
    assert all("`make setup`" in line or "`scripts/setup_peers`" in line for line in skips), skips
    assert {"av", "ray"} <= {word.rstrip(";") for line in skips for word in line.split()}
