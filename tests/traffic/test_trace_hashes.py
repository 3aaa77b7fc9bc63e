"""Machines agree on every trace: their checksums are those of `scripts/trace_hashes.py`."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.frames import Trace

HASHES: dict[str, str] = json.loads(
    (Path(__file__).parents[1] / "data" / "trace_hashes.json").read_text()
)


def test_every_trace_of_the_shipped_scenarios_has_a_checksum(specs: dict[str, Spec]):
    assert sorted(HASHES) == sorted(name for name in specs if "clear_day" in name)


@pytest.mark.sumo
@pytest.mark.parametrize("name", HASHES)
def test_this_machine_simulates_the_same_traces_as_others(
    name: str, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    assert simulate(specs[name]).compute_sha256() == HASHES[name]
