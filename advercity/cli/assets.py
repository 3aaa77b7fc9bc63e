"""The commands about bodies: the asset pack, the list, contact sheets."""

from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.output import note, say
from advercity.errors import InputError, RunError

assets = typer.Typer(
    name="assets",
    help="3-D models that bodies are made of.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
LibraryOption = Annotated[
    list[Path] | None,
    typer.Option(help="Folders of declarations whose catalogues count; else what ships."),
]


@assets.command()
def install(
    optional: Annotated[
        bool, typer.Option("--optional", help="Where that cannot be done, say so and go on.")
    ] = False,
) -> None:
    """Fetch Debian's free furniture models, for bodies.

    Needs apt, but not root.
    """
    from advercity.runner.bodies import catalogue_blueprints
    from advercity.runner.cache import shelf

    here = shelf()
    try:
        if not here.has_pack:
            note("fetching the asset pack (120 MB)")
            here.install()
    except RunError as error:
        if not optional:
            raise
        say(f"bodies: shaped by the program ({error})")
        return
    found = {name: here.find(blueprint) for name, blueprint in catalogue_blueprints().items()}
    count = sum(path is not None for path in found.values())
    say(f"bodies: {count} of {len(found)} made of models, the rest shaped by the program")


@assets.command()
def add(
    models: Annotated[list[Path], typer.Argument(help="GLB files that a catalogue names.")],
) -> None:
    """Keep models of your own where runs find them, by checksum."""
    from advercity.runner.cache import shelf

    for path in models:
        say(f"{shelf().keep(path)}  {path}")


@assets.command()
def remove() -> None:
    """Forget the asset pack; bodies are shaped by the program again."""
    from advercity.runner.cache import shelf

    shelf().remove()
    note("bodies are shaped by the program")


@assets.command("list")
def list_(library: LibraryOption = None) -> None:
    """List bodies with triangles, memory, source and licence."""
    from advercity.cli.tables import table
    from advercity.runner.bodies import catalogue_blueprints, facts_of
    from advercity.runner.cache import shelf

    here = shelf()
    rows = [facts_of(*item, here) for item in catalogue_blueprints(*library or ()).items()]
    say(table([row.told() for row in rows]))
    mib = sum(row.size_mib for row in rows)
    say(f"{len(rows)} bodies, {sum(row.triangles for row in rows)} triangles, {mib:.1f} MiB")


@assets.command()
def sheet(
    blueprints: Annotated[list[str] | None, typer.Argument(help="Names of blueprints.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All of them.")] = False,
    output: Annotated[Path, typer.Option(help="Picture to write.")] = Path("bodies.png"),
    library: LibraryOption = None,
    backend: Annotated[str, typer.Option(help="Rendering backend.")] = "sapien",
) -> None:
    """Picture bodies from four sides, by day and by night."""
    from advercity.pictures import write_picture
    from advercity.rendering.registry import load_backend
    from advercity.runner.bodies import catalogue_blueprints, chosen
    from advercity.runner.body_sheet import body_sheet
    from advercity.runner.cache import shelf

    if bool(blueprints) == every:
        raise InputError("name blueprints to picture, or give --all")
    wanted = chosen(catalogue_blueprints(*library or ()), blueprints or [])
    write_picture(body_sheet(wanted, load_backend(backend), shelf()), output)
    say(str(output))
