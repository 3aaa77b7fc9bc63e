import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.cli import doctor
from advercity.cli.output import format_options
from advercity.cli.progress import show_progress
from advercity.compiler import write_specs
from advercity.dataset.partial_files import lock_file
from advercity.dataset.scenario_folders import find_staging_folder
from advercity.pipeline import Progress
from tests.command_line import Command

RUN_MAIN = "from advercity.cli import main; main()"

ROOT = Path(__file__).parents[2]


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--backend", "sapein"], "did you mean 'sapien'?"),
        (["--profile", "best"], "is none of auto, preview, full"),
        (["--frames", "3"], "not a range; write A:B"),
        (["--frames", "5:5"], "--frames 5:5: holds no frame"),
        (["--frames", "0:5:0"], "step above 0"),
        (["--frames", "\u0660:\u0663"], "not a range; write A:B"),
        (["--frames", f"0:{'9' * 5000}"], "not a range; write A:B"),
        (["--scale", "0"], "is outside 0.01 to 4"),
        (["--weather", "fog_dya"], "did you mean 'fog_day'?"),
        (["--stream", "--rrd", "x.rrd"], "exclude each other"),
        (["--output", ""], "--output is empty; give a folder"),
        (["--keep"], "--keep needs --stream"),
        (["--web", "--rrd", "x.rrd"], "--web needs --stream"),
        (["--cloud-colour", "kinds"], "is none of intensity, class, kind"),
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


def test_options_that_messages_name_are_flags() -> None:
    """Messages quote the names of Python; words such as `raise` come before options."""
    told = format_options("raise `max_memory_bytes` or `max_time_s`, with `schemas`, not `spec`")
    assert told == "raise --max-memory or --max-time, with --schemas, not `spec`"
    for path in (ROOT / "advercity" / "pipeline").glob("*.py"):
        for name in re.findall(r"(?:raise|with|fewer|another) `([a-z_]+)`", path.read_text()):
            assert format_options(f"`{name}`").startswith("--"), f"{path}: {name}"


def test_more_processes_than_any_machine_has_are_refused(
    advercity: Command, spec_file: Path, tmp_path: Path
) -> None:
    ran = advercity("run", spec_file, "--output", tmp_path / "output", "--jobs", "9" * 20)
    assert ran.code == 2
    assert f"--jobs {'9' * 20}: is outside 1 to 1000" in ran.err
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize("command", ["evaluate none.jsonl", "degradation"])
def test_frames_of_a_benchmark_are_checked_as_those_of_a_run(
    advercity: Command, two_roads: Path, tmp_path: Path, command: str
) -> None:
    words = ("benchmark", *command.split(), two_roads, "--output", tmp_path / "o")
    ran = advercity(*words, "--frames", "::0")
    assert ran.code == 2
    assert "step above 0" in ran.err


def test_a_truncated_spec_is_reported_and_leaves_nothing(
    advercity: Command, spec_file: Path, tmp_path: Path
) -> None:
    spec_file.write_text(spec_file.read_text()[:3000])
    ran = advercity("run", spec_file, "--output", tmp_path / "output")
    assert ran.code == 2
    assert f"{spec_file}:" in ran.err
    assert "truncated" in ran.err
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize("command", ["run", "estimate", "simulate"])
def test_a_dataset_in_place_of_a_spec_is_named(
    command: str, advercity: Command, two_roads: Path
) -> None:
    for path in (two_roads, next(two_roads.glob("*/manifest.json")).parent):
        ran = advercity(command, path)
        assert (ran.code, "is a dataset, not a spec" in ran.err) == (2, True)


def test_a_folder_and_a_declaration_are_distinguished_from_a_spec(
    advercity: Command, spec_file: Path, library: Path
) -> None:
    folder = advercity("run", spec_file.parent)
    declaration = advercity("run", library / "nhtsa" / "weather" / "fog_day.yaml")
    assert (folder.code, declaration.code) == (2, 2)
    assert f"is a folder; name specs in it: {spec_file.parent}/*.json" in folder.err
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


