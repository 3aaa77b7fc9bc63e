"""Tables of the docs say what the code, the library and the specs say now."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import LidarModel, Spec, Suite, Weather
from advercity_dsl.inertial import IMU_GRADES
from advercity_dsl.lens import BrownConradyLens, KannalaBrandtLens
from advercity_dsl.lidar import LidarReceiver

from advercity.compiler import compile_library
from advercity.conflicts.report import (
    build_table_rows,
    build_traffic_report,
    format_markdown_table,
)
from advercity.exports.registry import load_export_formats
from advercity.frames import Trace
from advercity.rendering.led_flicker import SIGNAL_DUTY, SIGNAL_HZ, TAIL_DUTY, TAIL_HZ_RANGE
from advercity.sensors.measurements import PointKind
from tests.shipped import LIBRARY

ROOT = Path(__file__).parents[2]
Table = list[dict[str, str]]
TRACES = sorted(path.stem for path in ROOT.glob("compiled/*_clear_day_*.json"))


def read_tables(page: str) -> list[Table]:
    """The tables of a page, each a list of rows by head."""
    return parse_tables((ROOT / page).read_text())


def parse_tables(text: str) -> list[Table]:
    """The tables of a text."""
    blocks = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    tables: list[Table] = []
    for block in blocks:
        heads, _, *rows = (
            [cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()
        )
        tables.append([dict(zip(heads, row, strict=False)) for row in rows])
    return tables


def find_table(page: str, head: str) -> Table:
    """The first table of a page that has a head."""
    return next(table for table in read_tables(page) if table and head in table[0])


def list_names(page: str, head: str) -> list[str]:
    """The names in backticks of a column."""
    return [name for row in find_table(page, head) for name in re.findall(r"`([^`]+)`", row[head])]


def first(text: str) -> float:
    """The first number of a cell."""
    return float(re.findall(r"-?[\d.]+", text.replace(",", ""))[0])


# -- traffic


@pytest.mark.sumo
@pytest.mark.parametrize("name", TRACES)
def test_the_page_of_the_scenarios_has_what_is_measured(
    name: str, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
) -> None:
    report = build_traffic_report(specs[name], simulate(specs[name]), "")
    page = (ROOT / "docs" / "scenarios.md").read_text()
    *rows, _, _ = format_markdown_table([report]).splitlines()[2:]
    assert len(rows) == len(build_table_rows([report]))
    assert [row for row in page.splitlines() if row.startswith(f"| {name} |")] == rows


def test_the_page_of_the_scenarios_has_ten_traces_and_their_means() -> None:
    (table,) = read_tables("docs/scenarios.md")
    *rows, mean, _ = table
    # A scenario has a row for each of its conflicts.
    scenarios = {row["scenario"]: row for row in rows}
    assert [*scenarios] == TRACES
    for head in ("frames", "vehicles", "people"):
        values = [float(row[head]) for row in scenarios.values()]
        assert float(mean[head]) == pytest.approx(sum(values) / len(values), abs=0.051)


@pytest.mark.parametrize("suite", ["conflicts", "unsignalised", "crashes"])
def test_pages_of_suites_have_every_scenario_with_the_conflict_that_it_stages(suite: str) -> None:
    staged = {
        (spec.id, one.conflict, one.stages[0])
        for spec in compile_library(ROOT / "library", suite=suite)
        if "_clear_day_" in spec.id
        for one in spec.conflicts
    }
    page = (ROOT / "docs" / "conflicts.md").read_text()
    _, after = page.split(f"--suite {suite} --output", 1)
    rows = [row for row in parse_tables(after)[0] if row["scenario"] not in ("mean", "count")]
    found = {(row["scenario"], row["conflict"], row["NHTSA type"]) for row in rows}
    assert staged == found


def test_commands_before_tables_of_traffic_make_them() -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        import doc_tables  # pyright: ignore[reportMissingImports]
    finally:
        sys.path.pop(0)
    made = {
        page: [block["command"] for block in doc_tables.BLOCK.finditer((ROOT / page).read_text())]
        for page in ("docs/scenarios.md", "docs/conflicts.md")
    }
    assert {page: len(found) for page, found in made.items()} == {
        "docs/scenarios.md": 1,
        "docs/conflicts.md": 3,
    }
    assert doc_tables.make_table("echo no row; echo '| a |'") == "| a |\n"


@pytest.mark.parametrize("page", ["conflicts", "benchmark", "backends"])
def test_tables_that_take_hours_say_at_which_revision_they_were_measured(page: str) -> None:
    text = (ROOT / "docs" / f"{page}.md").read_text()
    assert re.search(r"at revision `[0-9a-f]{8}`", text)


# -- sensors


def test_the_table_of_lidars_has_the_figures_of_their_files() -> None:
    models = LIBRARY.get_declarations(LidarModel)
    rows = find_table("docs/lidar.md", "10 % target")
    found: set[str] = set()
    for row in rows:
        channels = [int(number) for number in row["channels"].split(", ")]
        for name, count in zip(re.findall(r"`(\w+)`", row["`model`"]), channels, strict=True):
            lidar = models[name].lidar
            figures = (lidar.channels, lidar.receiver.range_at_10_percent_m, lidar.range_m)
            assert figures == (count, first(row["10 % target"]), first(row["range"]))
            found.add(name)
    assert found == set(models)


def test_kinds_of_points_are_those_of_files() -> None:
    (row,) = find_table("docs/lidar.md", "kind")
    names = {int(number): name for number, name in row.items() if number.isdecimal()}
    of_lidars = {kind.value: kind.name.lower() for kind in PointKind if kind is not PointKind.NOISE}
    assert names == of_lidars | {PointKind.STRAY.value: "stray light"}


@pytest.mark.parametrize(
    ("page", "head", "fields"),
    [
        ("docs/lidar.md", "field of `receiver`", LidarReceiver.model_fields),
        ("docs/guides/write_weather.md", "component", Weather.model_fields),
    ],
)
def test_fields_in_tables_are_those_of_declarations(
    page: str, head: str, fields: dict[str, object]
) -> None:
    assert set(list_names(page, head)) <= set(fields)


def test_the_guide_of_weather_names_all_of_its_components() -> None:
    parts = {name for name, field in Weather.model_fields.items() if is_component(field.annotation)}
    assert parts == set(list_names("docs/guides/write_weather.md", "component"))


def is_component(annotation: object) -> bool:
    """Whether a field of a weather is one with fields of its own."""
    return getattr(annotation, "__module__", "") == "advercity_dsl.weather_components"


GRADE_ROWS = (
    ("gyroscope", "noise_deg_rth"),
    ("gyroscope", "bias_instability_deg_h"),
    ("gyroscope", "turn_on_bias_deg_h"),
    ("gyroscope", "bias_deg_h_per_c"),
    ("gyroscope", "scale_ppm"),
    ("gyroscope", "misalignment_mrad"),
    ("gyroscope", "g_sensitivity_deg_h_g"),
    ("accelerometer", "noise_m_s_rth"),
    ("accelerometer", "bias_instability_ug"),
    ("accelerometer", "turn_on_bias_ug"),
    ("accelerometer", "scale_ppm"),
)


def test_grades_of_imus_are_in_the_table() -> None:
    _, *rows = find_table("docs/positioning.md", "`tactical`")
    for row, (part, field) in zip(rows, GRADE_ROWS, strict=True):
        for grade in ("consumer", "automotive", "tactical"):
            value = getattr(getattr(IMU_GRADES[grade], part), field)
            assert first(row[f"`{grade}`"]) == value, (field, grade)


def test_lamps_flicker_as_the_table_says() -> None:
    signals, tails = find_table("docs/cameras.md", "lamps")
    assert (first(signals["frequency"]), first(signals["on"])) == (SIGNAL_HZ, 100 * SIGNAL_DUTY)
    assert tuple(map(float, re.findall(r"\d+", tails["frequency"]))) == TAIL_HZ_RANGE
    assert first(tails["on"]) == pytest.approx(100 * TAIL_DUTY, abs=0.5)


def test_lenses_of_the_guide_are_those_of_cameras() -> None:
    lenses = {"brown_conrady": BrownConradyLens, "kannala_brandt": KannalaBrandtLens}
    for row in find_table("docs/guides/write_a_rig.md", "OpenCV's function"):
        (name,) = re.findall(r"`(\w+)`", row["`model`"])
        assert set(row["coefficients"].strip("`").split()) <= set(lenses.pop(name).model_fields)
    assert not lenses


# -- suites, formats, runs


def test_curves_are_over_the_values_that_their_suites_sweep() -> None:
    suites = LIBRARY.get_declarations(Suite)
    for head in ("visibility", "rain", "snow, of water", "glow in cd/m²"):
        _, *shown = find_table("docs/benchmark.md", head)[0]
        (sweep,) = suites[f"degradation_{re.findall('[a-z]+', head)[0]}"].sweeps.values()
        ends = sweep.values or (sweep.from_, sweep.to)
        assert len(shown) == (sweep.count or len(ends))
        for value, end in zip((shown[0], shown[-1]), (ends[0], ends[-1]), strict=True):
            assert value == end or first(value) == first(str(end))


def test_the_table_of_degradations_and_its_weathers_are_those_of_suites() -> None:
    suites = LIBRARY.get_declarations(Suite)
    swept = {name for name, suite in suites.items() if suite.sweep is not None}
    assert set(list_names("docs/benchmark.md", "suite")) == swept
    head = "AP@50 by weather (300 objects each)"
    weathers = list_names("docs/benchmark.md", head)
    assert weathers == list(suites["benchmark_test"].weathers)


def test_the_leaderboard_has_the_figures_of_the_page() -> None:
    by_fusion = {row["fusion"]: row for row in find_table("docs/benchmark.md", "calibration error")}
    for row in find_table("docs/leaderboard.md", "detector"):
        expected = by_fusion[row["fusion"]]
        for head in ("AP@30", "AP@50", "AP@70"):
            assert row[head] == expected[head]


def test_formats_of_exports_are_in_the_table() -> None:
    assert sorted(
        re.findall(
            r"`(\w+)`",
            " ".join(row["format"] for row in find_table("docs/export.md", "checked with")),
        )
    ) == sorted(load_export_formats().found)


def test_fields_of_the_dataset_are_written_under_their_names() -> None:
    code = "".join(path.read_text() for path in (ROOT / "advercity").glob("[ds]*/**/*.py"))
    tables = [table for table in read_tables("docs/dataset.md") if "field" in table[0]]
    assert len(tables) == 3
    for row in (row for table in tables for row in table):
        for name in re.findall(r"`(\w+)`", row["field"]):
            assert re.search(rf"[\"' ]{name}[\"':,= ]", code), name


def test_the_sizes_of_runs_are_multiples_of_the_measured_frame() -> None:
    """14 MB and 1.4 s a frame; the frames of all scenarios are those of their table."""
    one, minute, every = find_table("README.md", "frames")
    (table,) = read_tables("docs/scenarios.md")
    assert first(every["frames"]) == pytest.approx(110 * float(table[-2]["frames"]), rel=0.05)
    for row in (one, minute, every):
        frames, gigabytes = first(row["frames"]), first(row["files"])
        assert gigabytes == pytest.approx(frames * 0.014, rel=0.1)
        seconds = first(row["time"]) * {"min": 60, "h": 3600}[row["time"].split()[1]]
        assert seconds == pytest.approx(frames * 1.4, rel=0.1)
