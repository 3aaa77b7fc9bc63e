"""Commands that compile, check, describe and start declarations."""

import io
import json
import re
import shutil
from pathlib import Path

import pytest
import yaml
from advercity_dsl import Spec

from advercity.cli import main
from advercity.compiler import write_specs
from tests.command_line import Command
from tests.roads.imported_roads import AT_JUNCTION, DATA


def test_compile_writes_the_110_specs_and_check_finds_them_current(
    advercity: Command, library: Path, tmp_path: Path
) -> None:
    ran = advercity("compile", library, "--output", tmp_path)
    assert (ran.code, ran.out, ran.err) == (0, "", f"110 specs in {tmp_path}: 110 new\n")
    assert len(list(tmp_path.glob("*.json"))) == 110
    ran = advercity("compile", library, "--output", tmp_path, "--check")
    assert (ran.code, ran.err) == (0, f"110 specs in {tmp_path} are current\n")
    (tmp_path / "ui_fog_day_dense.json").unlink()
    ran = advercity("compile", library, "--output", tmp_path, "--check")
    assert ran.code == 1
    assert "ui_fog_day_dense.json: is missing" in ran.err


@pytest.mark.parametrize(
    ("conflict", "told"),
    {
        "conflict_draws_that_do_not_fit": "8 to 5 is not a range; write the lower number first",
        "conflict_without_an_edition": "stages.0: 10 does not name an edition; write ",
    }.items(),
)
def test_compile_reports_once_what_does_not_fit_a_conflict(
    conflict: str, told: str, advercity: Command, tmp_path: Path
) -> None:
    authoring = Path(__file__).parents[1] / "compiler"
    shutil.copytree(authoring / "base", tmp_path / "library")
    shutil.copy(authoring / "cases" / f"{conflict}.yaml", tmp_path / "library")

    ran = advercity("compile", tmp_path / "library")

    places = [line.split(": ")[2] for line in ran.err.splitlines() if line.startswith("error: ")]
    assert ran.code == 2
    assert told in ran.err
    assert len(places) == len(set(places)) > 1


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("compile {library} --output LOOP", "File exists"),
        ("new weather mine --output LOOP", "Too many levels of symbolic links"),
        ("stats LOOP", "it is a link that leads nowhere"),
    ],
)
def test_a_link_that_leads_to_itself_is_named(
    command: str, told: str, advercity: Command, library: Path, tmp_path: Path
) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    ran = advercity(*command.format(library=library).replace("LOOP", str(loop)).split())
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"error: {loop}")
    assert told in ran.err


def test_compile_of_no_library_is_bad_input(advercity: Command, tmp_path: Path) -> None:
    ran = advercity("compile", tmp_path / "nothing")
    assert ran.code == 2
    assert ran.err.startswith("error: ")
    assert "no such file or folder" in ran.err
    assert ran.out == ""


def test_show_says_at_which_junctions_agents_cannot_be(advercity: Command, tmp_path: Path) -> None:
    """Of two junctions with lights, the second has no street from the south."""
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
    signals = '<tag k="highway" v="traffic_signals"/>'
    nodes = f"""<node id="7" lat="48.0" lon="11.0013">{signals}</node>
        <node id="8" lat="48.0018" lon="11.0013"/>"""
    side = '<way id="14"><nd ref="7"/><nd ref="8"/><tag k="highway" v="secondary"/></way>'
    text = text.replace('<node id="6"', nodes + '<node id="6"').replace("</osm>", side + "</osm>")
    text = text.replace('<nd ref="1"/><nd ref="4"/>', '<nd ref="1"/><nd ref="7"/><nd ref="4"/>')
    (tmp_path / "crossroads.osm").write_text(text, encoding="utf-8")
    (tmp_path / "road.yaml").write_text(yaml.safe_dump(AT_JUNCTION))

    ran = advercity("show", tmp_path / "road.yaml")

    (line,) = (line for line in ran.out.splitlines() if line.startswith("no agents at "))
    assert line.startswith("no agents at j7 ")
    assert "no traffic comes to 'j7' from an arm 'south'; its arms are " in line


def test_list_has_one_line_per_spec(advercity: Command, spec_file: Path) -> None:
    ran = advercity("list", spec_file.parent)
    assert ran.code == 0
    heads, row = ran.out.splitlines()
    columns = [heads.index(head) for head in ("scenario", "vehicles", "weather", "crash groups")]
    begin, vehicles, weather, groups = columns
    assert row[begin:vehicles].strip() == "rcnj_fog_day_sparse"
    assert row[vehicles:weather].split() == ["24", "0"]
    assert row[weather:groups].strip() == "day: thick fog, overcast, 8 degC"
    assert row[groups:] == "opposite_direction"


