"""Fixtures that many tests share."""

from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec
from hypothesis import settings

from advercity.frames import Trace
from advercity.pipeline.cache import compute_traffic_key
from advercity.pipeline.preparation import load_or_simulate_traffic

pytest_plugins = ["tests.bend_network", "tests.builders", "tests.command_line"]

ROOT = Path(__file__).parent.parent

# How long an example takes says more about the machine than about the result.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


OLDER_PROCESSOR = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Environment in which glibc, NumPy and OpenBLAS compute as without AVX2 and FMA."""


@pytest.fixture
def older_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let child processes compute as on an older processor."""
    for name, value in OLDER_PROCESSOR.items():
        monkeypatch.setenv(name, value)


@pytest.fixture(scope="session")
def library() -> Path:
    """The library that ships with the project."""
    return ROOT / "library"


@pytest.fixture(scope="session")
def simulate() -> Callable[[Spec], Trace]:
    """Returns the trace of a spec, simulated once for all tests, in whichever process they run."""
    traces: dict[str, Trace] = {}

    def load_trace(spec: Spec) -> Trace:
        key = compute_traffic_key(spec)
        if key not in traces:
            traces[key] = load_or_simulate_traffic(spec).trace
        return traces[key]

    return load_trace
