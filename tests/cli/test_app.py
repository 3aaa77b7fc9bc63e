import io
import json
import os
import pty
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.cli import main
from advercity.cli.progress import show_progress
from advercity.compiler import write_specs
from advercity.pipeline import Progress

RUN_MAIN = "from advercity.cli import main; main()"


class Ran:
    """How a command ended."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


Command = Callable[..., Ran]


@pytest.fixture
def advercity(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs the command line in this process."""

    def run(*arguments: str | Path) -> Ran:
        monkeypatch.setattr("sys.argv", ["advercity", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        code = left.value.code
        return Ran(code if isinstance(code, int) else 0, captured.out, captured.err)

    return run


@pytest.fixture
def spec_file(specs: dict[str, Spec], tmp_path: Path) -> Path:
    """A compiled spec on disk."""
    write_specs([specs["rcnj_fog_day_sparse"]], tmp_path / "compiled")
    return tmp_path / "compiled" / "rcnj_fog_day_sparse.json"


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


def test_compile_of_no_library_is_bad_input(advercity: Command, tmp_path: Path) -> None:
    ran = advercity("compile", tmp_path / "nothing")
    assert ran.code == 2
    assert ran.err.startswith("error: ")
    assert "no such file or folder" in ran.err
    assert ran.out == ""


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


@pytest.mark.parametrize(
    "command",
    [
        ["compile", "LIBRARY"],
        ["new", "weather", "sleet"],
        ["schema"],
        ["run", "SPEC"],
        ["estimate", "SPEC"],
        ["simulate", "SPEC"],
    ],
)
def test_an_output_that_is_a_file_is_bad_input_and_stays_as_it_is(
    advercity: Command, library: Path, spec_file: Path, tmp_path: Path, command: list[str]
) -> None:
    notes = tmp_path / "notes"
    notes.write_text("mine")
    places = {"LIBRARY": library, "SPEC": spec_file}
    ran = advercity(*[places.get(word, word) for word in command], "--output", notes)
    assert (ran.code, ran.out) == (2, "")
    assert "is a file" in ran.err
    assert "Traceback" not in ran.err
    assert notes.read_text() == "mine"


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
    assert ran.err.startswith("no problems found in 1 spec")


@pytest.mark.parametrize("kind", ["weather", "road", "spec"])
def test_schema_is_json_schema(advercity: Command, kind: str) -> None:
    schema = json.loads(advercity("schema", kind).out)
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False


def test_schema_of_an_unknown_kind_suggests_a_name(advercity: Command) -> None:
    ran = advercity("schema", "wether")
    assert ran.code == 2
    assert "did you mean 'weather'?" in ran.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--backend", "sapein"], "did you mean 'sapien'?"),
        (["--profile", "best"], "no such profile; auto, preview or full"),
        (["--frames", "3"], "not a range; write A:B"),
        (["--frames", "5:5"], "--frames 5:5: holds no frame"),
        (["--frames", "0:5:0"], "step above 0"),
        (["--scale", "0"], "is outside 0.01 to 4"),
        (["--weather", "fog_dya"], "did you mean 'fog_day'?"),
        (["--stream", "--rrd", "x.rrd"], "exclude each other"),
        (["--keep"], "--keep needs --stream"),
        (["--web", "--rrd", "x.rrd"], "--web needs --stream"),
        (["--cloud-colour", "kinds"], "no such colouring; intensity, class or kind"),
    ],
)
def test_a_bad_option_is_reported_and_leaves_nothing(
    advercity: Command, spec_file: Path, tmp_path: Path, options: list[str], message: str
) -> None:
    output = tmp_path / "output"
    ran = advercity("run", spec_file, "--output", output, *options)
    assert ran.code == 2
    assert message in ran.err
    assert len(ran.err.splitlines()) == 1
    assert not output.exists()


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


def test_a_truncated_spec_is_reported_and_leaves_nothing(
    advercity: Command, spec_file: Path, tmp_path: Path
) -> None:
    spec_file.write_text(spec_file.read_text()[:3000])
    ran = advercity("run", spec_file, "--output", tmp_path / "output")
    assert ran.code == 2
    assert f"{spec_file}:" in ran.err
    assert "truncated" in ran.err
    assert not (tmp_path / "output").exists()


