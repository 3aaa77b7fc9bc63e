"""Commands that simulate, render and show."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.arguments import (
    BackendOption,
    CloudColourOption,
    FramesOption,
    JobsOption,
    JsonOption,
    ProfileOption,
    ScaleOption,
    SpecArgument,
    parse_byte_size,
    parse_duration,
    parse_frame_slice,
)
from advercity.cli.output import print_data, print_note
from advercity.errors import InputError, RunError

commands = typer.Typer()


@commands.command()
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
    colour_clouds: CloudColourOption = "intensity",
    weather: Annotated[
        str | None, typer.Option(help="Replay under another weather: a file, or a library name.")
    ] = None,
    jobs: JobsOption = None,
    max_memory: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Memory of a process: 4 GB; by the plan."),
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
    """Run scenarios: traffic, sensors, dataset, live view."""
    from advercity.cli.progress import show_progress
    from advercity.compiler import find_weather, read_spec, with_weather
    from advercity.pipeline import (
        ResourceLimits,
        RunOptions,
        ViewerTarget,
        create_executor,
        raise_failures,
        run_batch,
    )
    from advercity.viewer.cloud_colours import parse_cloud_colour

    if sum((rrd is not None, stream, connect is not None)) > 1:
        raise InputError("--rrd, --stream and --connect exclude each other; give one")
    chosen = [read_spec(path) for path in specs]
    if weather is not None:
        other = find_weather(weather)
        chosen = [with_weather(spec, other) for spec in chosen]
    options = RunOptions(
        output=Path(output),
        backend=backend,
        profile=profile,
        scale=scale,
        frames=parse_frame_slice(frames),
        viewer=ViewerTarget(
            file=rrd,
            serve=stream,
            connect=connect,
            cloud_colour=parse_cloud_colour(colour_clouds),
        ),
        fresh=fresh,
        format=layout,
    )
    asked = ResourceLimits(
        memory_bytes=None if max_memory is None else parse_byte_size("--max-memory", max_memory),
        time_s=None if max_time is None else parse_duration("--max-time", max_time),
    )
    with show_progress(chosen) as view:
        outcomes = run_batch(
            chosen,
            options,
            jobs=jobs,
            limits=asked,
            allow_large=allow_large,
            executor=create_executor(executor, output=output, address=address),
            listener=view,
        )
    for outcome in outcomes:
        if outcome.error is None:
            print_data(f"{output.rstrip('/')}/{outcome.scenario}")
    raise_failures(outcomes)


@commands.command()
def plan(
    specs: SpecArgument,
    output: Annotated[
        Path,
        typer.Option(
            help="Folder for the dataset; what is there need not be made.", file_okay=False
        ),
    ] = Path("output"),
    backend: BackendOption = "sapien",
    profile: ProfileOption = "auto",
    scale: ScaleOption = None,
    frames: FramesOption = None,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Tell what running scenarios will take: bytes, time, memory.

    The first time it measures this machine, which takes a minute, and simulates the traffic.
    """
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.pipeline import RunOptions
    from advercity.pipeline.estimate import estimate_run
    from advercity.pipeline.executors import validate_batch

    chosen = [read_spec(path) for path in specs]
    options = RunOptions(output, backend, profile, scale, parse_frame_slice(frames))
    validate_batch(chosen, options)
    found = estimate_run(chosen, options, jobs=jobs, measure=True, simulate=True)
    if as_json:
        told = [asdict(item) for item in (*found.estimates, found.total)]
        print_data(tables.format_json({"scenarios": told[:-1], "total": told[-1]}))
    else:
        print_data(
            tables.format_columns([item.to_row() for item in (*found.estimates, found.total)])
        )
    for complaint in found.describe_excess(output):
        print_note(f"run asks for --allow-large: {complaint}")


@commands.command()
def simulate(
    specs: SpecArgument,
    output: Annotated[
        Path, typer.Option(help="Folder for traces and reports.", file_okay=False)
    ] = Path("traffic"),
    film: Annotated[bool, typer.Option(help="Film the moving plan, too.")] = True,
    table: Annotated[
        bool, typer.Option("--table", help="Only print the table, as Markdown; write nothing.")
    ] = False,
) -> None:
    """Simulate traffic alone; tell whether conflicts happened.

    Writes trace, report and moving plan of every scenario.
    """
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.conflicts.report import build_table_rows, format_markdown_table
    from advercity.pipeline.traffic_report import compute_traffic_reports, simulate_to_folder

    chosen = [read_spec(path) for path in specs]
    if table:
        found = list(compute_traffic_reports(chosen))
        print_data(format_markdown_table(found))
    else:
        found = [simulate_to_folder(spec, output, with_video=film) for spec in chosen]
        print_data(tables.format_columns(build_table_rows(found)))
    problems = [f"{one.spec}: {problem}" for one in found for problem in one.problems]
    if problems:
        raise RunError("\n".join(problems))


@commands.command()
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
    width: Annotated[int, typer.Option(min=64, max=1920, help="Of each picture, pixels.")] = 384,
) -> None:
    """Show one camera of scenarios under every weather, on one sheet."""
    from advercity.cli.progress import show_progress
    from advercity.compiler import find_weather, list_shipped_weathers, read_spec
    from advercity.pipeline.weather_gallery import write_weather_gallery

    chosen = [read_spec(path) for path in specs]
    weathers = [find_weather(name) for name in weather or list_shipped_weathers()]
    with show_progress(chosen, things="pictures") as view:
        write_weather_gallery(
            chosen,
            weathers,
            output,
            agent=agent,
            camera=camera,
            frame=frame,
            backend=backend,
            profile=profile,
            width_px=width,
            report=view.on_progress,
        )
    print_data(str(output))


@commands.command()
def view(
    dataset: Annotated[Path, typer.Argument(help="A scenario of a dataset, or a .rrd recording.")],
    web: Annotated[bool, typer.Option("--web", help="In a browser instead of a window.")] = False,
    colour_clouds: CloudColourOption = "intensity",
) -> None:
    """Open a recording or a scenario of a dataset in Rerun."""
    from advercity.pipeline.replay import open_viewer as open_view
    from advercity.viewer.cloud_colours import parse_cloud_colour

    open_view(dataset, web=web, cloud_colour=parse_cloud_colour(colour_clouds))
