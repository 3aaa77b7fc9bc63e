"""Parts of the weather of other distributions, as an installation with such a one has them."""

from pathlib import Path

import pytest

from tests.dsl.test_sensor_kinds import install, run

MODULE = """
from advercity_dsl.weather_components import Visibility, WeatherComponent
from advercity_dsl.weather_part import WeatherPart

class Smoke(WeatherComponent):
    \"\"\"Smoke of fires.\"\"\"

    mor_m: Visibility = None
    \"\"\"Visibility by the smoke alone.\"\"\"

PART = WeatherPart("smoke", Smoke, "smoke:PHYSICS", colour=(90, 90, 90), point_kind=70)
"""
GROUP = "advercity.weather_parts"
WEATHER = "import advercity_dsl as d; build = lambda **more: d.Weather(id='a', time='day', **more);"


def install_smoke(folder: Path, module: str = MODULE, **entries: str) -> None:
    install(folder, name="smoke", module=module, group=GROUP, **entries or {"smoke": "smoke:PART"})


@pytest.mark.parametrize("first", ["import smoke", "import advercity_dsl"])
def test_weathers_and_keyframes_have_the_key_whichever_is_imported_first(
    tmp_path: Path, first: str
) -> None:
    """Extinction is interpolated: half way from 1000 m to 100 m is 2 / (1/1000 + 1/100) = 182 m."""
    install_smoke(tmp_path)
    code = f"{first}; {WEATHER} later = dict(at_s=10, smoke=dict(mor_m=100));"
    code += "made = build(smoke=dict(mor_m=1000), keyframes=[later]); print(made.at(5).smoke.mor_m)"
    assert float(run(tmp_path, code)) == pytest.approx(181.82, abs=0.01)


def test_weathers_without_the_part_do_not_mention_it(tmp_path: Path) -> None:
    install_smoke(tmp_path)
    code = f"{WEATHER} print('smoke' in build(keyframes=[dict(at_s=1)]).model_dump_json())"
    code = code.replace("dict(at_s=1)", "dict(at_s=1, rain=dict(rate_mm_h=1))")
    assert run(tmp_path, code) == "False"


def test_the_schema_describes_the_part(tmp_path: Path) -> None:
    install_smoke(tmp_path)
    code = "from advercity.compiler.schema import build_schema; found = build_schema('weather');"
    code += "smoke = found['$defs']['Smoke']; print(smoke['properties']['mor_m']['description'])"
    assert run(tmp_path, code) == "Visibility by the smoke alone."


@pytest.mark.parametrize(
    ("module", "entries", "reason"),
    [
        (MODULE.replace("(WeatherComponent)", ""), {}, "not derived from WeatherComponent"),
        (MODULE, {"fire": "smoke:PART"}, "is no WeatherPart with the name 'fire'"),
        (MODULE, {"rain": "smoke:PART"}, "the name is claimed by advercity, smoke:PART"),
        (MODULE.replace("70", "63"), {}, "point_kind is 63; choose one from 64 to 255"),
        (MODULE.replace(", point_kind=70", ""), {}, "point_kind is None; choose one"),
    ],
)
def test_a_part_that_cannot_be_used_leaves_all_others(
    tmp_path: Path, module: str, entries: dict[str, str], reason: str
) -> None:
    install_smoke(tmp_path, module, **entries)
    code = "from advercity_dsl.weather_parts import CORE_PARTS, load_weather_parts as load;"
    printed = run(tmp_path, f"{code} print(load().found == CORE_PARTS, *load().broken.values())")
    assert printed.startswith("True ")
    assert reason in printed


def test_two_parts_cannot_have_the_same_points(tmp_path: Path) -> None:
    soot = 'SOOT = WeatherPart("soot", Smoke, "smoke:PHYSICS", (0, 0, 0), 70)\n'
    install_smoke(tmp_path, MODULE + soot, smoke="smoke:PART", soot="smoke:SOOT")
    code = "from advercity_dsl.weather_parts import load_weather_parts as load; found = load();"
    printed = run(tmp_path, f"{code} print('smoke' in found.found, *found.broken.values())")
    assert printed == "True point_kind 70 belongs to 'smoke' already"