def test_a_folder_and_a_declaration_are_distinguished_from_a_spec(
    advercity: Command, spec_file: Path, library: Path
) -> None:
    folder = advercity("run", spec_file.parent)
    declaration = advercity("run", library / "nhtsa" / "weather" / "fog_day.yaml")
    assert (folder.code, declaration.code) == (2, 2)
    assert f"is a folder; name a file in it, such as {spec_file}" in folder.err
    assert "`advercity compile` makes specs, which are JSON, from declarations" in declaration.err


def test_a_missing_spec_is_reported(advercity: Command, tmp_path: Path) -> None:
    ran = advercity("run", tmp_path / "none.json")
    assert ran.code == 2
    assert ran.err == f"error: {tmp_path / 'none.json'}: file not found\n"


@pytest.mark.parametrize("name", ["rcnj_fog_day_spares.json", "rcnj_fog_day_sparse.yml"])
def test_the_name_of_a_file_that_was_meant_is_suggested(
    advercity: Command, spec_file: Path, name: str
) -> None:
    ran = advercity("run", spec_file.with_name(name))
    assert (ran.code, ran.out) == (2, "")
    assert (
        ran.err
        == f"error: {spec_file.with_name(name)}: file not found; did you mean '{spec_file}'?\n"
    )


def test_the_name_of_a_library_or_dataset_that_was_meant_is_suggested(
    advercity: Command, library: Path
) -> None:
    wrong = library.with_name("libary")
    for command in ("compile", "verify"):
        assert f"did you mean '{library}'?" in advercity(command, wrong).err


@pytest.mark.render
@pytest.mark.sumo
@pytest.mark.parametrize("options", [["--connect", "nowhere at all"], ["--rrd", "."]])
def test_a_viewer_that_cannot_be_leaves_no_dataset(
    advercity: Command, spec_file: Path, tmp_path: Path, options: list[str]
) -> None:
    output = tmp_path / "output"
    ran = advercity("run", spec_file, "--output", output, "--frames", "0:1", *options)
    assert ran.code == 2
    assert not output.exists()


def test_one_recording_holds_one_scenario(
    advercity: Command, specs: dict[str, Spec], tmp_path: Path
) -> None:
    two = [specs["ri_fog_day_sparse"], specs["ri_clear_day_sparse"]]
    write_specs(two, tmp_path)
    files = [tmp_path / f"{spec.id}.json" for spec in two]
    ran = advercity("run", *files, "--rrd", tmp_path / "two.rrd")
    assert ran.code == 2
    assert "show one scenario" in ran.err


def test_file_names_are_reported_unchanged(advercity: Command) -> None:
    assert ":smile:.json" in advercity("validate", ":smile:.json").err


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["--agent", "nobody"], "has no agent 'nobody'; it has cav1"),
        (["--camera", "7"], "has cameras 0 to 3, not 7"),
        (["--profile", "fine"], "no such profile; preview or full"),
        (["--weather", "fog_dya"], "did you mean 'fog_day'?"),
    ],
)
def test_a_gallery_says_what_it_cannot_show(
    advercity: Command, spec_file: Path, asked: list[str], message: str
) -> None:
    ran = advercity("gallery", spec_file, *asked)
    assert ran.code == 2
    assert message in ran.err


def test_a_gallery_takes_weathers_of_the_library_that_is_named(
    advercity: Command, spec_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "mist.yaml").write_text("kind: weather\nid: mist\ntime: day\n")
    asked = ("gallery", spec_file, "--weather", "mist", "--profile", "fine")
    assert "unknown weather 'mist'" in advercity(*asked).err
    assert "no such profile" in advercity(*asked, "--library", tmp_path).err


def test_help_lists_the_commands(advercity: Command) -> None:
    ran = advercity("--help")
    assert ran.code == 0
    assert {"compile", "validate", "list", "show", "run", "view", "doctor", "schema"} <= set(
        ran.out.split()
    )


