"""Commands that simulate, render and show."""

from collections.abc import Generator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from advercity.cli.arguments import (
    AllowMissedOption,
    AllowMissingModelsOption,
    AutoBackendOption,
    BackendOption,
    CloudColourOption,
    FramesOption,
    JobsOption,
    JsonOption,
    LayoutOption,
    MapTilesOption,
    ProfileOption,
    ScaleOption,
    SpecArgument,
    WeatherLibraryOption,
    parse_frame_slice,
)
from advercity.cli.output import EndedBySignal, print_data, print_remark, print_unread
from advercity.errors import InputError, RunError

if TYPE_CHECKING:
    from advercity.pipeline import ViewerTarget

commands = typer.Typer()


@commands.command()
def run(
    specs: SpecArgument,
    output: Annotated[
        str, typer.Option(help="Folder for the dataset; with Ray also a URL: s3://bucket/folder.")
    ] = "output",
    backend: AutoBackendOption = "auto",
    profile: ProfileOption = "auto",
    scale: ScaleOption = None,
    frames: FramesOption = None,
    rrd: Annotated[Path | None, typer.Option(help="Write a Rerun recording.")] = None,
    stream: Annotated[bool, typer.Option("--stream", help="Serve the live view.")] = False,
    keep: Annotated[
        bool, typer.Option("--keep", help="With --stream: serve it after the end, until Ctrl-C.")
    ] = False,
    web: Annotated[
        bool, typer.Option("--web", help="With --stream: serve a page for browsers, too.")
    ] = False,
    connect: Annotated[str | None, typer.Option(help="Send to a running Rerun viewer.")] = None,
    cloud_colour: CloudColourOption = "intensity",
    map_tiles: MapTilesOption = False,
    weather: Annotated[
        str | None,
        typer.Option(help="Replay under another weather: a file, or a name in the library."),
    ] = None,
    library: WeatherLibraryOption = None,
    jobs: JobsOption = None,
    max_memory: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE", help="Memory limit per process, as '4 GB' (default: from the estimate)."
        ),
    ] = None,
    max_time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Time limit per scenario, as '2 h' (default: from the estimate)."
        ),
    ] = None,
    allow_large: Annotated[
        bool, typer.Option("--allow-large", help="Run even if it would fill the machine.")
    ] = False,
    allow_missing_models: AllowMissingModelsOption = False,
    allow_edited: Annotated[
        bool, typer.Option("--allow-edited", help="Run specs that were edited after compiling.")
    ] = False,
    allow_missed: AllowMissedOption = False,
    executor: Annotated[str, typer.Option(help="local, or ray for a cluster.")] = "local",
    ray_address: Annotated[
        str | None,
        typer.Option(help="Ray cluster: auto, or HOST:PORT (default: one on this machine)."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start over; discard finished frames.")
    ] = False,
    layout: Annotated[str, typer.Option("--format", help="opv2v or adver_city.")] = "opv2v",
    min_points: Annotated[
        int,
        typer.Option(min=0, help="Annotate only objects with so many LiDAR points of an agent."),
    ] = 0,
    clouds: Annotated[
        str, typer.Option(help="Encoding of PCD files: binary or binary_compressed.")
    ] = "binary_compressed",
) -> None:
    """Run scenarios: traffic, sensors, dataset, live view."""
    from advercity import api
    from advercity.dataset.partial_files import refuse_other_run

    if sum((rrd is not None, stream, connect is not None)) > 1:
        raise InputError("--rrd, --stream and --connect exclude each other; give one")
    if (keep or web) and not stream:
        raise InputError(f"{'--keep' if keep else '--web'} needs --stream")
    if not output:
        raise InputError("--output is empty; give a folder, `.` for this one")
    loaded = [api.load_spec(path, weather=weather, library=library or ()) for path in specs]
    if executor == "local":
        # Before the modules that simulate and render, which take seconds to load.
        refuse_other_run(Path(output), [spec.id for spec in loaded])

    from advercity.cli.progress import show_progress
    from advercity.dataset.cloud_files import parse_cloud_encoding
    from advercity.pipeline import ResourceLimits, ViewerTarget
    from advercity.pipeline.options import parse_byte_size, parse_duration
    from advercity.viewer.cloud_colours import parse_cloud_colour
    from advercity.viewer.viewer_process import (
        format_page_address,
        format_stream_address,
        open_page,
    )

    limits = ResourceLimits(
        memory_bytes=None if max_memory is None else parse_byte_size("--max-memory", max_memory),
        time_s=None if max_time is None else parse_duration("--max-time", max_time),
    )
    viewer = ViewerTarget(
        rrd, stream, connect, parse_cloud_colour(cloud_colour), map_tiles=map_tiles
    )
    stream_address = format_stream_address()
    page = format_page_address(stream_address) if web else None
    with open_page(stream_address, map_tiles=map_tiles) if web else nullcontext():
        with _describe_interrupt(output, fresh=fresh), show_progress(loaded, page=page) as view:
            result = api.run(
                loaded,
                output,
                backend=backend,
                profile=profile,
                scale=scale,
                frames=parse_frame_slice(frames),
                format=layout,
                min_points=min_points,
                clouds=parse_cloud_encoding(clouds),
                fresh=fresh,
                viewer=viewer,
                jobs=jobs,
                limits=limits,
                allow_large=allow_large,
                allow_missing_models=allow_missing_models,
                allow_edited=allow_edited,
                allow_missed=allow_missed,
                executor=executor,
                ray_address=ray_address,
                listener=view,
                check=False,
            )
        for scenario in result.scenarios:
            if scenario.error is None:
                print_data(f"{output.rstrip('/')}/{scenario.scenario}")
        result.raise_failures()
        if keep:
            _keep_serving(Path(output, loaded[0].id), viewer)


