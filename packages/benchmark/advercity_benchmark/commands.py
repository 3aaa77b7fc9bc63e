"""Commands to train and evaluate detectors, and to compare with real recordings."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from advercity.cli.arguments import DatasetArgument, JsonOption, LayoutOption, parse_frame_slice
from advercity.cli.other_commands import CommandSet
from advercity.cli.output import print_data, print_remark, print_unread

benchmark = typer.Typer(
    name="benchmark",
    help="Detectors on datasets.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
study = typer.Typer(rich_markup_mode=None)
BENCHMARK = CommandSet("benchmark", benchmark)
STUDY = CommandSet("study", study)


_FramesOption = Annotated[
    str | None,
    typer.Option(metavar="A:B[:STEP]", help="Recorded frames of each scenario, B not included."),
]
_IdealOption = Annotated[
    bool,
    typer.Option(
        "--ideal-channel",
        help="Everything in range arrives at once, with true poses; else by the messages.",
    ),
]
_DeviceOption = Annotated[str, typer.Option(help="Device of PyTorch: cpu, cuda.")]


@benchmark.command()
def train(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="File of the detector.", dir_okay=False)],
    sensor: Annotated[
        str, typer.Option(help="Sensor of the detector: lidar, or camera (fusion none only).")
    ] = "lidar",
    fusion: Annotated[
        str, typer.Option(help="none (also for late fusion), early or intermediate.")
    ] = "none",
    start: Annotated[
        Path | None, typer.Option(help="Detector whose weights are taken over.", dir_okay=False)
    ] = None,
    steps: Annotated[int, typer.Option(min=1, max=10_000_000, help="Steps.")] = 3000,
    batch: Annotated[int, typer.Option(min=1, max=1000, help="Samples of a step.")] = 2,
    learning_rate: Annotated[
        float, typer.Option(min=1e-9, max=1, help="Highest learning rate.")
    ] = 2e-3,
    channels: Annotated[int, typer.Option(min=8, max=512, help="Width of the feature maps.")] = 32,
    seed: Annotated[int, typer.Option(min=0, help="Seed of weights and samples.")] = 1,
    frames: _FramesOption = None,
    ideal_channel: _IdealOption = False,
    device: _DeviceOption = "cpu",
) -> None:
    """Train the baseline, a small cooperative detector of LiDAR clouds or camera images.

    Writes the file every 100 steps. An interrupted run resumes. Needs the extra benchmark: pip
    install 'advercity[benchmark]'.
    """
    from advercity_benchmark.detector.checkpoint import TrainingRecord, check_sensor
    from advercity_benchmark.detector.clouds import check_fusion
    from advercity_benchmark.detector.training import TrainingProgress, train_detector

    def report(progress: TrainingProgress) -> None:
        print_remark(f"{progress.step}/{progress.steps} steps: loss {progress.loss:.3f}")

    seen = check_sensor(sensor)
    known = ("none", "early", "intermediate") if seen == "lidar" else ("none",)
    record = TrainingRecord(
        sensor=seen,
        fusion=check_fusion(fusion, known),
        steps=steps,
        batch=batch,
        learning_rate=learning_rate,
        channels=channels,
        seed=seed,
        is_ideal=ideal_channel,
    )
    train_detector(
        dataset,
        output,
        record,
        frames=parse_frame_slice(frames),
        start=start,
        device=device,
        report=report,
    )
    print_data(str(output))


@benchmark.command()
def predict(
    detector: Annotated[Path, typer.Argument(help="Detector written by `train`.")],
    dataset: DatasetArgument,
    output: Annotated[
        Path, typer.Option(help="File for the predictions (JSON Lines).", dir_okay=False)
    ],
    camera: Annotated[
        Path | None,
        typer.Option(help="Detector of images whose boxes are added (none, late).", dir_okay=False),
    ] = None,
    fusion: Annotated[
        str | None,
        typer.Option(
            help="late or early, for a detector without fusion (default: as it was trained)."
        ),
    ] = None,
    frames: _FramesOption = None,
    ideal_channel: _IdealOption = False,
    device: _DeviceOption = "cpu",
) -> None:
    """Write the predictions of a trained baseline on a dataset, for `evaluate`."""
    import time

    from advercity_benchmark.detector.clouds import FUSIONS, check_fusion
    from advercity_benchmark.detector.prediction import predict_dataset

    began_s = time.monotonic()
    count = predict_dataset(
        detector,
        dataset,
        output,
        camera=camera,
        fusion=None if fusion is None else check_fusion(fusion, FUSIONS),
        frames=parse_frame_slice(frames),
        is_ideal=ideal_channel,
        device=device,
    )
    print_data(str(output))
    print_remark(f"{count} frames, {count / (time.monotonic() - began_s):.1f} a second")


@benchmark.command()
def evaluate(
    predictions: Annotated[Path, typer.Argument(help="Predictions of a model (JSON Lines).")],
    dataset: DatasetArgument,
    output: Annotated[
        Path | None, typer.Option(help="Folder for benchmark.csv.", file_okay=False)
    ] = None,
    classes: Annotated[
        str,
        typer.Option(help="Classes to count, separated by commas; vehicle is OPV2V's class."),
    ] = "car,van,truck,vehicle",
    communication_range: Annotated[
        float, typer.Option(min=0, help="Agents within so many metres of the ego cooperate.")
    ] = 70.0,
    area: Annotated[
        tuple[float, float],
        typer.Option(help="Half length and half width of the counted area, metres from the LiDAR."),
    ] = (140.0, 40.0),
    min_points: Annotated[
        int, typer.Option(min=0, help="Fewest LiDAR points of a counted object.")
    ] = 0,
    frames: _FramesOption = None,
    bootstrap: Annotated[
        int, typer.Option(min=2, max=100_000, help="Draws of scenes for the intervals.")
    ] = 200,
    layout: LayoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Evaluate predictions of any model on a dataset.

    Prints average precisions in percent with 95 % intervals over scenes, by weather, time, density,
    road, distance and number of points. docs/benchmark.md has the format of predictions.
    """
    from advercity.cli.tables import format_columns, format_json
    from advercity.dataset.statistics import write_tables
    from advercity.output_files import check_is_outside_scenarios
    from advercity_benchmark.evaluation import EvaluationOptions, evaluate_predictions

    if output is not None:
        check_is_outside_scenarios(output)
    options = EvaluationOptions(
        classes=tuple(name.strip() for name in classes.split(",")),
        communication_range_m=communication_range,
        range_m=area,
        min_points=min_points,
        bootstrap=bootstrap,
        frames=parse_frame_slice(frames),
        layout=layout,
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
    print_unread(dataset, layout)
    if found.missing_frames:
        count = f"{found.missing_frames} of {found.frames}"
        print_remark(f"{count} frames have no line: they count as frames without detections")


@benchmark.command()
def degradation(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option(help="Folder for table and plot.", file_okay=False)],
    predictions: Annotated[
        list[Path] | None, typer.Option(help="Predictions on the dataset (repeatable).")
    ] = None,
    frames: _FramesOption = None,
) -> None:
    """Plot sensor ranges and AP@50 over the swept value of a suite."""
    from advercity.cli.tables import format_columns
    from advercity.dataset.statistics import write_tables
    from advercity.dataset.statistics_plots import save_figure
    from advercity.output_files import check_is_outside_scenarios, open_output
    from advercity_benchmark.degradation import draw_degradation, tabulate_degradation
    from advercity_benchmark.evaluation import EvaluationOptions

    check_is_outside_scenarios(output)
    options = EvaluationOptions(frames=parse_frame_slice(frames))
    table = tabulate_degradation(dataset, predictions or (), options)
    with open_output(output / "degradation.png") as path:
        save_figure(draw_degradation(table), path)
    write_tables([table], output)
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    print_data(format_columns([{k: f"{v:.4g}" for k, v in row.items()} for row in rows]))


