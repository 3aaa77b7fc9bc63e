"""Commands about bodies: asset pack, list, contact sheets."""

from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.output import print_data, print_note
from advercity.errors import InputError, RunError

assets = typer.Typer(
    name="assets",
    help="3-D models that bodies are made of.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
LibraryOption = Annotated[
    list[Path] | None,
    typer.Option(help="Folders of declarations with catalogues (default: what ships)."),
]


@assets.command()
def install(
    allow_failure: Annotated[
        bool, typer.Option("--allow-failure", help="Exit with 0 if the pack cannot be fetched.")
    ] = False,
) -> None:
    """Fetch Debian's free furniture models, for bodies.

    Needs apt, but not root.
    """
    from advercity.assets.catalogue import load_catalogue_blueprints
    from advercity.pipeline.cache import open_model_store

    store = open_model_store()
    try:
        if not store.has_package:
            print_note("fetching the asset pack (120 MB)")
            store.install_package()
    except RunError as error:
        if not allow_failure:
            raise
        print_data(f"bodies: procedural ({error})")
        return
    found = {
        name: store.prepare_model(blueprint)
        for name, blueprint in load_catalogue_blueprints().items()
    }
    count = sum(path is not None for path in found.values())
    print_data(f"bodies: {count} of {len(found)} are models, the rest procedural")


@assets.command()
def add(
    models: Annotated[list[Path], typer.Argument(help="GLB files that a catalogue names.")],
) -> None:
    """Add models of your own to the store, by checksum."""
    from advercity.pipeline.cache import open_model_store

    for path in models:
        print_data(f"{open_model_store().add_model(path)}  {path}")


@assets.command()
def remove() -> None:
    """Remove the asset pack; bodies are procedural again."""
    from advercity.pipeline.cache import open_model_store

    open_model_store().remove_package()
    print_note("bodies are procedural")


@assets.command("list")
def list_(library: LibraryOption = None) -> None:
    """List bodies with triangles, memory, source and licence."""
    from advercity.assets.catalogue import compute_body_facts, load_catalogue_blueprints
    from advercity.cli.tables import format_columns
    from advercity.pipeline.cache import open_model_store

    store = open_model_store()
    rows = [
        compute_body_facts(*item, store)
        for item in load_catalogue_blueprints(*library or ()).items()
    ]
    print_data(format_columns([row.to_row() for row in rows]))
    mib = sum(row.size_mib for row in rows)
    print_data(f"{len(rows)} bodies, {sum(row.triangles for row in rows)} triangles, {mib:.1f} MiB")


@assets.command()
def sheet(
    blueprints: Annotated[list[str] | None, typer.Argument(help="Names of blueprints.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All of them.")] = False,
    output: Annotated[Path, typer.Option(help="Image file to write.")] = Path("bodies.png"),
    library: LibraryOption = None,
    backend: Annotated[str, typer.Option(help="Rendering backend.")] = "sapien",
) -> None:
    """Draw bodies from four sides, by day and by night."""
    from advercity.assets.catalogue import load_catalogue_blueprints, select_blueprints
    from advercity.media import write_image
    from advercity.pipeline.body_sheet import draw_body_sheet
    from advercity.pipeline.cache import open_model_store
    from advercity.rendering.backend import load_backend

    if bool(blueprints) == every:
        raise InputError("name blueprints to draw, or give --all")
    wanted = select_blueprints(load_catalogue_blueprints(*library or ()), blueprints or [])
    write_image(draw_body_sheet(wanted, load_backend(backend), open_model_store()), output)
    print_data(str(output))
