"""Commands to simulate, render and show scenarios."""

from collections.abc import Generator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import Annotated

import typer

from advercity.cli.arguments import (
    AllowMissedOption,
    AllowMissingModelsOption,
    BackendOption,
    JsonOption,
    LayoutOption,
    SpecArgument,
    WeatherLibraryOption,
    load_specs,
    take_options,
)
from advercity.cli.output import EndedBySignal, print_data, print_remark, print_unread
from advercity.errors import InputError, RunError
from advercity.run_options import RunOptions, ViewerTarget

commands = typer.Typer()


@commands.command()
@take_options()
def run(
    specs: SpecArgument,
    options: RunOptions,
    keep: Annotated[
        bool, typer.Option("--keep", help="With --stream: serve it after the end, until Ctrl-C.")
    ] = False,
    web: Annotated[
        bool, typer.Option("--web", help="With --stream: serve a page for browsers, too.")
    ] = False,
    weather: Annotated[
        str | None,
        typer.Option(help="Replay under another weather: a file, or a name in the library."),
    ] = None,
    library: WeatherLibraryOption = None,
) -> None:
    """Run scenarios: traffic, sensors, dataset, live view."""
    from advercity import api
    from advercity.dataset.partial_files import refuse_other_run

    if (keep or web) and not options.stream:
        raise InputError(f"{'--keep' if keep else '--web'} needs --stream")
    loaded = load_specs(specs, weather=weather, library=library or ())
    if options.executor == "local":
        # Before the modules for simulation and rendering, which take seconds to load.
        refuse_other_run(options.folder, [spec.id for spec in loaded])

    from advercity.cli.progress import show_progress
    from advercity.viewer.viewer_process import (
        format_page_address,
        format_stream_address,
        open_page,
    )

    output = str(options.output)
    stream_address = format_stream_address()
    page = format_page_address(stream_address) if web else None
    with open_page(stream_address, map_tiles=options.map_tiles) if web else nullcontext():
        with _describe_interrupt(options), show_progress(loaded, page=page) as view:
            result = api.run_batch(loaded, options, listener=view)
        for scenario in result.scenarios:
            if scenario.error is None:
                print_data(f"{output.rstrip('/')}/{scenario.scenario}")
        result.raise_failures()
        if keep:
            _keep_serving(options.folder / loaded[0].id, options.viewer)


def _keep_serving(scenario: Path, viewer: ViewerTarget) -> None:
    """Serve the live view of a finished scenario until an interrupt."""
    from advercity.pipeline.replay import replay_scenario

    def wait() -> None:
        print_remark("the live view stays; Ctrl-C ends it")
        Event().wait()

    with suppress(KeyboardInterrupt):
        replay_scenario(scenario, viewer, then=wait)


@contextmanager
def _describe_interrupt(options: RunOptions) -> Generator[None]:
    """Add a remark on kept frames and resuming to an interrupt or termination signal."""

    def describe() -> str:
        if "://" not in str(options.output) and not options.folder.exists():
            return "no frame was finished"
        again = "the same command without --fresh" if options.fresh else "the same command"
        return f"finished frames are kept in {options.output}, and {again} makes the others"

    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(describe()) from None
    except EndedBySignal as ended:
        raise EndedBySignal(ended.number, describe()) from None


@commands.command()
@take_options(
    *("output", "backend", "profile", "scale", "sensors", "agents", "frames", "rate_hz", "jobs")
)
def estimate(specs: SpecArgument, options: RunOptions, as_json: JsonOption = False) -> None:
    """Estimate files, time and memory of a run.

    Finished frames in the output are left out. Simulates the traffic. The time is unknown until a
    comparable run was made on this machine.
    """
    from advercity.cli import tables
    from advercity.pipeline.estimate import estimate_run
    from advercity.pipeline.executors import validate_batch
    from advercity.pipeline.preparation import resolve_backend

    loaded = load_specs(specs)
    options = resolve_backend(options)
    validate_batch(loaded, options)
    found = estimate_run(loaded, options)
    if as_json:
        scenarios = [asdict(item) for item in found.estimates]
        print_data(tables.format_json({"scenarios": scenarios, "total": asdict(found.total)}))
    else:
        rows = [item.to_row() for item in (*found.estimates, found.total)]
        print_data(tables.format_columns(rows))
    for excess in found.describe_excess(options.folder):
        print_remark(f"run needs --allow-large: {excess}")
    if found.errors:
        raise RunError(*map(str, found.errors))


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
    from advercity.conflicts.report import TrafficReport, build_table_rows, format_markdown_table
    from advercity.pipeline.traffic_report import compute_traffic_reports, simulate_to_folder

    loaded = load_specs(specs)
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
            rows = build_table_rows(reports)
            print_data(tables.format_columns(rows, max_width=tables.MAX_WIDTH))
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
    from advercity.compiler import find_weather, list_weathers
    from advercity.pipeline.weather_gallery import write_weather_gallery

    loaded = load_specs(specs)
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
@take_options("cloud_colour", "map_tiles")
def view(
    shown: Annotated[
        str,
        typer.Argument(help="A scenario of a dataset, a .rrd recording, or a live view's address."),
    ],
    options: RunOptions,
    web: Annotated[bool, typer.Option("--web", help="In a browser instead of a window.")] = False,
    analytics: Annotated[
        bool, typer.Option("--analytics", help="Let Rerun send usage data, if it is set up so.")
    ] = False,
    layout: LayoutOption = None,
) -> None:
    """Open a recording, a scenario or a live view."""
    from advercity.pipeline.replay import open_viewer

    print_unread(Path(shown), layout)
    open_viewer(
        shown,
        web=web,
        cloud_colour=options.cloud_colour,
        map_tiles=options.map_tiles,
        analytics=analytics,
        layout=layout,
    )
