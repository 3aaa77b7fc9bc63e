"""A spec that was edited after it was compiled is reported, and not taken for its compiler's."""

import functools
import json
from pathlib import Path
from typing import Any

import pytest
from advercity_dsl import Spec

from advercity.compiler import (
    find_weather,
    is_edited,
    read_spec,
    validate_paths,
    with_weather,
    write_specs,
)
from advercity.digests import compute_json_digest
from advercity.errors import InputError
from advercity.testing import with_small_sensors


@pytest.fixture
def path(specs: dict[str, Spec], tmp_path: Path) -> Path:
    """A compiled spec on disk."""
    spec = specs["ri_fog_day_sparse"]
    write_specs([spec], tmp_path)
    return tmp_path / f"{spec.id}.json"


def edit(path: Path, *keys: str, value: Any) -> None:
    """Changes one value of a JSON file."""
    data = json.loads(path.read_text())
    inner = data
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    path.write_text(json.dumps(data))


def test_the_committed_specs_are_as_compiled() -> None:
    folder = Path(__file__).parents[2] / "compiled"
    edited = [
        path.name for path in sorted(folder.glob("*.json"))[::5] if is_edited(read_spec(path))
    ]
    assert edited == []


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("weather", "fog", "mor_m"), 76.0),
        (("seeds", "sensors"), 2),
        (("provenance", "suite"), "mine"),
        (("provenance", "digest"), "0" * 64),
        (("assets",), {"model/seat_leon": "0" * 64}),
    ],
)
def test_any_edited_value_is_reported(path: Path, keys: tuple[str, ...], value: Any) -> None:
    validate_paths(path)
    edit(path, *keys, value=value)
    with pytest.raises(InputError, match=r"ri_fog_day_sparse\.json: was edited after.*compile"):
        validate_paths(path)


def test_another_layout_of_the_same_values_is_no_edit(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()), indent=4, ensure_ascii=True))
    validate_paths(path)


@pytest.mark.parametrize("keys", [("blueprints",), ("road", "streets")])
def test_another_order_of_what_is_drawn_is_an_edit(path: Path, keys: tuple[str, ...]) -> None:
    """Blueprints and streets are drawn in their order: the traffic would be other."""
    data = json.loads(path.read_text())
    mapping = functools.reduce(dict.__getitem__, keys, data)
    first = next(iter(mapping))
    mapping[first] = mapping.pop(first)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="was edited after"):
        validate_paths(path)


def test_what_is_derived_is_not_edited_unless_it_is_derived_from_an_edited_spec(
    path: Path,
) -> None:
    spec, weather = read_spec(path), find_weather("heavy_rain_night")
    assert not is_edited(with_weather(spec, weather))
    assert not is_edited(with_small_sensors(spec))
    edited = spec.model_copy(update={"timing": spec.timing.model_copy(update={"max_ticks": 99})})
    assert is_edited(edited)
    assert is_edited(with_weather(edited, weather))


def test_the_file_of_an_earlier_version_without_a_later_field_is_as_compiled(path: Path) -> None:
    """Its digest was computed before the field existed."""
    data = json.loads(path.read_text())
    del data["provenance"]["sweep"]
    del data["provenance"]["digest"]
    data["provenance"]["digest"] = compute_json_digest(data)
    path.write_text(json.dumps(data))
    assert read_spec(path).provenance.sweep is None
    validate_paths(path)
