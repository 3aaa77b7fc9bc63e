"""The commands and their options."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.assets import assets
from advercity.cli.output import note, say
from advercity.errors import InputError, RunError

app = typer.Typer(
    name="advercity",
    help="Adverse-weather V2X driving data, compiled from YAML.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

app.add_typer(assets)

LibraryArgument = Annotated[list[Path], typer.Argument(help="Folders of declarations.")]
LIBRARIES = [Path("library")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
SpecArgument = Annotated[list[Path], typer.Argument(help="Compiled specs (*.json).")]
DatasetArgument = Annotated[Path, typer.Argument(help="A dataset, or one scenario of it.")]
BackendOption = Annotated[str, typer.Option(help="Rendering backend.")]
ProfileOption = Annotated[str, typer.Option(help="auto, preview or full.")]
ScaleOption = Annotated[float | None, typer.Option(help="Image scale, over the profile's.")]
FramesOption = Annotated[
    str | None, typer.Option(metavar="A:B[:STEP]", help="Kept frames to make, B not included.")
]
JobsOption = Annotated[int, typer.Option(min=1, help="Scenarios at a time.")]
ColourOption = Annotated[
    str,
    typer.Option(
        "--colour-clouds", help="What colours of points show: intensity, class or kind of echo."
    ),
]


@app.command("compile")
def compile_(
    library: LibraryArgument = LIBRARIES,
    output: Annotated[Path, typer.Option(help="Folder for the specs.")] = Path("compiled"),
    suite: Annotated[str | None, typer.Option(help="Suite to compile.")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only tell whether specs are stale.")
    ] = False,
) -> None:
    """Compile a library of declarations into scenario specs."""
    from advercity.compiler import compile_library, differences, write_specs

    specs = compile_library(*library, suite=suite)
    if check:
        stale = differences(specs, output)
        if stale:
            again = " ".join(["advercity compile", *map(str, library)])
            raise RunError("\n".join([*stale, f"run `{again}` to renew them"]))
        note(f"{len(specs)} specs in {output} are current")
        return
    write_specs(specs, output)
    note(f"{len(specs)} specs in {output}")


@app.command()
def solve(
    library: LibraryArgument = LIBRARIES,
    suite: Annotated[str | None, typer.Option(help="Suite whose roads and weathers.")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only tell whether what was found still holds.")
    ] = False,
) -> None:
    """Find suns that are to be in the ego's view, by rays against the world; write them down."""
    from advercity.compiler import chosen_suite, load_library
    from advercity.runner.glare import check_suns, solve_suns

    loaded = load_library(*library)
    chosen = chosen_suite(loaded, *library, suite=suite)
    for line in check_suns(loaded, chosen) if check else solve_suns(loaded, chosen):
        say(line)


@app.command()
def validate(
    paths: Annotated[list[Path], typer.Argument(help="Specs, declarations or library folders.")],
) -> None:
    """Check specs and declarations; print nothing but problems."""
    from advercity.compiler import validate_path

    for path in paths:
        validate_path(path)
    note("no problems found")


@app.command("list")
def list_(
    folder: Annotated[
        Path, typer.Argument(help="Folder of specs, or a library of declarations.")
    ] = Path("compiled"),
    as_json: JsonOption = False,
) -> None:
    """List compiled scenarios, or the declarations of a library."""
    from advercity.cli import tables

    rows = tables.rows_of(folder)
    say(tables.as_json(rows) if as_json else tables.table(rows))