def test_list_has_one_line_per_declaration_of_a_library(advercity: Command, library: Path) -> None:
    lines = advercity("list", library).out.splitlines()
    assert lines[0].split() == ["kind", "id", "title", "file"]
    (fog,) = [line for line in lines if line.startswith("weather") and " fog_day " in line]
    assert "Dense fog by day" in fog
    assert fog.endswith("nhtsa/weather/fog_day.yaml")


def test_list_of_nothing_says_what_makes_specs(advercity: Command, tmp_path: Path) -> None:
    ran = advercity("list", tmp_path)
    assert ran.code == 2
    assert "`advercity compile` writes them" in ran.err


def test_list_distinguishes_a_missing_folder_from_a_file(
    advercity: Command, tmp_path: Path
) -> None:
    (tmp_path / "notes").touch()
    missing, file = advercity("list", tmp_path / "no"), advercity("list", tmp_path / "notes")
    assert (missing.code, file.code) == (2, 2)
    assert "no such folder" in missing.err
    assert "is a file; name its folder" in file.err


def test_a_library_without_a_suite_gets_a_hint_how_to_write_one(
    advercity: Command, library: Path, tmp_path: Path
) -> None:
    ran = advercity("compile", library / "nhtsa" / "weather", "--output", tmp_path / "specs")
    assert ran.code == 2
    assert ran.err.endswith("has no suite; `advercity new suite NAME` writes one\n")


def test_a_misspelt_field_is_reported_though_another_one_is_right(
    advercity: Command, spec_file: Path
) -> None:
    ran = advercity("explain", spec_file, "weather.wind", "weather.fgo")
    assert (ran.code, ran.out) == (2, "")
    assert "has no field weather.fgo; did you mean 'weather.fog'?" in ran.err


def test_explain_names_the_nearest_field(advercity: Command, spec_file: Path) -> None:
    ran = advercity("explain", spec_file, "weather.fog.mor")
    assert ran.code == 2
    assert "did you mean 'weather.fog.mor_m'?" in ran.err


def test_show_describes_a_scenario(advercity: Command, spec_file: Path) -> None:
    out = advercity("show", spec_file).out
    assert "fog 75 m" in out
    assert "rural, non_junction, curved, non_level" in out
    assert re.search(r"conflicts +od_drift, expected from frame \d+ on\n", out)
    assert re.search(r"agent cav1 +101, ego, lincoln_mkz_2017: 4 cameras, 1 LiDAR\n", out)
    assert re.search(r"agent rsu2 +-2, roadside unit: 4 cameras, 1 LiDAR\n", out)


def test_show_of_a_weather_without_a_title_ends_with_its_id(
    advercity: Command, tmp_path: Path
) -> None:
    path = tmp_path / "haze.yaml"
    path.write_text("kind: weather\nid: haze\ntime: day\nair: {mor_m: 3 km}\n")
    assert advercity("show", path).out.splitlines()[0].split() == ["weather", "haze"]


def test_show_escapes_what_would_break_a_line_or_command_a_terminal(
    advercity: Command, tmp_path: Path
) -> None:
    path = tmp_path / "haze.yaml"
    path.write_text(
        "kind: weather\nid: haze\ntime: day\nair: {mor_m: 3 km}\n"
        'title: "one\\ntwo \\e[2J"\nsource: "\\u202eback"\n'
    )
    lines = advercity("show", path).out.splitlines()
    assert lines[0].split(maxsplit=1) == ["weather", r"haze: one\ntwo \x1b[2J"]
    assert lines[-1].split(maxsplit=1) == ["source", r"\u202eback"]


