"""Processors agree on what decides a trace, to the last bit and before anything is rounded."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "other_rounding"
OTHER_PROCESSORS = {
    "with AVX-512": {"PYTHONPATH": f"{FOLDER}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
    "with Haswell's BLAS": {"OPENBLAS_CORETYPE": "Haswell"},
    "with Prescott's BLAS": {"OPENBLAS_CORETYPE": "Prescott"},
}
COMPUTE = """
import hashlib
import numpy as np
from advercity.roads.bend_speed import compute_bend_speeds
from advercity.traffic.motion_spline import interpolate_smoothly
from advercity.traffic.vehicle_motion import compute_vehicle_states
from advercity.traffic.walking_motion import compute_walker_states
from advercity.frames import FRONT_DTYPE

random = np.random.default_rng(5)
turns = np.cumsum(random.normal(0, 0.05, 400))
path = np.cumsum(np.exp(1j * turns))
track = np.zeros(400, FRONT_DTYPE)
track["tick"] = np.arange(400)
track["x"], track["y"] = path.real, path.imag
track["z"] = np.cumsum(random.normal(0, 0.02, 400))
track["yaw"], track["slope"] = turns, random.normal(0, 0.05, 400)
track["speed"] = 10 + 3 * random.random(400)
track["speed"][200:] /= 2
results = [
    compute_bend_speeds(np.stack([path.real, path.imag], axis=1)),
    compute_vehicle_states(track, 4.6, tick_s=0.1),
    compute_walker_states(
        track, 0.4, speed_m_s=12, tick_s=0.1, kerb_height=lambda at: np.zeros(len(at))
    ),
    interpolate_smoothly(np.cumsum(0.5 + random.random(400)), path, np.linspace(1, 150, 999)),
]
print([hashlib.sha256(result.tobytes()).hexdigest() for result in results])
"""


def compute(environment: dict[str, str]) -> str:
    ran = subprocess.run(
        [sys.executable, "-c", COMPUTE],
        env=os.environ | environment,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    return ran.stdout


@pytest.mark.parametrize("processor", OTHER_PROCESSORS)
def test_speeds_and_motions_are_the_same_bytes_on_another_processor(processor: str):
    assert compute(OTHER_PROCESSORS[processor]) == compute({})