@app.command()
def show(
    path: Annotated[Path, typer.Argument(help="A compiled spec, or a declaration.")],
    map_: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Draw the plan into a picture.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell what a scenario or a declaration holds, and what follows from it; draw its plan."""
    from advercity_dsl import Road

    from advercity.cli import tables
    from advercity.compiler import find_declaration, read_spec

    spec = read_spec(path) if path.suffix == ".json" else None
    entry = None if spec else find_declaration(path)
    facts = tables.spec_facts(spec) if spec else tables.declaration_facts(entry) if entry else {}
    say(tables.as_json(facts) if as_json else tables.aligned(facts))
    if map_ is not None:
        from advercity.pictures import write_picture
        from advercity.world.plan import draw_plan

        road = spec.road if spec else entry.declaration if entry else None
        if not isinstance(road, Road):
            raise InputError(f"{path}: --map draws roads and specs; this is neither")
        write_picture(draw_plan(road, spec), map_)
        note(f"plan in {map_}")


@app.command()
def explain(
    spec: Annotated[Path, typer.Argument(help="A compiled spec.")],
    fields: Annotated[
        list[str] | None, typer.Argument(help="Fields, such as weather.fog; all of them.")
    ] = None,
    library: Annotated[
        list[Path] | None, typer.Option(help="Folders that it was compiled from.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell where every value of a spec comes from: file and line, default, or rule."""
    from advercity.cli import tables
    from advercity.compiler import explained, load_library, nearest, read_spec

    origins = explained(read_spec(spec), load_library(*(library or LIBRARIES)))
    chosen = [item for item in origins if not fields or item.is_within(fields)]
    if not chosen:
        hint = nearest(" ".join(fields or []), {item.path for item in origins})
        raise InputError(f"{spec}: has no field {' or '.join(fields or [])}; {hint}")
    rows = tables.origin_rows(chosen)
    say(tables.as_json(rows) if as_json else tables.table(rows))


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(help="A compiled spec.")],
    second: Annotated[Path, typer.Argument(help="Another one.")],
    as_json: JsonOption = False,
) -> None:
    """Tell in which fields two specs differ."""
    from advercity.cli import tables
    from advercity.compiler import read_spec

    rows = tables.difference_rows(read_spec(first), read_spec(second))
    if as_json:
        say(tables.as_json(rows))
    elif rows:
        say(tables.table(rows))
    else:
        note("no differences")


@app.command()
def new(
    kind: Annotated[str, typer.Argument(help="Kind of declaration: weather, road, suite, ...")],
    name: Annotated[str, typer.Argument(help="Its id, and the name of its file.")],
    output: Annotated[Path, typer.Option(help="Folder for the file.")] = Path(),
) -> None:
    """Write a commented declaration to start from."""
    from advercity.compiler.starting import write_starter

    say(str(write_starter(kind, name, output)))


@app.command()
def run(
    specs: SpecArgument,
    output: Annotated[
        str, typer.Option(help="Folder for the dataset; with Ray also a URL: s3://bucket/folder.")
    ] = "output",
    backend: BackendOption = "sapien",
    profile: ProfileOption = "auto",
    scale: ScaleOption = None,
    frames: FramesOption = None,
    rrd: Annotated[Path | None, typer.Option(help="Write a Rerun recording.")] = None,
    stream: Annotated[bool, typer.Option("--stream", help="Serve the live view.")] = False,
    connect: Annotated[str | None, typer.Option(help="Send to a running Rerun viewer.")] = None,
    colour_clouds: ColourOption = "intensity",
    weather: Annotated[
        str | None, typer.Option(help="Replay under another weather: a file, or a library name.")
    ] = None,
    jobs: JobsOption = 1,
    max_memory: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Memory of a scenario: 4 GB; by the plan."),
    ] = None,
    max_time: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Time of a scenario: 90 min; by the plan."),
    ] = None,
    allow_large: Annotated[
        bool, typer.Option("--allow-large", help="Run what is large by the plan, too.")
    ] = False,
    executor: Annotated[str, typer.Option(help="local, or ray for a cluster.")] = "local",
    address: Annotated[
        str | None, typer.Option(help="Ray cluster: auto, or HOST:PORT; one of this machine.")
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start over; discard what is there.")
    ] = False,
    layout: Annotated[str, typer.Option("--format", help="opv2v or adver_city.")] = "opv2v",
) -> None:
    """Run scenarios, each in a process of its own: traffic, sensors, dataset, live view."""
    from advercity.cli.progress import progress
    from advercity.compiler import find_weather, read_spec, under
    from advercity.runner import (
        Limits,
        Options,
        ViewerTarget,
        executor_called,
        parse_frames,
        raise_failures,
    )
    from advercity.runner.batch import check_together
    from advercity.runner.limits import parse_size, parse_time
    from advercity.runner.planning import permitted
    from advercity.viewer.clouds import parse_cloud_colour

    if sum((rrd is not None, stream, connect is not None)) > 1:
        raise InputError("--rrd, --stream and --connect exclude each other; give one")
    chosen = [read_spec(path) for path in specs]
    if weather is not None:
        other = find_weather(weather)
        chosen = [under(spec, other) for spec in chosen]
    options = Options(
        output=Path(output),
        backend=backend,
        profile=profile,
        scale=scale,
        frames=parse_frames(frames),
        viewer=ViewerTarget(
            file=rrd,
            serve=stream,
            connect=connect,
            cloud_colour=parse_cloud_colour(colour_clouds),
        ),
        fresh=fresh,
        format=layout,
    )
    asked = Limits(
        memory_bytes=None if max_memory is None else parse_size("--max-memory", max_memory),
        time_s=None if max_time is None else parse_time("--max-time", max_time),
    )
    check_together(chosen, options)
    where = executor_called(executor, output=output, address=address, jobs=jobs)
    limits = permitted(
        chosen,
        options,
        asked=asked,
        jobs=jobs,
        allow_large=allow_large,
        on_this_machine=executor == "local",
    )
    with progress(chosen) as view:
        outcomes = where.run(chosen, options, watcher=view, limits=limits)
    for outcome in outcomes:
        if outcome.error is None:
            say(f"{output.rstrip('/')}/{outcome.scenario}")
    raise_failures(outcomes)


