"""What was made by another program, or of other inputs, is never taken from the cache."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.digests import compute_source_digest
from advercity.pipeline import cache
from advercity.pipeline.cache import (
    compute_body_key,
    compute_road_key,
    compute_traffic_key,
    compute_world_key,
)

ComputeKey = Callable[[Spec], str]
EVERY_KEY = pytest.mark.parametrize(
    "compute_key", [compute_road_key, compute_world_key, compute_traffic_key]
)


@EVERY_KEY
def test_another_program_finds_no_entries(
    compute_key: ComputeKey, spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "some_program", raising=False)
    monkeypatch.setattr(cache, "TRAFFIC_CODE", ("some_program",))
    monkeypatch.setattr(cache, "WORLD_CODE", ("some_program",))
    source = tmp_path / "some_program.py"
    keys: set[str] = set()
    for text in ("ONE = 1\n", "ONE = 2\n"):
        source.write_text(text)
        compute_source_digest.cache_clear()
        keys.add(compute_key(spec))
    assert len(keys) == 2


@EVERY_KEY
def test_another_version_of_sumo_finds_no_entries(
    compute_key: ComputeKey, spec: Spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = compute_key(spec)
    monkeypatch.setattr(cache, "find_sumo_version", lambda: "0.0")
    assert compute_key(spec) != before


@EVERY_KEY
def test_another_order_of_a_mapping_finds_no_entries(compute_key: ComputeKey, spec: Spec) -> None:
    """Streets and blueprints are drawn in their order."""
    streets = dict(reversed(spec.road.streets.items()))
    road = spec.road.model_copy(update={"streets": streets})
    blueprints = dict(reversed(spec.blueprints.items()))
    other = spec.model_copy(update={"road": road, "blueprints": blueprints})
    assert other == spec
    assert compute_key(other) != compute_key(spec)


def test_a_body_is_that_of_its_name_its_blueprint_and_its_model(spec: Spec) -> None:
    one, other, *_ = spec.blueprints
    longer = spec.blueprints[one].model_copy(update={"length_m": 9.0})
    changed = spec.model_copy(update={"blueprints": {one: longer, other: spec.blueprints[one]}})
    modelled = spec.model_copy(update={"assets": {f"model/{one}": "0" * 64}})
    keys = {compute_body_key(item, one) for item in (spec, changed, modelled)}
    assert len(keys | {compute_body_key(changed, other)}) == 4
    moved = spec.model_copy(update={"road": spec.road.model_copy(update={"id": "other"})})
    assert compute_body_key(moved, one) == compute_body_key(spec, one)


def test_a_trace_is_that_of_its_seed_and_not_of_its_weather(spec: Spec) -> None:
    reseeded = spec.seeds.model_copy(update={"traffic": spec.seeds.traffic + 1})
    assert compute_traffic_key(spec.model_copy(update={"seeds": reseeded})) != (
        compute_traffic_key(spec)
    )
    resensed = spec.seeds.model_copy(update={"sensors": spec.seeds.sensors + 1})
    assert compute_traffic_key(spec.model_copy(update={"seeds": resensed})) == (
        compute_traffic_key(spec)
    )
