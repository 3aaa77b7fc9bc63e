"""Commands for datasets."""

import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from advercity.cli.arguments import DatasetArgument, LayoutOption
from advercity.cli.output import print_data, print_remark, print_unread
from advercity.errors import InputError, RunError
from advercity.run_options import parse_names

if TYPE_CHECKING:
    from advercity.dataset.verification import FileProblem

commands = typer.Typer()


@commands.command()
def verify(
    dataset: Annotated[
        str, typer.Argument(help="A dataset, or one scenario of it; also s3://bucket/folder.")
    ],
) -> None:
    """Check every file of a dataset by its checksum.

    Compares files with the manifests, and manifests with the index. Lists other files; they are no
    error. Checks exports in the same way.
    """
    from advercity.dataset.verification import verify_dataset
    from advercity.exports.export_folder import is_export

    if "://" not in dataset and is_export(Path(dataset)):
        _verify_export(Path(dataset))
        return
    if "://" in dataset:
        from advercity.dataset.remote import verify_store

        problems = verify_store(dataset)
    else:
        problems = verify_dataset(Path(dataset))
    _print_foreign_files(problems)
    damage = [str(problem) for problem in problems if problem.is_damage]
    if damage:
        raise RunError(*damage)
    print_remark(f"every file is as its manifest says{_summarise_index(dataset)}")


def _summarise_index(dataset: str) -> str:
    """Summarise the index of a dataset, and say which scenarios it lacks."""
    from advercity.dataset.index import DatasetIndex
    from advercity.dataset.scenario_folders import find_scenarios

    index = None if "://" in dataset else DatasetIndex.load(Path(dataset))
    if index is None:
        return ""
    others = [
        path.name for path in find_scenarios(Path(dataset)) if path.name not in index.scenarios
    ]
    more = f"; not in index.json: {', '.join(others)}" if others else ""
    return f"; {index.format_summary()}{more}"


_HOW_TO_MEND = {
    "missing": "`advercity export` writes missing files again",
    "changed": "delete changed files, and `advercity export` writes them again;"
    " with `--fresh` it writes all files anew, and keeps changed ones as <name>.kept",
    "unfinished": "`advercity export` removes unfinished files",
}
"""Remedies for files of an export, by kind of problem."""


def _verify_export(folder: Path) -> None:
    from advercity.exports.export_folder import verify_export

    problems, manifest = verify_export(folder)
    _print_foreign_files(problems)
    damage = [str(problem) for problem in problems if problem.is_damage]
    if damage:
        kinds = {problem.kind for problem in problems}
        hints = [f"{folder}: {hint}" for kind, hint in _HOW_TO_MEND.items() if kind in kinds]
        raise RunError(*damage, *hints)
    left = "" if manifest.complete else "; the export was cut short: run it again"
    print_remark(f"every file is as its manifest says{left}")


@commands.command()
def export(
    format: Annotated[str, typer.Argument(help="Format, such as coco or nuscenes.")],
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="Folder of the export.")],
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Remove the files of exports there, and start over.")
    ] = False,
    key_frames: Annotated[
        str | None,
        typer.Option(
            metavar="all|2hz",
            help="Frames to write as samples of nuscenes; with 2hz the others are sweeps.",
        ),
    ] = None,
    schemas: Annotated[
        str | None,
        typer.Option(metavar="foxglove|ros2", help="Messages of mcap (default: foxglove)."),
    ] = None,
    allow_edited: Annotated[
        bool, typer.Option("--allow-edited", help="Export your changed files as they are.")
    ] = False,
) -> None:
    """Write a dataset in another format.

    An interrupted export resumes. A repeated export adds new frames of the dataset.
    """
    from advercity.cli.progress import show_progress
    from advercity.dataset.reader import Dataset
    from advercity.exports.exporting import export_dataset
    from advercity.exports.registry import find_export_format
    from advercity.run_options import format_byte_size

    options = {"key_frames": key_frames, "schemas": schemas}
    find_export_format(format).complete_options(options)  # before the dataset is looked for
    specs = [scenario.spec for scenario in Dataset(dataset).scenarios]
    with show_progress(specs) as view:
        made = export_dataset(
            format,
            dataset,
            output,
            options=options,
            fresh=fresh,
            allow_edited=allow_edited,
            report=view.on_progress,
        )
    print_remark(
        f"{made.scenarios} scenario{'' if made.scenarios == 1 else 's'}, {made.frames} frames,"
        f" {made.files} file{'' if made.files == 1 else 's'}, {format_byte_size(made.size_bytes)}"
    )
    print_data(str(made.output))


@commands.command()
def repair(
    dataset: DatasetArgument,
) -> None:
    """Make missing and changed files of a dataset again.

    Writes only files with their recorded checksum. Lists other files, and keeps them.
    """
    from advercity.cli.progress import show_progress
    from advercity.dataset.reader import Scenario
    from advercity.dataset.scenario_folders import find_scenarios
    from advercity.pipeline import repair_dataset

    with show_progress([Scenario(path).spec for path in find_scenarios(dataset)]) as view:
        left = repair_dataset(dataset, view.on_progress)
    _print_foreign_files(left)
    again = "delete the rest of the scenario, and `advercity run` with its spec makes it again"
    damage = [f"{problem}; {again}" for problem in left if problem.is_damage]
    if damage:
        raise RunError(*damage)
    print_remark("every file is as its manifest says")


