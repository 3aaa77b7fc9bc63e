"""Commands to import maps and recorded traffic of other projects."""

import inspect
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from advercity.cli.output import print_data, print_left_out, print_remark, update_status
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity_dsl import Spec

    from advercity.compiler.recorded_roads import Recording, ReplayChoice

imports = typer.Typer(
    name="import",
    help="Import maps and recorded traffic.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
OutputOption = Annotated[
    Path | None, typer.Option(help="Folder for road, suite, table, map and specs.", file_okay=False)
]
MapOption = Annotated[
    Path | None, typer.Option("--map", help="Map: OpenDRIVE, OpenStreetMap or SUMO network.")
]


def _build_choice(
    name: Annotated[
        str | None, typer.Option(help="Id of road and suite (default: name of the file).")
    ] = None,
    ego: Annotated[str | None, typer.Option(help="Track of the ego.")] = None,
    connected: Annotated[
        list[str] | None,
        typer.Option(
            help="Track of another connected vehicle; may be given again (else the nearest)."
        ),
    ] = None,
    connected_count: Annotated[
        int,
        typer.Option(min=0, max=20, help="Number of nearest vehicles to connect, too."),
    ] = 2,
    from_: Annotated[
        float | None,
        typer.Option(
            "--from", help="Time of the recording at the first frame, s (default: ego's)."
        ),
    ] = None,
    to: Annotated[
        float | None,
        typer.Option("--to", help="Time of the recording at the end, s (default: ego's)."),
    ] = None,
    weather: Annotated[
        list[str] | None,
        typer.Option(help="Weather of the library; may be repeated (default: clear_day)."),
    ] = None,
    rig: Annotated[str, typer.Option(help="Sensors of the connected vehicles.")] = "adver_city",
    looks: Annotated[
        Literal["full", "shaped"],
        typer.Option(help="Models and photographs of packages (full), or generated ones (shaped)."),
    ] = "full",
    land_use: Annotated[
        Literal["urban", "rural"], typer.Option(help="Land use of the site.")
    ] = "urban",
    origin: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LAT LON",
            help="Latitude and longitude of the map's origin, degrees (default: the map's).",
        ),
    ] = None,
) -> "ReplayChoice":
    from advercity.compiler.recorded_roads import ReplayChoice

    return ReplayChoice(
        name=name,
        ego=ego,
        connected=connected or (),
        connected_count=connected_count,
        from_s=from_,
        to_s=to,
        weathers=weather or ("clear_day",),
        rig=rig,
        looks=looks,
        land_use=land_use,
        origin_deg=origin,
    )


