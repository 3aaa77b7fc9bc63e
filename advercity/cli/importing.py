"""Commands that import recorded traffic."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from advercity.cli.output import print_data, print_remark
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity_dsl import Spec

imports = typer.Typer(
    name="import",
    help="Take over traffic that others recorded.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
OutputOption = Annotated[
    Path, typer.Option(help="Folder for road, suite, table, map and specs.", file_okay=False)
]
MapOption = Annotated[
    Path | None, typer.Option("--map", help="Map: OpenDRIVE, OpenStreetMap or SUMO network.")
]
NameOption = Annotated[
    str | None, typer.Option(help="Id of road and suite (default: name of the file).")
]
EgoOption = Annotated[str | None, typer.Option(help="Track of the ego.")]
ConnectedOption = Annotated[
    list[str] | None,
    typer.Option(help="Track of another connected vehicle; may be given again (else the nearest)."),
]
CountOption = Annotated[
    int, typer.Option(min=0, max=20, help="Number of the nearest vehicles that are connected, too.")
]
FromOption = Annotated[
    float | None,
    typer.Option("--from", help="Time of the recording at the first frame, s (default: ego's)."),
]
ToOption = Annotated[
    float | None, typer.Option("--to", help="Time of the recording at the end, s (default: ego's).")
]
OffsetOption = Annotated[
    tuple[float, float],
    typer.Option(metavar="EAST NORTH", help="Metres by which the recording is moved to the map."),
]
TurnOption = Annotated[
    float,
    typer.Option(help="Degrees by which it is turned counter-clockwise before it is moved."),
]
WeatherOption = Annotated[
    list[str] | None,
    typer.Option(help="Weather of the library; may be repeated (default: clear_day)."),
]
RigOption = Annotated[str, typer.Option(help="Sensors of the connected vehicles.")]
LooksOption = Annotated[
    Literal["full", "shaped"],
    typer.Option(help="Models and photographs of packages (full), or generated ones (shaped)."),
]
LandUseOption = Annotated[Literal["urban", "rural"], typer.Option(help="Land use of the site.")]
OriginOption = Annotated[
    tuple[float, float],
    typer.Option(metavar="LAT LON", help="Latitude and longitude of the map's origin, degrees."),
]


@imports.command()
def trajectories(
    file: Annotated[Path, typer.Argument(help="Table: CSV or Parquet.")],
    output: OutputOption,
    map_: MapOption = None,
    name: NameOption = None,
    ego: EgoOption = None,
    connected: ConnectedOption = None,
    connected_count: CountOption = 2,
    from_: FromOption = None,
    to: ToOption = None,
    offset: OffsetOption = (0.0, 0.0),
    turn: TurnOption = 0.0,
    weather: WeatherOption = None,
    rig: RigOption = "adver_city",
    looks: LooksOption = "full",
    land_use: LandUseOption = "urban",
    origin: OriginOption = (0.0, 0.0),
) -> None:
    """Make scenarios of a table of trajectories.

    Reads the layouts of inD and INTERACTION, and one of its own: id, class, time_s, x_m, y_m,
    heading_deg, length_m, width_m, height_m.
    """
    from advercity.compiler.recorded_roads import (
        ReplayChoice,
        load_recorded_table,
        write_recorded_road,
    )

    choice = ReplayChoice(
        name=name,
        ego=ego,
        connected=connected or (),
        connected_count=connected_count,
        from_s=from_,
        to_s=to,
        offset_m=offset,
        turn_deg=turn,
        weathers=weather or ("clear_day",),
        rig=rig,
        looks=looks,
        land_use=land_use,
        origin_deg=origin,
    )
    if map_ is None:
        raise InputError("give the map on which the vehicles drive with --map")
    _report(write_recorded_road(load_recorded_table(file), map_, choice, output), output)


@imports.command()
def openscenario(
    file: Annotated[Path, typer.Argument(help="OpenSCENARIO XML 1.x (*.xosc).")],
    output: OutputOption,
    map_: MapOption = None,
    name: NameOption = None,
    ego: EgoOption = None,
    connected: ConnectedOption = None,
    connected_count: CountOption = 2,
    from_: FromOption = None,
    to: ToOption = None,
    weather: WeatherOption = None,
    rig: RigOption = "adver_city",
    looks: LooksOption = "full",
    land_use: LandUseOption = "urban",
    origin: OriginOption = (0.0, 0.0),
) -> None:
    """Make scenarios of an OpenSCENARIO file.

    Its actors must follow trajectories by time: maneuvers with controllers, and triggers other than
    times, are refused by name and line. The map is the OpenDRIVE file that it names, unless --map
    gives another one.
    """
    from advercity.compiler.recorded_roads import (
        ReplayChoice,
        load_recorded_scenario,
        write_recorded_road,
    )

    choice = ReplayChoice(
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
    recording = load_recorded_scenario(file)
    for remark in recording.remarks:
        print_remark(remark)
    _report(write_recorded_road(recording, map_, choice, output), output)


def _report(specs: "list[Spec]", output: Path) -> None:
    """Write the specs, and print their paths and what actors are connected vehicles."""
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
    for spec in specs:
        print_data(str(folder / f"{spec.id}.json"))
