"""The loaders themselves, where `OPENCOOD_PYTHON` names the interpreter that has one of them."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import find_weather, with_weather
from advercity.pipeline import RunOptions, run_scenario

PYTHON = os.environ.get("OPENCOOD_PYTHON", "")
HINT = "OpenCOOD's own loader is not tested; OPENCOOD_PYTHON names an interpreter that has it"
READER = Path(__file__).with_name("opencood_boxes.py")


@pytest.mark.render
@pytest.mark.sumo
@pytest.mark.skipif(not PYTHON, reason=HINT)
def test_opencood_and_heal_find_points_in_the_boxes_they_read(
    specs: dict[str, Spec], tmp_path: Path
) -> None:
    """In clear air; a box with few points is one far off or behind others."""
    spec = with_weather(specs["rcnj_fog_day_dense"], find_weather("clear_day"))
    frames = slice(0, 2)
    run_scenario(spec, RunOptions(output=tmp_path, profile="preview", scale=0.2, frames=frames))
    told = subprocess.run(
        [PYTHON, READER, tmp_path], capture_output=True, text=True, check=True
    ).stdout
    samples = [json.loads(line) for line in told.splitlines() if line.startswith("[")]
    assert len(samples) >= 2
    for points in samples:
        assert len(points) >= 5
        assert min(points) > 0
        assert max(points) > 1000