def _with_choice(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `_build_choice`, and its result as the argument `choice`."""
    options = inspect.signature(_build_choice).parameters
    own = inspect.signature(command).parameters
    signature = inspect.Signature(
        [*(item for name, item in own.items() if name != "choice"), *options.values()]
    )

    def run(**values: Any) -> None:
        from advercity.dataset.scenario_folders import check_is_outside_datasets

        if values["output"] is not None:
            check_is_outside_datasets(values["output"])
        choice = _build_choice(**{name: values.pop(name) for name in options})
        command(**values, choice=choice)

    # Typer takes options from the signature, and help from the docstring.
    run.__signature__ = signature  # pyright: ignore[reportFunctionMemberAccess]
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    return run


SuggestOption = Annotated[
    bool, typer.Option("--suggest", help="Print the conflicts of each junction, and the YAML.")
]
DeclarationsOption = Annotated[
    Path | None,
    typer.Option("--output", help="Folder for road, suite and a copy of the map.", file_okay=False),
]
NameOption = Annotated[
    str | None, typer.Option(help="Id of road and suite (default: name of the file).")
]


@imports.command()
def osm(
    file: Annotated[Path, typer.Argument(help="Extract of OpenStreetMap (*.osm).")],
    suggest: SuggestOption = False,
    output: DeclarationsOption = None,
    name: NameOption = None,
) -> None:
    """Suggest conflicts at the junctions of an OpenStreetMap extract."""
    _suggest(file, "osm", name, output, is_printed=suggest)


@imports.command()
def opendrive(
    file: Annotated[Path, typer.Argument(help="OpenDRIVE file (*.xodr).")],
    suggest: SuggestOption = False,
    output: DeclarationsOption = None,
    name: NameOption = None,
) -> None:
    """Suggest conflicts at the junctions of an OpenDRIVE file."""
    _suggest(file, "opendrive", name, output, is_printed=suggest)


@imports.command()
def lanelet2(
    file: Annotated[Path, typer.Argument(help="Lanelet2 map (*.osm).")],
    suggest: SuggestOption = False,
    output: DeclarationsOption = None,
    name: NameOption = None,
) -> None:
    """Suggest conflicts at the junctions of a Lanelet2 map."""
    _suggest(file, "lanelet2", name, output, is_printed=suggest)


@imports.command()
def sumo_network(
    file: Annotated[Path, typer.Argument(help="Network of SUMO (*.net.xml).")],
    suggest: SuggestOption = False,
    output: DeclarationsOption = None,
    name: NameOption = None,
) -> None:
    """Suggest conflicts at the junctions of a SUMO network."""
    _suggest(file, "sumo", name, output, is_printed=suggest)


def _suggest(
    file: Path,
    source: Literal["osm", "opendrive", "lanelet2", "sumo"],
    name: str | None,
    output: Path | None,
    *,
    is_printed: bool,
) -> None:
    from advercity.cli import tables
    from advercity.compiler.map_suggestions import suggest_conflicts, write_suggestions
    from advercity.dataset.scenario_folders import check_is_outside_datasets
    from advercity.foreign.ledger import describe_left_out

    if not is_printed and output is None:
        raise InputError("give --suggest to print suggestions, or --output DIR to write them")
    if output is not None:
        check_is_outside_datasets(output)

    def on_junction(done: int, total: int) -> None:
        update_status(f"{file.name}: {done} of {total} junctions")

    found = suggest_conflicts(file, source, name, on_junction=on_junction)
    print_remark(f"{file}: traffic drives on the {found.driving_side}")
    if found.untried_count:
        remark = "declare `extent_m` to try others, or place agents at one of them"
        print_remark(f"{found.untried_count} smaller junctions are not tried; {remark}")
    if found.left_out:
        print_remark(f"{file}: left out: {describe_left_out(found.left_out)}")
    rows = [
        {
            "junction": item.junction,
            "control": item.control,
            "arms": item.arms,
            "stages": ", ".join(item.conflicts) or f"nothing: {item.reason}",
        }
        for item in found.junctions
    ]
    if is_printed:
        print_data(tables.format_columns(rows))
        for title, text in found.documents.items():
            print_data(f"\n# {title}\n{text.rstrip()}")
    if output is not None:
        for path in write_suggestions(found, file, output):
            print_remark(str(path))
        if found.documents:
            print_remark(f"next: advercity compile library {output} --suite {found.suite} --settle")


@imports.command()
@_with_choice
def trajectories(
    choice: "ReplayChoice",
    file: Annotated[Path, typer.Argument(help="Table: CSV or Parquet.")],
    output: OutputOption = None,
    map_: MapOption = None,
    offset: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="EAST NORTH", help="Metres by which the recording is moved to the map."
        ),
    ] = (0.0, 0.0),
    turn: Annotated[
        float,
        typer.Option(help="Degrees by which it is turned counter-clockwise before it is moved."),
    ] = 0.0,
) -> None:
    """Make scenarios of a table of trajectories.

    Reads the layouts of inD, highD and INTERACTION, and one of its own: id, class, time_s, x_m,
    y_m, heading_deg, length_m, width_m, height_m.
    """
    from advercity.compiler.recorded_roads import load_recorded_table

    if map_ is None:
        raise InputError("give the map on which the vehicles drive with --map")
    moved = replace(choice, offset_m=offset, turn_deg=turn)
    _write(load_recorded_table(file), map_, moved, output)


@imports.command()
@_with_choice
def openscenario(
    choice: "ReplayChoice",
    file: Annotated[Path, typer.Argument(help="OpenSCENARIO XML 1.x (*.xosc).")],
    output: OutputOption = None,
    map_: MapOption = None,
    root: Annotated[
        Path | None,
        typer.Option(
            help="Folder in which its catalogues must be (default: the one above the file's)."
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="Parameter of the scenario; may be given again."
        ),
    ] = None,
) -> None:
    """Make scenarios of an OpenSCENARIO file.

    Plays the file: actors follow lanes, routes and trajectories, change speed and lane, and events
    begin when their conditions hold. Unsupported parts are an error with name and line. The map is
    the OpenDRIVE file named in the scenario, unless --map gives another one.
    """
    from advercity.compiler.recorded_roads import load_recorded_scenario

    parameters = dict(_split_parameter(text) for text in set_ or ())
    recording = load_recorded_scenario(file, map_, root=root, parameters=parameters)
    _write(recording, map_, choice, output)


@imports.command()
@_with_choice
def sumo(
    choice: "ReplayChoice",
    file: Annotated[Path, typer.Argument(help="SUMO configuration (*.sumocfg).")],
    output: OutputOption = None,
) -> None:
    """Make scenarios of a SUMO simulation.

    SUMO runs it once; vehicles, people and lights are recorded from --from to --to, by default the
    first 300 s. SUMO's own output files are not written. Parts left out are listed. A simulation
    driven by another program is an error.
    """
    from tempfile import TemporaryDirectory

    from advercity.traffic.sumo_scenarios import load_sumo_scenario

    with TemporaryDirectory() as name:
        recording = load_sumo_scenario(file, Path(name), from_s=choice.from_s, to_s=choice.to_s)
        _write(recording, None, choice, output)


def _split_parameter(text: str) -> tuple[str, str]:
    name, separator, value = text.partition("=")
    if not (name and separator):
        raise InputError(f"`set` {text[:40]}: write NAME=VALUE")
    return name, value


def _write(
    recording: "Recording", map_file: Path | None, choice: "ReplayChoice", output: Path | None
) -> None:
    """Write a library and its specs; without a folder, raise an error with the ego's id."""
    from advercity.compiler.recorded_roads import find_ego, write_recorded_road

    if output is None:
        ego = find_ego(recording.tracks, choice)
        raise InputError(
            f"the ego is {ego.id}; give a folder for road, map and specs: --output DIR"
        )
    _report(write_recorded_road(recording, map_file, choice, output), output)


def _report(specs: "list[Spec]", output: Path) -> None:
    """Write the specs; print their paths and the tracks of connected vehicles."""
    from advercity_dsl import Vehicle

    from advercity.compiler import write_specs
    from advercity.compiler.recorded_roads import SPECS_FOLDER

    folder = output / SPECS_FOLDER
    counts = write_specs(specs, folder)
    road = specs[0].road
    followed = ", ".join(
        f"{agent.id} is {agent.place.track}"
        for agent in specs[0].agents
        if isinstance(agent.place, Vehicle)
    )
    print_remark(f"road '{road.id}' in {output}: {followed}")
    print_remark(f"{len(specs)} spec{'' if len(specs) == 1 else 's'} in {folder}: {counts}")
    print_left_out(specs)
    for spec in specs:
        print_data(str(folder / f"{spec.id}.json"))