def _print_foreign_files(problems: Iterable["FileProblem"]) -> None:
    for problem in problems:
        if not problem.is_damage:
            print_data(str(problem))


@commands.command()
def stats(
    dataset: DatasetArgument,
    output: Annotated[
        Path, typer.Option(help="Folder for tables and plots.", file_okay=False)
    ] = Path("stats"),
    layout: LayoutOption = None,
) -> None:
    """Count the content of a dataset: tables as CSV, plots as PNG."""
    from advercity.dataset.facts import collect_dataset_facts
    from advercity.dataset.statistics import compute_tables, write_tables
    from advercity.dataset.statistics_plots import write_plots
    from advercity.output_files import check_is_outside_scenarios

    check_is_outside_scenarios(output)
    found = compute_tables(collect_dataset_facts(dataset, layout))
    write_tables(found, output)
    write_plots(found, output)
    print_unread(dataset, layout)
    print_data(str(output))


@commands.command()
def video(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="Folder for the videos.", file_okay=False)] = Path(
        "videos"
    ),
    kind: Annotated[
        list[str] | None, typer.Option(help="front, mosaic, semantic or lidar (default: all).")
    ] = None,
) -> None:
    """Make videos of the scenarios of a dataset.

    Front cameras, mosaic with boxes, semantics, LiDAR from above.
    """
    from advercity.dataset.overview_images import VIDEO_KINDS, write_videos

    for path in write_videos(dataset, output, kind or VIDEO_KINDS):
        print_data(str(path))


@commands.command()
def split(
    dataset: Annotated[Path, typer.Argument(help="A dataset.")],
    output: Annotated[Path, typer.Option(help="Folder for the splits.", file_okay=False)] = Path(
        "splits"
    ),
    by: Annotated[
        Literal["road", "scene", "seed", "density", "weather", "time"] | None,
        typer.Option(
            help="Property to split by; scenarios of a scene share their traffic.",
            show_default="road; with --share, scene",
        ),
    ] = None,
    train: Annotated[
        str | None, typer.Option(help="Values in this split.", show_default="of roads: ri,rsnj,unj")
    ] = None,
    validate: Annotated[
        str | None, typer.Option(help="Values in this split.", show_default="of roads: rcnj")
    ] = None,
    test: Annotated[
        str | None, typer.Option(help="Values in this split.", show_default="of roads: ui")
    ] = None,
    share: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Draw splits of these shares, such as 70,15,15."),
    ] = None,
) -> None:
    """Link scenarios into train, validate and test.

    Splits go by road, or by another property.

    Separate the values of a split by commas. With `--share`, scenarios with the same value stay in
    one split.
    """
    from advercity.dataset.splits import PUBLISHED_SPLITS, link_shares, link_splits

    named = {"train": train, "validate": validate, "test": test}
    if share is not None:
        if any(text is not None for text in named.values()):
            raise InputError("`--share` draws the values of splits; leave out their names")
        found = link_shares(dataset, output, _parse_shares(share, named), by=by or "scene")
    else:
        by = by or "road"
        if by != "road" and all(text is None for text in named.values()):
            raise InputError(f"name the values of {by} of each split, or give `--share 70,15,15`")
        defaults = PUBLISHED_SPLITS if by == "road" else {}
        values = {
            name: defaults.get(name, ()) if text is None else parse_names(text)
            for name, text in named.items()
        }
        found = link_splits(dataset, output, values, by=by)
    for name, members in found.items():
        print_data(f"{output / name}: {len(members)}")


def _parse_shares(text: str, splits: Collection[str]) -> dict[str, float]:
    parts = text.split(",")
    if len(parts) != len(splits) or not all(re.fullmatch(r"[0-9]{1,3}", part) for part in parts):
        raise InputError(f"--share {text}: is no {len(splits)} percentages; write 70,15,15")
    shares = dict(zip(splits, map(float, parts), strict=True))
    if not sum(shares.values()):
        raise InputError(f"--share {text}: at least one split needs a share")
    return shares


@commands.command()
def sheet(
    scenario: Annotated[Path, typer.Argument(help="A scenario of a dataset.")],
    output: Annotated[Path, typer.Option(help="Image file to write.")] = Path("contact_sheet.png"),
    frame: Annotated[
        str | None,
        typer.Option(help="Name of the frame, such as 000060.", show_default="the middle one"),
    ] = None,
    agents: Annotated[
        str | None, typer.Option(help="Agents, separated by commas.", show_default="all")
    ] = None,
) -> None:
    """Put all cameras of one frame on a contact sheet."""
    from advercity.dataset.overview_images import write_contact_sheet

    chosen = None if agents is None else parse_names(agents)
    write_contact_sheet(scenario, output, frame=frame, agents=chosen)
    print_data(str(output))
