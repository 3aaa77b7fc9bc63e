"""Commands to compile, check, describe and start declarations."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from advercity.cli.arguments import JsonOption, LibraryArgument, find_libraries
from advercity.cli.output import print_data, print_left_out, print_remark
from advercity.errors import InputError, RunError

if TYPE_CHECKING:
    from advercity.compiler.settling import Settler

commands = typer.Typer()


@commands.command("compile")
def compile_(
    library: LibraryArgument = None,
    output: Annotated[Path, typer.Option(help="Folder for the specs.", file_okay=False)] = Path(
        "compiled"
    ),
    suite: Annotated[str | None, typer.Option(help="Suite to compile.")] = None,
    check: Annotated[bool, typer.Option("--check", help="Only report stale specs.")] = False,
    settle: Annotated[
        bool,
        typer.Option(
            "--settle", help="Simulate; seek seeds and waits with which all conflicts happen."
        ),
    ] = False,
    attempts: Annotated[
        int, typer.Option(min=1, max=1000, help="With --settle: simulations per road at most.")
    ] = 8,
) -> None:
    """Compile a library of declarations into scenario specs."""
    from advercity.compiler import describe_spec_differences, write_specs
    from advercity.compiler.crossing import compile_library
    from advercity.dataset.scenario_folders import check_is_outside_datasets

    if not check:
        check_is_outside_datasets(output)
    settler = _build_settler(attempts) if settle else None
    folders = find_libraries(library)
    specs = compile_library(*folders, suite=suite, settler=settler)
    if check:
        stale = describe_spec_differences(specs, output)
        if stale:
            again = " ".join(["advercity compile", *map(str, folders)])
            raise RunError(*stale, f"run `{again}` to renew them")
        print_remark(f"{len(specs)} specs in {output} are current")
        return
    print_remark(f"{len(specs)} specs in {output}: {write_specs(specs, output)}")
    print_left_out(specs)


def _build_settler(max_attempts: int) -> "Settler":
    from advercity.compiler.settling import Settler
    from advercity.pipeline.traffic_report import find_traffic_problems

    return Settler(find_traffic_problems, max_attempts, print_remark)


@commands.command()
def solve(
    library: LibraryArgument = None,
    suite: Annotated[str | None, typer.Option(help="Suite of the roads and weathers.")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only check the suns found before.")
    ] = False,
) -> None:
    """Find suns shining into the ego's camera.

    Casts rays against the world, and writes the positions into the weathers' files.
    """
    from advercity.compiler import load_library
    from advercity.compiler.crossing import find_suite
    from advercity.pipeline.glare import check_suns, solve_suns

    folders = find_libraries(library)
    loaded = load_library(*folders)
    resolved = find_suite(loaded, *folders, suite=suite)
    for line in check_suns(loaded, resolved) if check else solve_suns(loaded, resolved):
        print_data(line)


@commands.command()
def validate(
    paths: Annotated[list[Path], typer.Argument(help="Specs, declarations or library folders.")],
) -> None:
    """Check specs, declarations and libraries."""
    from advercity.compiler import validate_paths

    print_remark(f"no problems found in {validate_paths(*paths)}")


@commands.command("list")
def list_(
    folder: Annotated[
        Path, typer.Argument(help="Folder of specs, or a library of declarations.")
    ] = Path("compiled"),
    as_json: JsonOption = False,
) -> None:
    """List compiled scenarios, or the declarations of a library."""
    from advercity.cli import tables
    from advercity.pipeline import descriptions

    rows = descriptions.load_rows(folder)
    print_data(tables.format_json(rows) if as_json else tables.format_columns(rows))


@commands.command()
def show(
    shown: Annotated[
        Path, typer.Argument(help="A compiled spec, a declaration, or a name in the library.")
    ],
    map_: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Draw the plan into an image file.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Describe a scenario or a declaration; draw its plan."""
    from advercity_dsl import Road

    from advercity.cli import tables
    from advercity.compiler import find_declaration_file, load_declaration, read_spec
    from advercity.pipeline import descriptions

    path = shown
    if not shown.suffix and not shown.exists():
        path = find_declaration_file(str(shown), *find_libraries(None))
    spec = read_spec(path) if path.suffix == ".json" else None
    entry = None if spec else load_declaration(path)
    facts = (
        descriptions.describe_spec(spec)
        if spec
        else descriptions.describe_declaration(entry)
        if entry
        else {}
    )
    print_data(tables.format_json(facts) if as_json else tables.format_facts(facts))
    if map_ is not None:
        from advercity.media import write_image
        from advercity.roads.plan_drawing import draw_plan
        from advercity.roads.road_network import build_road

        road = spec.road if spec else entry.declaration if entry else None
        if not isinstance(road, Road):
            raise InputError(f"{path}: --map draws roads and specs; this is neither")
        write_image(draw_plan(build_road(road), spec), map_)
        print_remark(f"plan in {map_}")


@commands.command()
def explain(
    spec: Annotated[Path, typer.Argument(help="A compiled spec.")],
    fields: Annotated[
        list[str] | None, typer.Argument(help="Fields, such as weather.fog (default: all).")
    ] = None,
    library: Annotated[list[Path] | None, typer.Option(help="Folders of its library.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Show where the values of a spec come from.

    Origins are a file and line, a default, or a rule.
    """
    from advercity_dsl.base import suggest_name

    from advercity.cli import tables
    from advercity.compiler import explain_spec, load_library, read_spec
    from advercity.pipeline import descriptions

    origins = explain_spec(read_spec(spec), load_library(*find_libraries(library)))
    valid = {field for item in origins for field in item.fields}
    for field in fields or []:
        if field not in valid:
            raise InputError(f"{spec}: has no field {field}; {suggest_name(field, valid)}")
    rows = descriptions.build_origin_rows(
        [item for item in origins if not fields or item.is_within(fields)]
    )
    print_data(tables.format_json(rows) if as_json else tables.format_columns(rows))


@commands.command()
def diff(
    first: Annotated[Path, typer.Argument(help="A compiled spec.")],
    second: Annotated[Path, typer.Argument(help="Another one.")],
    as_json: JsonOption = False,
) -> None:
    """List the fields in which two specs differ."""
    from advercity.cli import tables
    from advercity.compiler import read_spec
    from advercity.pipeline import descriptions

    rows = descriptions.build_difference_rows(read_spec(first), read_spec(second))
    if as_json:
        print_data(tables.format_json(rows))
    elif rows:
        print_data(tables.format_columns(rows))
    else:
        print_remark("no differences")


@commands.command()
def new(
    kind: Annotated[str, typer.Argument(help="Kind of declaration: weather, road, suite, ...")],
    name: Annotated[str, typer.Argument(help="Id of the declaration and name of its file.")],
    output: Annotated[Path, typer.Option(help="Folder for the file.", file_okay=False)] = Path(),
) -> None:
    """Write a commented declaration to start from."""
    from advercity.compiler.authoring import write_starter

    print_data(str(write_starter(kind, name, output)))


@commands.command()
def schema(
    kind: Annotated[str | None, typer.Argument(help="Kind of declaration, or spec.")] = None,
    output: Annotated[
        Path | None, typer.Option(help="Folder for one file per kind.", file_okay=False)
    ] = None,
) -> None:
    """Print the JSON Schema of a kind of declaration, for editors."""
    from advercity.compiler.schema import format_schema, write_schemas

    if output is not None:
        write_schemas(output)
    elif kind is not None:
        print_data(format_schema(kind))
    else:
        raise InputError("name a kind to print, or give --output DIR to write them all")
