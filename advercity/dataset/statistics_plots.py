"""Plots of a dataset's statistics, with matplotlib from the extra `stats`."""

from collections.abc import Iterable
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from advercity.dataset.statistics import POLAR_EDGES_DEG, POLAR_RANGE_EDGES_M, StatisticsTable
from advercity.errors import InputError, RunError, describe_cause
from advercity.output_files import open_output_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PIE_COLOURS = {
    "clear": "limegreen",
    "heavy_rain": "teal",
    "soft_rain": "cornflowerblue",
    "foggy_heavy_rain": "dimgray",
    "glare": "gold",
    "fog": "lightgray",
    "day": "skyblue",
    "night": "dimgray",
}
"""Colours of the original's charts."""
OTHER_COLOURS = (
    *("plum", "sandybrown", "indianred", "yellowgreen", "slateblue", "hotpink", "sienna"),
    *("mediumturquoise", "olive", "darkorange", "steelblue", "mediumpurple"),
)
"""Colours of weathers that the original lacks, in their order; beyond twelve they repeat."""
PIE_TABLES = ("weather", "time_of_day")
LOGARITHMIC_TABLES = (
    "vehicles_per_speed",
    "num_frames_per_ego_speed",
    "num_keyframes_per_num_annotations",
)
LINE_TABLES = ("echoes_by_range", "radar_detected_by_range", "messages_by_range")
TABLES_WITHOUT_PLOT = ("stats", "radar_by_kind", "messages")


def write_plots(tables: Iterable[StatisticsTable], folder: Path) -> None:
    """Plot each table as `<name>.png` if it has a plot, all or none.

    Raises:
        InputError: matplotlib is not installed, or a file of this name is not to be replaced.
        RunError: The folder is full or not writable.
    """
    try:
        with open_output_folder(folder) as made:
            for table in tables:
                if table.name not in TABLES_WITHOUT_PLOT:
                    save_figure(draw_table(table), made / f"{table.name}.png")
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {describe_cause(error)}") from error


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG: the same figure gives the same bytes with any matplotlib."""
    figure.savefig(path, dpi=120, metadata={"Software": None})


def draw_table(table: StatisticsTable) -> "Figure":
    """Draw one table as a figure; InputError if matplotlib is not installed."""
    figure = make_figure()
    if table.name == "polar_density_map":
        _draw_polar(figure, table)
    else:
        axes = figure.subplots()
        if table.name in PIE_TABLES:
            _draw_pie(axes, table)
        elif table.name == "visibility_by_weather":
            _draw_visibility(axes, table)
        elif table.name in LINE_TABLES:
            _draw_lines(axes, table)
        else:
            _draw_bars(axes, table)
    figure.suptitle(table.title, fontsize="medium")
    return figure


def make_figure() -> "Figure":
    """Make an empty figure; InputError if matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError(
            "plots need matplotlib, which is not installed; try: pip install 'advercity[stats]'"
        ) from error
    # Not by pyplot, which keeps figures and picks a window system.
    return Figure(figsize=(7.0, 4.5), layout="constrained")


def _draw_pie(axes: Any, table: StatisticsTable) -> None:
    names, counts = table.columns.values()
    others = cycle(OTHER_COLOURS)
    colours = [PIE_COLOURS.get(name) or next(others) for name in names]
    wedges, *_ = axes.pie(counts, colors=colours, counterclock=False)
    # Next to narrow wedges, labels would overlap.
    percentages = 100 * np.array(counts) / max(1, sum(counts))
    labels = [f"{_format_label(n)}: {p:.1f} %" for n, p in zip(names, percentages, strict=True)]
    axes.legend(wedges, labels, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)


def _draw_bars(axes: Any, table: StatisticsTable) -> None:
    (first, positions), *series = table.columns.items()
    step = positions[1] - positions[0] if _is_number(positions) and len(positions) > 1 else 1
    width = 0.9 * step / len(series)
    middle = np.array(positions) + step / 2 if _is_binned(first) else positions
    if not _is_number(positions):
        middle = np.arange(len(positions))
        labels = [_format_label(name) for name in positions]
        axes.set_xticks(middle, labels, rotation=30, ha="right", rotation_mode="anchor")
    for number, (name, values) in enumerate(series):
        offset = (number - (len(series) - 1) / 2) * width
        axes.bar(np.asarray(middle, float) + offset, values, width, label=_format_label(name))
    has_any = any(np.any(np.asarray(values) > 0) for _, values in series)
    if table.name in LOGARITHMIC_TABLES and has_any:
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.5)  # shows a count of 1
    axes.set_xlabel(_format_label(first.removesuffix("_from")))
    _label_series(axes, [name for name, _ in series])


def _draw_lines(axes: Any, table: StatisticsTable) -> None:
    (first, positions), *series = table.columns.items()
    middle = np.array(positions) + (positions[1] - positions[0]) / 2
    for name, values in series:
        axes.plot(middle, values, marker="o", markersize=3, label=_format_label(name))
    axes.set_ylim(0, None)
    axes.set_xlabel(_format_label(first.removesuffix("_from")))
    # Two returns of a beam are two points, so their number per beam exceeds 1.
    axes.set_ylabel("points per beam" if table.name == "echoes_by_range" else "fraction")
    axes.legend(fontsize="small")


def _draw_visibility(axes: Any, table: StatisticsTable) -> None:
    rows = zip(table.columns["weather"], table.columns["echoing_share"], strict=True)
    labels = [f"{_format_label(name)}: {share:.0%}" for name, share in rows]
    axes.barh(labels, table.columns["mor_m"], color="slategray")
    axes.set_ylabel("weather: objects that return points")
    axes.set_xscale("log")
    axes.set_xlabel("meteorological optical range m")


def _draw_polar(figure: "Figure", table: StatisticsTable) -> None:
    """Draw bearings around the ego: ahead is up, left is left."""
    from matplotlib.colors import LogNorm

    shape = (len(POLAR_EDGES_DEG) - 1, len(POLAR_RANGE_EDGES_M) - 1)
    counts = np.reshape(table.columns["objects"], shape)
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.grid(visible=False)
    mesh = axes.pcolormesh(
        np.deg2rad(POLAR_EDGES_DEG),
        POLAR_RANGE_EDGES_M,
        np.ma.masked_equal(counts.T, 0),
        norm=LogNorm(1, max(2, int(counts.max()))),
    )
    figure.colorbar(mesh, label="objects", pad=0.12)


def _label_series(axes: Any, names: list[str]) -> None:
    if len(names) > 1:
        axes.legend()
    else:
        axes.set_ylabel(_format_label(names[0]))


def _is_number(values: Any) -> bool:
    return len(values) > 0 and isinstance(values[0], int | float)


def _is_binned(name: str) -> bool:
    return name.endswith("_from")


def _format_label(name: str) -> str:
    return name.replace("km_h", "km/h").replace("_", " ")
