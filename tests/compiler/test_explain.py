from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import (
    compare_specs,
    explain_spec,
    load_library,
)
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from tests.builders import SMALL_LIBRARY, Compile, write_small_library


def test_every_value_of_a_spec_is_explained(library: Path, specs: dict[str, Spec]) -> None:
    spec = specs["ui_glare_day_sparse"]
    origins = {item.path: item.text for item in explain_spec(spec, load_library(library))}
    sun = (library / "nhtsa" / "weather" / "glare_day.yaml").read_text().splitlines()
    place = origins["weather.sun.elevation_deg"].split("glare_day.yaml:")[1]
    line, column = map(int, place.split(":"))
    assert sun[line - 1][column - 1 :].startswith(f"{spec.weather.sun.elevation_deg:g},")
    assert origins["weather.fog.mor_m"] == "default"
    assert origins["demand.vehicles"].startswith("rule: ")
    assert all(origins.values())


def test_a_sun_by_time_is_explained_by_the_instant(tmp_path: Path) -> None:
    weather = "kind: weather\nid: clear\ntime: day\nsun: {at: AT, lat_deg: 40, lon_deg: -3.7}\n"
    noon = weather.replace("AT", "2025-06-21T12:00 Europe/Madrid")
    path = write_small_library(tmp_path / "library", weather=noon)
    spec, *_ = compile_library(path)
    origins = {item.path: item.text for item in explain_spec(spec, load_library(path))}
    for field in ("elevation_deg", "azimuth_deg"):
        told = origins[f"weather.sun.{field}"]
        assert told == f"rule: of 2025-06-21 10:00 UTC, {path}/weather.yaml:4:11"


def test_a_changed_library_is_rejected_as_the_origin(
    compile_small: Compile, specs: dict[str, Spec], tmp_path: Path
) -> None:
    compile_small()
    with pytest.raises(InputError, match="is not in this library; compile"):
        explain_spec(specs["ui_fog_day_sparse"], load_library(tmp_path / "library"))


def test_specs_are_compared_by_meaning(specs: dict[str, Spec]) -> None:
    changes = compare_specs(specs["ui_fog_day_sparse"], specs["ui_fog_day_dense"])
    assert ("demand.vehicles", 48, 128) in changes
    assert not any(path.startswith("weather") for path, _, _ in changes)
    road = {path for path, _, _ in changes if path.startswith("road")}
    # Lights turn red as the runner comes, at another time in other traffic.
    assert road == {"road.junctions.j_main.signals.elapsed_s"}


@pytest.mark.parametrize(
    ("more", "origin"),
    [("bodies: {cav1: saloon}\n", "suite.yaml:5:16"), ("", "catalogue.yaml:3:6")],
)
def test_the_body_of_an_agent_comes_from_the_suite_or_else_from_the_catalogue(
    compile_small: Compile, tmp_path: Path, more: str, origin: str
) -> None:
    suite = (SMALL_LIBRARY / "suite.yaml").read_text()
    (spec,) = compile_small(suite=suite + more).values()
    library = load_library(tmp_path / "library")
    origins = {item.path: item.text for item in explain_spec(spec, library)}
    assert origins["agents.0.blueprint"].endswith(origin)