@study.command(name="study")
def compare_recordings(
    recordings: Annotated[
        list[str],
        typer.Argument(
            metavar="[NAME=]FOLDER...",
            help="Datasets, folders of KITTI, nuScenes, CADC, Boreas, ACDC, or of pictures.",
        ),
    ],
    output: Annotated[
        Path, typer.Option(help="Folder for tables and plots.", file_okay=False)
    ] = Path("study"),
    network: Annotated[
        str, typer.Option(help="efficientnet-lite0, or an ONNX file with other features.")
    ] = "efficientnet-lite0",
    limit: Annotated[
        int, typer.Option(min=4, help="Pictures and LiDAR sweeps of each folder at most.")
    ] = 200,
) -> None:
    """Compare datasets with real recordings.

    Pictures by features of a network, LiDAR sweeps by statistics.
    """
    from advercity.output_files import check_is_outside_scenarios
    from advercity_benchmark.study.recordings import open_recordings
    from advercity_benchmark.study.report import write_study

    check_is_outside_scenarios(output)
    opened = [recording.thin(limit) for recording in open_recordings(recordings)]
    for recording in opened:
        print_remark(
            f"{recording.name}: {recording.layout}, {len(recording.picture_loaders)} pictures,"
            f" {len(recording.sweep_loaders)} sweeps"
        )
    write_study(opened, output, network=network)
    print_data(str(output))


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
