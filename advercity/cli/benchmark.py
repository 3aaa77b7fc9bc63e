"""Commands that evaluate detectors."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from advercity.cli.arguments import DatasetArgument, JsonOption
from advercity.cli.output import print_data, print_remark

benchmark = typer.Typer(
    name="benchmark",
    help="Detectors on datasets.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@benchmark.command()
def evaluate(
    predictions: Annotated[Path, typer.Argument(help="Predictions of a model (JSON Lines).")],
    dataset: DatasetArgument,
    output: Annotated[
        Path | None, typer.Option(help="Folder for benchmark.csv.", file_okay=False)
    ] = None,
    classes: Annotated[
        str, typer.Option(help="Classes that count, separated by commas.")
    ] = "car,van,truck",
    communication_range: Annotated[
        float, typer.Option(min=0, help="Agents within so many metres of the ego cooperate.")
    ] = 70.0,
    area: Annotated[
        tuple[float, float],
        typer.Option(help="Half length and half width of what counts, metres from the LiDAR."),
    ] = (140.0, 40.0),
    min_points: Annotated[
        int, typer.Option(min=0, help="LiDAR points that an object needs to count.")
    ] = 0,
    bootstrap: Annotated[
        int, typer.Option(min=2, max=100_000, help="Draws of scenes for the intervals.")
    ] = 200,
    as_json: JsonOption = False,
) -> None:
    """Evaluate predictions of any model on a dataset.

    Prints average precisions in percent with 95 % intervals over scenes, by weather, time, density,
    road, distance and number of points. docs/benchmark.md has the format of predictions.
    """
    from advercity.benchmark.evaluation import EvaluationOptions, evaluate_predictions
    from advercity.cli.tables import format_columns, format_json
    from advercity.dataset.statistics import write_tables

    options = EvaluationOptions(
        classes=tuple(name.strip() for name in classes.split(",")),
        communication_range_m=communication_range,
        range_m=area,
        min_points=min_points,
        bootstrap=bootstrap,
    )
    found = evaluate_predictions(predictions, dataset, options)
    if output is not None:
        write_tables([found.table], output)
    rows = [dict(zip(found.table.columns, row, strict=True)) for row in found.table.rows]
    if as_json:
        plain = [{name: _to_json_value(value) for name, value in row.items()} for row in rows]
        print_data(format_json(plain))
    else:
        print_data(format_columns([_format_row(row) for row in rows]))
    if found.missing_frames:
        count = f"{found.missing_frames} of {found.frames}"
        print_remark(f"{count} frames have no line: they count as ones in which nothing was found")


def _to_json_value(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def _format_row(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "by": row["by"],
        "cell": row["cell"],
        "objects": row["objects"],
        **{f"AP@{name}": _format_interval(row, f"ap_{name}") for name in (30, 50, 70)},
        "recall@50": _format_percent(row["recall_50"]),
        "ECE": _format_percent(row["calibration_error"]),
    }


def _format_interval(row: dict[str, Any], name: str) -> str:
    """Format `58.3 (52.1 to 63.0)`; without an interval if there is one scene."""
    ends = [row[f"{name}_low"], row[f"{name}_high"]]
    middle = _format_percent(row[name])
    if any(map(math.isnan, ends)):
        return middle
    return f"{middle} ({' to '.join(map(_format_percent, ends))})"


def _format_percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.1f}"