@pytest.mark.parametrize("group", [[], ["assets"]])
def test_help_says_in_a_whole_line_what_each_command_does(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, group: list[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ran = advercity(*group, "-h")
    listed = ran.out.partition("--help")[2].splitlines()
    lines = [line for line in listed[1:] if line and not line.endswith(":")]
    assert len(lines) >= 5
    assert [line for line in lines if not line.rstrip().endswith(".") or "..." in line] == []


def test_help_groups_commands_by_what_they_are_for(advercity: Command) -> None:
    text = advercity("--help").out
    heads = [line.rstrip(":") for line in text.splitlines() if line and line[0] != " "][1:]
    assert heads == ["Options", "Author", "Run", "Dataset", "Machine"]
    panels = dict(zip(heads, re.split(r"^\w+:$", text, flags=re.MULTILINE)[1:], strict=True))
    for panel, command in {"Author": "compile", "Run": "run", "Dataset": "verify"}.items():
        assert f"\n  {command} " in panels[panel]


def test_a_shell_completes_commands() -> None:
    asked = {
        "_ADVERCITY_COMPLETE": "complete_bash",
        "COMP_WORDS": "advercity ver",
        "COMP_CWORD": "1",
    }
    ran = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.argv[0] = 'advercity'; {RUN_MAIN}"],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout.split() == ["verify"]


def test_a_command_shows_at_once_at_a_terminal_that_it_runs_and_keeps_its_output_clean(
    spec_file: Path,
) -> None:
    terminal, its_end = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", RUN_MAIN, "show", spec_file],
        stdout=subprocess.PIPE,
        stderr=its_end,
        text=True,
        env=os.environ | {"TERM": "xterm"},
    )
    out, _ = process.communicate(timeout=60)
    os.close(its_end)
    assert out.startswith("scenario ")
    assert "\x1b" not in out
    assert b" show" in os.read(terminal, 4096)
    os.close(terminal)


def test_progress_says_once_where_the_live_view_is_and_how_to_open_it(
    specs: dict[str, Spec], capsys: pytest.CaptureFixture[str]
) -> None:
    spec, address = specs["rcnj_fog_day_sparse"], "rerun+http://127.0.0.1:9876/proxy"
    with show_progress([spec], page="http://127.0.0.1:9090/?url=x") as view:
        for done in range(3):
            view.on_progress(Progress(spec.id, "frames", done, 3, address=address))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        f"live view at {address}; open it with: advercity view {address}",
        "in a browser: http://127.0.0.1:9090/?url=x",
    ]


def test_the_command_line_answers_without_loading_what_renders() -> None:
    code = (
        "import sys, advercity.cli;"
        "print(sorted({'cv2', 'rerun', 'trimesh', 'advercity.pipeline'} & set(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_show_explains_a_weather_in_words_and_numbers(advercity: Command, library: Path) -> None:
    ran = advercity("show", library / "examples" / "snow_day.yaml", "--json")
    facts = json.loads(ran.out)
    assert facts["summary"].startswith("day: moderate snow, overcast")
    assert facts["visibility"].startswith("664 m (air 10000 m, snow 711 m")
    assert facts["LiDAR range"].startswith("62, 112, 130 m")


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


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["plan", "a.json"], "plan is now estimate"),
        (["run", "a.json", "--address", "auto"], "run --address is now --ray-address"),
        (["run", "a.json", "--colour-clouds", "kind"], "--colour-clouds is now --cloud-colour"),
        (["view", "a.rrd", "--colour-clouds", "kind"], "--colour-clouds is now --cloud-colour"),
        (["simulate", "a.json", "--film"], "--film is now --video"),
        (["simulate", "a.json", "--no-film"], "--no-film is now --no-video"),
        (["simulate", "a.json", "--table"], "--table is now --markdown"),
        (["assets", "install", "--optional"], "--optional is now --allow-failure"),
    ],
)
def test_an_old_name_is_answered_with_the_new_one(
    advercity: Command, asked: list[str], message: str
) -> None:
    ran = advercity(*asked)
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err


def test_an_option_that_never_existed_is_an_unknown_option(advercity: Command) -> None:
    ran = advercity("list", "--table")
    assert ran.code == 2
    assert "is now" not in ran.err
    assert "--table" in ran.err