def _keep_serving(scenario: Path, viewer: "ViewerTarget") -> None:
    """Serve the live view of a finished scenario until an interrupt."""
    from advercity.pipeline.replay import replay_scenario

    def wait() -> None:
        print_remark("the live view stays; Ctrl-C ends it")
        Event().wait()

    with suppress(KeyboardInterrupt):
        replay_scenario(scenario, viewer, then=wait)


@contextmanager
def _describe_interrupt(output: str, *, fresh: bool) -> Generator[None]:
    """Add to an interrupt, or another signal to end, what is kept and how to go on."""

    def describe() -> str:
        if "://" not in output and not Path(output).exists():
            return "no frame was finished"
        again = "the same command without --fresh" if fresh else "the same command"
        return f"finished frames are kept in {output}, and {again} makes the others"

    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(describe()) from None
    except EndedBySignal as ended:
        raise EndedBySignal(ended.number, describe()) from None


@commands.command()
def estimate(
    specs: SpecArgument,
    output: Annotated[
        Path,
        typer.Option(help="Folder for the dataset; its frames are done.", file_okay=False),
    ] = Path("output"),
    backend: AutoBackendOption = "auto",
    profile: ProfileOption = "auto",
    scale: ScaleOption = None,
    frames: FramesOption = None,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate files, time and memory of a run.

    Simulates the traffic. The time is unknown until a comparable run was made on this machine.
    """
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.pipeline import RunOptions
    from advercity.pipeline.estimate import estimate_run
    from advercity.pipeline.executors import validate_batch
    from advercity.pipeline.preparation import resolve_backend

    loaded = [read_spec(path) for path in specs]
    options = resolve_backend(
        RunOptions(output, backend, profile, scale, parse_frame_slice(frames))
    )
    validate_batch(loaded, options)
    found = estimate_run(loaded, options, jobs=jobs)
    if as_json:
        scenarios = [asdict(item) for item in found.estimates]
        print_data(tables.format_json({"scenarios": scenarios, "total": asdict(found.total)}))
    else:
        rows = [item.to_row() for item in (*found.estimates, found.total)]
        print_data(tables.format_columns(rows))
    for excess in found.describe_excess(output):
        print_remark(f"run needs --allow-large: {excess}")


@commands.command()
def simulate(
    specs: SpecArgument,
    output: Annotated[
        Path, typer.Option(help="Folder for traces and reports.", file_okay=False)
    ] = Path("traffic"),
    video: Annotated[bool, typer.Option(help="Make a video of the moving plan, too.")] = True,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Only print the table as Markdown; write no files.")
    ] = False,
    allow_missed: AllowMissedOption = False,
) -> None:
    """Simulate traffic alone; report whether conflicts happened.

    Writes trace, report and moving plan of every scenario.
    """
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.conflicts.report import TrafficReport, build_table_rows, format_markdown_table
    from advercity.pipeline.traffic_report import compute_traffic_reports, simulate_to_folder

    loaded = [read_spec(path) for path in specs]
    reports: list[TrafficReport] = []
    problems: list[str] = []
    if markdown:
        reports += compute_traffic_reports(loaded)
        print_data(format_markdown_table(reports))
    else:
        for spec in loaded:
            try:
                reports.append(simulate_to_folder(spec, output, with_video=video))
            except RunError as error:
                problems.append(str(error))
        if reports:
            print_data(tables.format_columns(build_table_rows(reports)))
    missed = [f"{report.spec}: {problem}" for report in reports for problem in report.problems]
    if allow_missed and missed:
        print_remark("\n".join(missed))
    else:
        problems += missed
    if problems:
        raise RunError(*problems)


@commands.command()
def gallery(
    specs: SpecArgument,
    output: Annotated[Path, typer.Option(help="Image file to write.")] = Path("gallery.jpg"),
    weather: Annotated[
        list[str] | None,
        typer.Option(help="A file, or a name in the library (default: all of the library)."),
    ] = None,
    library: WeatherLibraryOption = None,
    agent: Annotated[str | None, typer.Option(help="Agent with the camera (default: ego).")] = None,
    camera: Annotated[int, typer.Option(min=0, help="Index of the camera.")] = 0,
    frame: Annotated[
        int | None, typer.Option(min=0, help="Recorded frame (default: the middle one).")
    ] = None,
    backend: BackendOption = "sapien",
    profile: Annotated[str, typer.Option(help="preview or full.")] = "preview",
    width: Annotated[int, typer.Option(min=64, max=1920, help="Image width in pixels.")] = 384,
    allow_missing_models: AllowMissingModelsOption = False,
) -> None:
    """Draw one camera of scenarios in every weather into one image."""
    from advercity.cli.progress import show_progress
    from advercity.compiler import find_weather, list_weathers, read_spec
    from advercity.pipeline.weather_gallery import write_weather_gallery

    loaded = [read_spec(path) for path in specs]
    folders = library or ()
    named = [find_weather(name, *folders) for name in weather or ()]
    with show_progress(loaded, things="images") as view:
        write_weather_gallery(
            loaded,
            named or list_weathers(*folders),
            output,
            agent=agent,
            camera=camera,
            frame=frame,
            backend=backend,
            profile=profile,
            width_px=width,
            allow_missing_models=allow_missing_models,
            report=view.on_progress,
        )
    print_data(str(output))


@commands.command()
def compare(
    spec: Annotated[Path, typer.Argument(help="Compiled scenario.", dir_okay=False)],
    output: Annotated[Path, typer.Option(help="PNG to write.", dir_okay=False)] = Path(
        "comparison.png"
    ),
    backends: Annotated[
        str, typer.Option(help="Names, separated by commas; the last is the reference.")
    ] = "sapien,mitsuba",
    agent: Annotated[str | None, typer.Option(help="Agent with the camera (default: ego).")] = None,
    camera: Annotated[int, typer.Option(min=0, help="Index of the camera.")] = 0,
    frame: Annotated[
        int | None, typer.Option(min=0, help="Recorded frame (default: the middle one).")
    ] = None,
    profile: Annotated[str, typer.Option(help="preview or full.")] = "preview",
    width: Annotated[int, typer.Option(min=64, max=1920, help="Image width in pixels.")] = 480,
    allow_missing_models: AllowMissingModelsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Render one camera with several backends and compare them."""
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.pipeline.backend_comparison import compare_backends

    found = compare_backends(
        read_spec(spec),
        [name.strip() for name in backends.split(",")],
        output,
        agent=agent,
        camera=camera,
        frame=frame,
        profile=profile,
        width_px=width,
        allow_missing_models=allow_missing_models,
    )
    if as_json:
        print_data(tables.format_json(asdict(found)))
        return
    print_data(tables.format_columns(found.to_rows()))
    for name, same, actors in zip(
        found.backends, found.semantic_agreement, found.instance_agreement, strict=False
    ):
        print_remark(f"{name}: same class in {same:.2%} of pixels, same actor in {actors:.2%}")
    print_remark(f"pictures: {output}")


@commands.command()
def view(
    shown: Annotated[
        str,
        typer.Argument(help="A scenario of a dataset, a .rrd recording, or a live view's address."),
    ],
    web: Annotated[bool, typer.Option("--web", help="In a browser instead of a window.")] = False,
    cloud_colour: CloudColourOption = "intensity",
    map_tiles: MapTilesOption = False,
    analytics: Annotated[
        bool, typer.Option("--analytics", help="Let Rerun send usage data, if it is set up so.")
    ] = False,
    layout: LayoutOption = None,
) -> None:
    """Open a recording, a scenario or a live view."""
    from advercity.pipeline.replay import open_viewer
    from advercity.viewer.cloud_colours import parse_cloud_colour

    print_unread(Path(shown), layout)
    open_viewer(
        shown,
        web=web,
        cloud_colour=parse_cloud_colour(cloud_colour),
        map_tiles=map_tiles,
        analytics=analytics,
        layout=layout,
    )