def test_data_that_the_encoding_of_the_terminal_lacks_are_escaped(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "haze.yaml"
    path.write_text("kind: weather\nid: haze\ntitle: été\ntime: day\nair: {mor_m: 3 km}\n")
    printed = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(printed, "ascii", write_through=True))
    monkeypatch.setattr("sys.argv", ["advercity", "show", str(path)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 0
    assert rb"haze: \xe9t\xe9" in printed.getvalue()


def test_validate_says_what_it_checked(advercity: Command, spec_file: Path, library: Path) -> None:
    ran = advercity("validate", spec_file, library)
    assert (ran.code, ran.out) == (0, "")
    # Before it: which roads cannot stage a conflict that a suite crosses all roads with.
    assert ran.err.splitlines()[-1].startswith("no problems found in 1 spec")


@pytest.mark.parametrize("kind", ["weather", "road", "spec"])
def test_schema_is_json_schema(advercity: Command, kind: str) -> None:
    schema = json.loads(advercity("schema", kind).out)
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False


def test_schema_of_an_unknown_kind_suggests_a_name(advercity: Command) -> None:
    ran = advercity("schema", "wether")
    assert ran.code == 2
    assert "did you mean 'weather'?" in ran.err


def test_what_an_author_wrote_is_quoted_unchanged_even_if_it_names_a_parameter(
    advercity: Command, tmp_path: Path
) -> None:
    path = tmp_path / "fog.yaml"
    path.write_text("kind: weather\nid: fog\ntime: dai  # `frames` of `output`\n")
    ran = advercity("validate", path)
    assert ran.code == 2
    assert "time: dai  # `frames` of `output`" in ran.err
    path.write_text("- a list\n")
    assert "`kind`" in advercity("validate", path).err


def test_show_explains_a_weather_in_words_and_numbers(advercity: Command, library: Path) -> None:
    ran = advercity("show", library / "examples" / "snow_day.yaml", "--json")
    facts = json.loads(ran.out)
    assert facts["summary"].startswith("day: moderate snow, overcast")
    assert facts["visibility"].startswith("664 m (air 10000 m, snow 711 m")
    assert facts["LiDAR range"].startswith("62, 112, 130 m")


@pytest.mark.parametrize(
    ("at", "told"),
    [
        ("2025-06-21T12:00 Europe/Madrid", "2025-06-21 10:00 UTC"),
        ("2025-06-21T12:00-03:30", "2025-06-21 15:30 UTC"),
        ("2025-06-21T12:00", "2025-06-21 12:00 UTC by longitude; legal time has its zone after it"),
    ],
)
def test_show_tells_the_instant_of_a_sun(
    advercity: Command, tmp_path: Path, at: str, told: str
) -> None:
    path = tmp_path / "noon.yaml"
    sun = f"sun: {{at: {at}, lat_deg: 40.4, lon_deg: -3.7}}"
    path.write_text(f"kind: weather\nid: noon\ntime: day\n{sun}\n")
    facts = json.loads(advercity("show", path, "--json").out)
    assert facts["sun's time"].partition(",")[0] == told


def test_explain_names_the_line_of_a_value(
    advercity: Command, spec_file: Path, library: Path
) -> None:
    ran = advercity("explain", spec_file, "weather.fog", "--library", library)
    assert ran.code == 0
    assert "fog_day.yaml:8:14" in ran.out
    assert len(ran.out.splitlines()) == 4


def test_diff_names_the_fields_that_differ(
    advercity: Command, spec_file: Path, specs: dict[str, Spec]
) -> None:
    write_specs([specs["rcnj_fog_day_dense"]], spec_file.parent / "other")
    other = spec_file.parent / "other" / "rcnj_fog_day_dense.json"
    rows = json.loads(advercity("diff", spec_file, other, "--json").out)
    assert {"id", "density.id", "demand.vehicles"} <= {row["field"] for row in rows}
    assert advercity("diff", spec_file, spec_file).out == ""


def test_new_writes_a_declaration_that_is_valid(advercity: Command, tmp_path: Path) -> None:
    ran = advercity("new", "weather", "drizzle", "--output", tmp_path)
    assert ran.out.strip() == str(tmp_path / "drizzle.yaml")
    assert advercity("validate", tmp_path / "drizzle.yaml").code == 0
    assert advercity("new", "weather", "drizzle", "--output", tmp_path).code == 2


def test_a_mistake_in_a_file_is_shown_with_its_line(advercity: Command, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("kind: weather\nid: mine\ntime: day\nrain: {rate_mm_h: 400 mm/h}\n")
    ran = advercity("validate", path)
    assert ran.code == 2
    assert ran.err.splitlines()[1:] == [
        "    4 | rain: {rate_mm_h: 400 mm/h}",
        "      |                   ^^^^^^^^",
    ]


def test_without_a_library_here_the_shipped_one_is_compiled(
    advercity: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = advercity("compile", "--output", "specs")
    assert (ran.code, len(list(Path("specs").glob("*.json")))) == (0, 110)
    assert advercity("library", "copy", "mine").out.strip() == "mine"
    assert advercity("validate", "mine").code == 0
    again = advercity("library", "copy", "mine")
    assert (again.code, again.err) == (2, "error: mine: exists; name a new folder\n")
    (tmp_path / "library").mkdir()
    assert "library: no declarations" in advercity("compile").err, "it comes first"


@pytest.mark.parametrize(
    ("name", "code", "told"),
    [
        ("ui", 0, "far_west_road"),
        ("fog_day", 0, "75 m"),
        ("fog_dya", 2, "did you mean 'fog_day'?"),
        ("adver_city", 2, "name one of the files"),
        ("none.yaml", 2, "none.yaml: file not found"),
    ],
)
def test_show_finds_declarations_by_name(
    name: str, code: int, told: str, advercity: Command
) -> None:
    ran = advercity("show", name)
    assert ran.code == code
    assert told in ran.out + ran.err
