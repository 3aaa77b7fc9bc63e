import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SLOW = {
    *("add_a_body", "add_a_road", "first_snow_scenario", "import_your_town", "make_the_whole_set"),
    "change_length_rate_and_numbers",
    *(
        "replay_recorded_traffic",
        "run_on_a_cluster",
        "write_a_channel",
        "write_a_rig",
        "write_a_suite",
        "write_a_typology",
        "write_traffic",
        "write_weather",
    ),
}
GUIDES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else [])
    for path in sorted((ROOT / "docs" / "guides").glob("*.md"))
]
BLOCK = re.compile(r"^```(bash|python|toml|yaml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

pytestmark = [pytest.mark.render, pytest.mark.sumo]


@pytest.mark.parametrize("guide", GUIDES)
def test_a_guide_does_what_it_says(guide: Path, tmp_path: Path) -> None:
    """Blocks are written to the file that their first line names; those in bash are run."""
    shutil.copytree(ROOT / "library", tmp_path / "library")
    with (tmp_path / "library/nhtsa/suites/adver_city.yaml").open("a") as suite:
        suite.write("looks: shaped  # runs without the asset package\n")
    scripts = Path(sys.executable).parent
    environment = {
        **os.environ,
        "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
        "ADVERCITY_DATA": str(tmp_path / "data"),
    }
    ran = 0
    for language, text in BLOCK.findall(guide.read_text()):
        if language != "bash":
            path = tmp_path / text.splitlines()[0].removeprefix("# ")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            continue
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", text],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{text}\n{done.stderr}"
        ran += 1
    assert ran > 0


def test_the_road_of_the_guide_takes_less_than_forty_lines() -> None:
    guide = (ROOT / "docs" / "guides" / "add_a_road.md").read_text()
    road, _ = [text for language, text in BLOCK.findall(guide) if language == "yaml"]
    assert len(road.splitlines()) < 40
