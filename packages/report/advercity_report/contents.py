"""Collects the contents of a report from a dataset."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2

from advercity.dataset.attribution import format_attribution
from advercity.dataset.facts import collect_dataset_facts
from advercity.dataset.overview_images import draw_mosaic
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.dataset.statistics import StatisticsTable, compute_tables
from advercity.dataset.statistics_plots import TABLES_WITHOUT_PLOT, draw_table
from advercity.geometry.arrays import Uint8Array
from advercity.pipeline.descriptions import describe_spec
from advercity.run_options import format_byte_size

PICTURE_WIDTH_PX = 1280
JPEG_QUALITY = 85


@dataclass(frozen=True)
class Picture:
    """An encoded image.

    Attributes:
        title: Its contents, also for readers who cannot see it.
        media_type: `image/jpeg` or `image/png`.
        data: The bytes of the file.
    """

    title: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class ScenarioContents:
    """Contents of a report about a scenario.

    Attributes:
        id: Its id, and the name of its folder.
        weather: Id of its weather, with the time of day.
        road: Id of its road.
        density: Id of its density.
        frames: Number of written frames.
        length: Number of frames of the whole scenario.
        size: Size of its files, formatted.
        picture: All front cameras and LiDARs of one frame.
        facts: Its description by name.
        truth: Its weather in physical quantities by name.
        missed_conflicts: How staged conflicts differ from their declaration.
        missing_models: Models and photographs with generated substitutes.
        attribution: Authors and licences of what it shows, as Markdown.
        checksums: Checksums and versions of everything that decides its bytes.
    """

    id: str
    weather: str
    road: str
    density: str
    frames: int
    length: int
    size: str
    picture: Picture
    facts: Mapping[str, str]
    truth: Mapping[str, str]
    missed_conflicts: Sequence[str]
    missing_models: Sequence[str]
    attribution: str
    checksums: Mapping[str, str]


@dataclass(frozen=True)
class ReportContents:
    """Contents of a report about a dataset.

    Attributes:
        name: Name of its folder.
        size: Size of its files, formatted.
        frames: Number of written frames.
        scenarios: Its scenarios with frames.
        tables: Its statistics without a plot.
        plots: Its statistics with one.
    """

    name: str
    size: str
    frames: int
    scenarios: Sequence[ScenarioContents]
    tables: Sequence[StatisticsTable]
    plots: Sequence[Picture]


def collect_report(dataset: Path) -> ReportContents:
    """Collect the contents of a report.

    Args:
        dataset: Folder of a dataset, or of one scenario.

    Raises:
        InputError: There is no dataset, it has no frames, or matplotlib is not installed.
    """
    tables = compute_tables(collect_dataset_facts(dataset))
    found = [scenario for scenario in Dataset(dataset).scenarios if len(scenario)]
    return ReportContents(
        name=dataset.resolve().name,
        size=format_byte_size(sum(scenario.manifest.size_bytes for scenario in found)),
        frames=sum(map(len, found)),
        scenarios=[_collect_scenario(scenario) for scenario in found],
        tables=[table for table in tables if table.name in TABLES_WITHOUT_PLOT],
        plots=[_plot(table) for table in tables if table.name not in TABLES_WITHOUT_PLOT],
    )


def _collect_scenario(scenario: Scenario) -> ScenarioContents:
    manifest, spec = scenario.manifest, scenario.spec
    identity, labels = manifest.identity, scenario.labels
    shown = scenario.frame(_find_shown_frame(scenario))
    return ScenarioContents(
        id=spec.id,
        weather=labels["weather"],
        road=labels["road"],
        density=labels["density"],
        frames=len(scenario),
        length=manifest.length,
        size=format_byte_size(manifest.size_bytes),
        picture=_draw_frame(shown),
        facts=describe_spec(spec),
        truth=_format_values(manifest.weather.model_dump(exclude={"id"})),
        missed_conflicts=identity.missed_conflicts,
        missing_models=identity.missing_models,
        attribution=format_attribution(spec, identity),
        checksums=_format_values(
            {
                "spec": identity.spec_sha256,
                "traffic": identity.trace_sha256,
                "world": identity.world_sha256,
                "code": identity.code_sha256,
                **identity.renderer,
                **identity.versions,
            }
        ),
    )


def _find_shown_frame(scenario: Scenario) -> int:
    """Find the written frame nearest to the first staged conflict; without one, the middle."""
    numbers, timing = scenario.frame_numbers, scenario.spec.timing
    starts_s = [conflict.window_s[0] for conflict in scenario.spec.conflicts]
    if not starts_s:
        return numbers[len(numbers) // 2]
    wanted = min(starts_s) / timing.tick_s - timing.warm_up_ticks
    return min(numbers, key=lambda number: abs(number - wanted))


def _draw_frame(frame: FrameView) -> Picture:
    title = f"Front cameras of all agents with boxes, and LiDARs from above, frame {frame.name}"
    return Picture(title, "image/jpeg", _encode_jpeg(draw_mosaic(frame)))


def _encode_jpeg(image: Uint8Array) -> bytes:
    height, width = image.shape[:2]
    scale = min(1.0, PICTURE_WIDTH_PX / width)
    size = (round(width * scale), max(1, round(height * scale)))
    smaller = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    flags = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(smaller, cv2.COLOR_RGB2BGR), flags)
    return data.tobytes()


def _plot(table: StatisticsTable) -> Picture:
    file = BytesIO()
    draw_table(table).savefig(file, format="png", dpi=120, metadata={"Software": None})
    return Picture(table.title, "image/png", file.getvalue())


def _format_values(values: Mapping[str, object]) -> dict[str, str]:
    return {
        name: f"{value:.6g}" if isinstance(value, float) else str(value)
        for name, value in values.items()
        if value is not None
    }
