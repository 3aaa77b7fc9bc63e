"""The command `advercity report`."""

from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.arguments import DatasetArgument
from advercity.cli.other_commands import CommandSet
from advercity.cli.output import print_data

report = typer.Typer(rich_markup_mode=None)
REPORT = CommandSet("report", report)


@report.command(name="report")
def report_dataset(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="HTML file to write.", dir_okay=False)] = Path(
        "report.html"
    ),
) -> None:
    """Write one HTML page about a dataset.

    Pictures, conflicts, weather, statistics, licences, checksums, and how to make it again. The
    page needs no other file and no network.
    """
    from advercity_report.page import write_report

    write_report(dataset, output)
    print_data(str(output))
