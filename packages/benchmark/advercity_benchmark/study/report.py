"""Tables and plots of a study.

`picture_distances.csv` and `embedding.png` compare pictures, `lidar.csv`, `lidar_distances.csv` and
`lidar.png` compare sweeps; a kind in only one recording is left out.
"""

from collections.abc import Sequence
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from advercity.dataset.statistics import StatisticsTable, save_tables
from advercity.errors import InputError, RunError, describe_cause
from advercity.geometry.arrays import Float64Array
from advercity.output_files import open_output_folder
from advercity_benchmark.study.distances import FeatureSet, compare_features
from advercity_benchmark.study.picture_features import (
    DEFAULT_NETWORK,
    check_pictures,
    compute_features,
    load_network,
)
from advercity_benchmark.study.recordings import INSTALL_HINT, Recording
from advercity_benchmark.study.sweep_statistics import (
    ELEVATION_EDGES_DEG,
    INTENSITY_EDGES,
    RANGE_EDGES_M,
    SweepStatistics,
    compute_jensen_shannon_distance,
    compute_sweep_statistics,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_PERPLEXITY = 30.0
HISTOGRAMS = (
    ("ranges", RANGE_EDGES_M, "range, m"),
    ("intensities", INTENSITY_EDGES, "intensity"),
    ("elevations", ELEVATION_EDGES_DEG, "elevation, deg"),
)


def write_study(
    recordings: Sequence[Recording], folder: Path, *, network: str = DEFAULT_NETWORK
) -> list[StatisticsTable]:
    """Compare recordings, and write tables and plots into a folder, all or none.

    Returns:
        The tables.

    Raises:
        InputError: Less than two recordings have pictures, and less than two have sweeps; a package
            is missing; a picture or sweep cannot be read; a file there may not be replaced.
        RunError: The folder is full or not writable.
    """
    seen = [item for item in recordings if item.picture_loaders]
    scanned = [item for item in recordings if item.sweep_loaders]
    if max(len(seen), len(scanned)) < 2:
        raise InputError("no two of these folders have pictures, or LiDAR sweeps, to compare")
    tables: list[StatisticsTable] = []
    figures: dict[str, Figure] = {}
    if len(seen) > 1:
        for item in seen:
            check_pictures(item)
        loaded = load_network(network)
        sets = [compute_features(item, loaded) for item in seen]
        tables.append(_tabulate_pictures(sets))
        figures["embedding"] = draw_embedding(sets)
    if len(scanned) > 1:
        statistics = [compute_sweep_statistics(item) for item in scanned]
        tables += [_tabulate_sweeps(statistics), _tabulate_sweep_distances(statistics)]
        figures["lidar"] = draw_histograms(statistics)
    _write_files(tables, figures, folder)
    return tables


def _write_files(
    tables: Sequence[StatisticsTable], figures: dict[str, "Figure"], folder: Path
) -> None:
    try:
        with open_output_folder(folder) as made:
            save_tables(tables, made)
            for name, figure in figures.items():
                figure.savefig(made / f"{name}.png", dpi=120, metadata={"Software": None})
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {describe_cause(error)}") from error


def _tabulate_pictures(sets: Sequence[FeatureSet]) -> StatisticsTable:
    found = compare_features(sets)
    return StatisticsTable(
        "picture_distances",
        "Distances of pictures; of a set to itself: of its halves",
        {
            "one": [item.one for item in found],
            "other": [item.other for item in found],
            "frechet": [item.frechet for item in found],
            "kernel_x1000": [item.kernel for item in found],
        },
    )


def _tabulate_sweeps(statistics: Sequence[SweepStatistics]) -> StatisticsTable:
    names = (
        "name",
        "sweeps",
        "echoes",
        "median_range_m",
        "far_range_m",
        "mean_intensity",
        "lonely_ratio",
    )
    columns = {name: [getattr(item, name) for item in statistics] for name in names}
    return StatisticsTable("lidar", "LiDAR sweeps", columns)


def _tabulate_sweep_distances(statistics: Sequence[SweepStatistics]) -> StatisticsTable:
    pairs = list(combinations(statistics, 2))
    columns: dict[str, list[Any]] = {
        "one": [one.name for one, _ in pairs],
        "other": [other.name for _, other in pairs],
    }
    for name, _, _ in HISTOGRAMS:
        columns[name] = [
            compute_jensen_shannon_distance(getattr(one, name), getattr(other, name))
            for one, other in pairs
        ]
    return StatisticsTable("lidar_distances", "Jensen-Shannon distances of histograms", columns)


def draw_embedding(sets: Sequence[FeatureSet]) -> "Figure":
    """Draw a t-SNE map of all pictures, each by the mean of its crops."""
    manifold: Any = _import("sklearn.manifold", "scikit-learn")
    means = [_average_crops(item) for item in sets]
    every = np.concatenate(means)
    perplexity = min(MAX_PERPLEXITY, (len(every) - 1) / 3.0)
    embed = manifold.TSNE(2, perplexity=perplexity, init="pca", random_state=0)
    places = embed.fit_transform(every)
    figure = _create_figure(7.0, 7.0)
    axes = figure.subplots()
    ends = np.cumsum([len(item) for item in means])
    for item, part in zip(sets, np.split(places, ends[:-1]), strict=True):
        axes.scatter(*part.T, s=20.0, alpha=0.8, linewidths=0.0, label=f"{item.name} ({len(part)})")
    axes.set(xticks=[], yticks=[], title="Features of pictures, t-SNE")
    axes.legend(frameon=False)
    return figure


def draw_histograms(statistics: Sequence[SweepStatistics]) -> "Figure":
    """Draw ranges, intensities and elevations of the echoes of all recordings."""
    figure = _create_figure(12.0, 4.0)
    for axes, (name, edges, label) in zip(figure.subplots(1, 3), HISTOGRAMS, strict=True):
        for item in statistics:
            axes.stairs(getattr(item, name), edges, baseline=None, label=item.name)
        axes.set(xlabel=label, ylabel="fraction of echoes")
        axes.legend(frameon=False)
    return figure


def _average_crops(item: FeatureSet) -> Float64Array:
    return np.stack(
        [item.features[item.pictures == number].mean(axis=0) for number in np.unique(item.pictures)]
    )


def _create_figure(width: float, height: float) -> "Figure":
    figure: Any = _import("matplotlib.figure", "matplotlib")
    # Not by pyplot, which keeps figures and picks a window system.
    return figure.Figure(figsize=(width, height), layout="constrained")


def _import(module: str, package: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(f"{package} is not installed; {INSTALL_HINT}") from error