def test_a_run_tells_each_step_before_the_first_frame_once(
    specs: dict[str, Spec], capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (specs[f"rcnj_{name}_sparse"] for name in ("fog_day", "clear_day"))
    with show_progress([first, second]) as view:
        for spec in (first, second):
            for phase in ("traffic", "world", "renderer", "frames"):
                view.on_progress(Progress(spec.id, phase))
    assert capsys.readouterr().err.splitlines() == [
        f"{first.id}: simulate the traffic, or load it",
        f"{first.id}: build the world and its bodies, or load them",
        f"{first.id}: open the renderer",
    ]


def test_the_command_line_answers_without_loading_what_renders() -> None:
    code = (
        "import sys, advercity.cli;"
        "print(sorted({'cv2', 'rerun', 'trimesh', 'advercity.pipeline'} & set(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_a_second_run_is_refused_before_what_renders_is_loaded(
    spec_file: Path, tmp_path: Path
) -> None:
    output = tmp_path / "output"
    code = (
        f"import sys; from advercity.cli import main; sys.argv = {['advercity', 'run']!r}"
        f" + {[str(spec_file), '--output', str(output)]!r}\n"
        "try: main()\n"
        "finally: print(sorted({'cv2', 'rerun', 'libsumo', 'advercity.pipeline'} & {*sys.modules}))"
    )
    with lock_file(find_staging_folder(output / spec_file.stem) / "lock"):
        ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.returncode == 1
    assert "another run is writing this scenario; wait for it or choose another --out" in ran.stderr
    assert ran.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("shown", "message"),
    [
        ("mine.rd.rrd", "no such recording; did you mean '{}/mine.rrd'?"),
        ("other/a.rrd", "no such recording; `advercity run` with --rrd writes one"),
        ("scenario/+101", "is a part of a scenario; name {}/scenario"),
    ],
)
def test_view_says_what_can_be_viewed(
    advercity: Command, tmp_path: Path, shown: str, message: str
) -> None:
    (tmp_path / "mine.rrd").touch()
    (tmp_path / "scenario" / "+101").mkdir(parents=True)
    (tmp_path / "scenario" / "manifest.json").touch()
    ran = advercity("view", tmp_path / shown)
    assert ran.code == 2
    assert message.format(tmp_path) in ran.err


def test_view_says_how_the_address_of_a_live_view_looks(advercity: Command) -> None:
    ran = advercity("view", "http://127.0.0.1:9090/?url=x")
    assert ran.code == 2
    assert "not the address of a live view, such as rerun+http://127.0.0.1:9876/proxy" in ran.err


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["plan", "a.json"], "plan is now estimate"),
        (["run", "a.json", "--address", "auto"], "run --address is now --cluster-address"),
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


def test_doctor_names_the_backend_that_is_missing(
    advercity: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "list_backend_names", list[str])
    (line,) = [line for line in advercity("doctor").out.splitlines() if "backend mitsuba" in line]
    assert "`make setup MITSUBA=1`" in line


def test_without_a_home_what_needs_none_works_and_the_rest_says_what_to_set(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def find_none(*_: object, **__: object) -> Path:
        raise RuntimeError("Could not determine home directory.")  # as for an unknown user

    for name in ("ADVERCITY_CACHE", "ADVERCITY_DATA", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("platformdirs.user_data_path", find_none)
    monkeypatch.setattr(Path, "home", find_none)
    for command in (["cache", "show"], ["assets", "list"], ["doctor"]):
        code, _, err = advercity(*command)
        assert (code, err.count("\n")) == (2, 1)
        assert "no home folder; set HOME, or ADVERCITY_CACHE and ADVERCITY_DATA" in err
    assert advercity("new", "weather", "mine", "--output", tmp_path).code == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_end_is_named_and_leaves_no_partial_file(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, number: signal.Signals
) -> None:
    def be_ended(kind: str) -> str:
        assert list((tmp_path / "made").glob(".partial-*"))
        os.kill(os.getpid(), number)
        return kind

    # `nohup` has tests ignore one of them.
    before = {one: signal.signal(one, signal.SIG_DFL) for one in (signal.SIGTERM, signal.SIGHUP)}
    monkeypatch.setattr("advercity.compiler.schema.format_schema", be_ended)
    try:
        code, _, err = advercity("schema", "--output", tmp_path / "made")
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert (code, err) == (128 + number, f"error: ended by {number.name}\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_a_command_works_with_standard_streams_that_are_closed(
    two_roads: Path, closed: str
) -> None:
    program = (sys.executable, "-c", "from advercity.cli import main; main()")
    words = ("sh", "-c", f'exec "$0" "$@" {closed}', *program, "verify", str(two_roads))
    assert subprocess.run(words, check=False).returncode == 0


def test_a_hangup_that_nohup_ignores_stays_ignored(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    monkeypatch.setattr("advercity.compiler.schema.format_schema", hang_up)
    try:
        code, _, _ = advercity("schema", "--output", tmp_path / "made")
    finally:
        signal.signal(signal.SIGHUP, before)
    assert code == 0


def hang_up(kind: str) -> str:
    os.kill(os.getpid(), signal.SIGHUP)
    return kind
