"""Commands for the cache: networks, traffic and scenes shared by runs."""

from typing import Annotated

import typer

from advercity.cli.output import print_data

cache = typer.Typer(
    name="cache",
    help="Networks, traffic and scenes shared by runs.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@cache.command()
def show() -> None:
    """Show the folder, content and size limit of the cache."""
    from advercity.cli.tables import format_columns
    from advercity.pipeline.cache import find_cache_folder
    from advercity.pipeline.cache_entries import describe_cache, find_size_limit
    from advercity.run_options import format_byte_size

    limit = format_byte_size(find_size_limit())
    print_data(f"{find_cache_folder()}, limit {limit} (ADVERCITY_CACHE_SIZE)")
    print_data(format_columns(describe_cache()))


@cache.command()
def clear() -> None:
    """Remove all entries; runs using them stop, later runs remake them."""
    from advercity.pipeline.cache_entries import clear_cache

    print_data(str(clear_cache()))


@cache.command()
def prune(
    size: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Limit, as '5 GB' (default: the limit of `show`)."),
    ] = None,
) -> None:
    """Remove the entries used longest ago until the rest is within a size, and leftovers.

    Entries used in the last hour stay.
    """
    from advercity.pipeline.cache_entries import find_size_limit, prune_cache
    from advercity.run_options import parse_byte_size

    limit_bytes = find_size_limit() if size is None else parse_byte_size("--size", size)
    print_data(str(prune_cache(limit_bytes)))