@app.command()
def plan(
    specs: SpecArgument,
    output: Annotated[
        Path, typer.Option(help="Folder for the dataset; what is there need not be made.")
    ] = Path("output"),
    backend: BackendOption = "sapien",
    profile: ProfileOption = "auto",
    scale: ScaleOption = None,
    frames: FramesOption = None,
    jobs: JobsOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Tell what running scenarios will take: frames, pictures, bytes, time and memory.

    The first time it measures this machine, which takes a minute, and simulates the traffic.
    """
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.runner import Options, parse_frames
    from advercity.runner.batch import check_together
    from advercity.runner.planning import plan_of

    chosen = [read_spec(path) for path in specs]
    options = Options(output, backend, profile, scale, parse_frames(frames))
    check_together(chosen, options)
    found = plan_of(chosen, options, jobs=jobs, measure=True, simulate=True)
    if as_json:
        told = [asdict(item) for item in (*found.forecasts, found.total)]
        say(tables.as_json({"scenarios": told[:-1], "total": told[-1]}))
    else:
        say(tables.table([item.told() for item in (*found.forecasts, found.total)]))
    for complaint in found.complaints(output):
        note(f"run asks for --allow-large: {complaint}")


@app.command()
def simulate(
    specs: SpecArgument,
    output: Annotated[Path, typer.Option(help="Folder for traces and reports.")] = Path("traffic"),
    film: Annotated[bool, typer.Option(help="Film the moving plan, too.")] = True,
    table: Annotated[
        bool, typer.Option("--table", help="Only print the table, as Markdown; write nothing.")
    ] = False,
) -> None:
    """Simulate traffic alone: trace, report and moving plan; tell whether conflicts happened."""
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.runner.simulating import reports, simulate_to
    from advercity.traffic.report import markdown, rows

    chosen = [read_spec(path) for path in specs]
    if table:
        found = list(reports(chosen))
        say(markdown(found))
    else:
        found = [simulate_to(spec, output, filmed=film) for spec in chosen]
        say(tables.table(rows(found)))
    problems = [f"{one.spec}: {problem}" for one in found for problem in one.problems]
    if problems:
        raise RunError("\n".join(problems))


@app.command()
def gallery(
    specs: SpecArgument,
    output: Annotated[Path, typer.Option(help="Picture to write.")] = Path("gallery.jpg"),
    weather: Annotated[
        list[str] | None, typer.Option(help="A file, or a library name; all that ship.")
    ] = None,
    agent: Annotated[str | None, typer.Option(help="Whose camera; the ego's.")] = None,
    camera: Annotated[int, typer.Option(min=0, help="Which of its cameras.")] = 0,
    frame: Annotated[
        int | None, typer.Option(min=0, help="Kept frame; the one in the middle.")
    ] = None,
    backend: BackendOption = "sapien",
    profile: Annotated[str, typer.Option(help="preview or full.")] = "preview",
) -> None:
    """Show one camera of scenarios under every weather, on one sheet."""
    from advercity.cli.progress import progress
    from advercity.compiler import find_weather, read_spec, shipped_weathers
    from advercity.runner.gallery import write_gallery

    chosen = [read_spec(path) for path in specs]
    weathers = [find_weather(name) for name in weather or shipped_weathers()]
    with progress(chosen, things="pictures") as view:
        write_gallery(
            chosen,
            weathers,
            output,
            agent=agent,
            camera=camera,
            frame=frame,
            backend=backend,
            profile=profile,
            report=view.advanced,
        )
    say(str(output))


@app.command()
def view(
    dataset: Annotated[Path, typer.Argument(help="A scenario of a dataset, or a .rrd recording.")],
    web: Annotated[bool, typer.Option("--web", help="In a browser instead of a window.")] = False,
    colour_clouds: ColourOption = "intensity",
) -> None:
    """Open a recording or a scenario of a dataset in Rerun."""
    from advercity.runner.replay import view as open_view
    from advercity.viewer.clouds import parse_cloud_colour

    open_view(dataset, web=web, cloud_colour=parse_cloud_colour(colour_clouds))


@app.command()
def verify(
    dataset: Annotated[
        str, typer.Argument(help="A dataset, or one scenario of it; also s3://bucket/folder.")
    ],
) -> None:
    """Check every file of a dataset against its manifests, and those against its index."""
    from advercity.dataset.index import Index
    from advercity.dataset.verification import verify_dataset

    if "://" in dataset:
        from advercity.dataset.remote import verify_store

        problems = verify_store(dataset)
    else:
        problems = verify_dataset(Path(dataset))
    if problems:
        raise RunError("\n".join(str(problem) for problem in problems))
    index = None if "://" in dataset else Index.of_folder(Path(dataset))
    note(f"every file is as its manifest says{f'; {index.told()}' if index else ''}")


@app.command()
def repair(
    dataset: DatasetArgument,
) -> None:
    """Make missing and changed files of a dataset again, with the checksums they had."""
    from advercity.cli.progress import progress
    from advercity.dataset.manifest import scenarios
    from advercity.dataset.reader import Scenario
    from advercity.runner import repair as mend

    with progress([Scenario(path).spec for path in scenarios(dataset)]) as view:
        left = mend(dataset, view.advanced)
    if left:
        what_to_do = {"extra": "not part of the dataset, delete it"}
        again = "`advercity run` with its spec makes the scenario again"
        lines = [f"{problem}; {what_to_do.get(problem.kind, again)}" for problem in left]
        raise RunError("\n".join(lines))
    note("every file is as its manifest says")


@app.command()
def stats(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="Folder for tables and plots.")] = Path("stats"),
) -> None:
    """Count what a dataset holds: tables as CSV, plots as PNG."""
    from advercity.dataset.facts import facts_of_dataset
    from advercity.dataset.plots import write_plots
    from advercity.dataset.statistics import tables, write_tables

    found = tables(facts_of_dataset(dataset))
    write_tables(found, output)
    write_plots(found, output)
    say(str(output))


@app.command()
def video(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="Folder for the films.")] = Path("videos"),
    kind: Annotated[
        list[str] | None, typer.Option(help="front, mosaic, semantic or lidar; all of them.")
    ] = None,
) -> None:
    """Film scenarios: front cameras, mosaic with boxes, semantics, LiDAR from above."""
    from advercity.dataset.video import KINDS, write_videos

    for path in write_videos(dataset, output, kind or KINDS):
        say(str(path))


@app.command()
def split(
    dataset: Annotated[Path, typer.Argument(help="A dataset.")],
    output: Annotated[Path, typer.Option(help="Folder for the splits.")] = Path("splits"),
    train: Annotated[str, typer.Option(help="Roads of this split.")] = "ri,rsnj,unj",
    validate: Annotated[str, typer.Option(help="Roads of this split.")] = "rcnj",
    test: Annotated[str, typer.Option(help="Roads of this split.")] = "ui",
) -> None:
    """Link scenarios into train, validate and test by their roads."""
    from advercity.dataset.splits import split as link

    roads = {"train": train, "validate": validate, "test": test}
    found = link(dataset, output, {name: text.split(",") for name, text in roads.items()})
    for name, members in found.items():
        say(f"{output / name}: {len(members)}")


@app.command()
def sheet(
    dataset: Annotated[Path, typer.Argument(help="A scenario of a dataset.")],
    output: Annotated[Path, typer.Option(help="Picture to write.")] = Path("contact_sheet.png"),
) -> None:
    """Put all cameras of one frame on a contact sheet."""
    from advercity.dataset.contact_sheet import write_contact_sheet

    write_contact_sheet(dataset, output)
    say(str(output))


@app.command()
def doctor() -> None:
    """Tell what this machine has and what is missing."""
    from advercity.cli.doctor import report

    text, healthy = report()
    say(text)
    if not healthy:
        raise typer.Exit(1)


@app.command()
def schema(
    kind: Annotated[str | None, typer.Argument(help="Kind of declaration, or spec.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for one file per kind.")] = None,
) -> None:
    """Print the JSON Schema of a kind of declaration, for editors."""
    from advercity.compiler.schema import schema_of, write_schemas

    if output is not None:
        write_schemas(output)
    elif kind is not None:
        say(schema_of(kind))
    else:
        raise InputError("name a kind to print, or give --output DIR to write them all")


@app.callback(invoke_without_command=True)
def version(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Adverse-weather V2X driving data, compiled from YAML."""
    if show_version:
        from advercity import __version__

        say(__version__)
        raise typer.Exit
