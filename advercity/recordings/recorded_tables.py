"""Trajectories in the column layouts of published recordings.

Own layout: `id`, `class`, `time_s`, `x_m`, `y_m`, `heading_deg`, `length_m`, `width_m`, `height_m`.

inD, rounD, uniD, exiD: `NN_tracks.csv` with `NN_tracksMeta.csv` and `NN_recordingMeta.csv` (Bock et
al., The inD Dataset, IV 2020). Place and heading (degrees, counter-clockwise) are of the box.

highD: files of the same names (Krajewski et al., The highD Dataset, ITSC 2018). A place is the
upper left corner of the box in the image, y down, and `width` is the length of the vehicle,
`height` its width. The heading follows the motion.

INTERACTION: `vehicle_tracks_NNN.csv` and `pedestrian_tracks_NNN.csv` (Zhan et al.,
arXiv:1910.03088). Heading is in radians, counter-clockwise; people and bicycles have none.

All but highD are right-handed, x east, y north.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np
from advercity_dsl import ActorClass
from advercity_dsl.base import suggest_name
from numpy.typing import NDArray

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.recordings.tables import Table, read_head, read_table
from advercity.recordings.tracks import (
    MAX_SIZE_M,
    BadSampleError,
    Track,
    check_samples,
    derive_headings,
)

OWN_COLUMNS = ("id", "class", "time_s", "x_m", "y_m")
OWN_OPTIONAL = ("heading_deg", "length_m", "width_m", "height_m")
IND_COLUMNS = ("trackId", "frame", "xCenter", "yCenter", "heading", "width", "length")
HIGHD_COLUMNS = ("id", "frame", "x", "y", "width", "height")
LEFTWARD = "1"
"""`drivingDirection` of vehicles on the upper lanes of highD's image."""
INTERACTION_COLUMNS = ("track_id", "timestamp_ms", "agent_type", "x", "y")
INTERACTION_OPTIONAL = ("psi_rad", "length", "width")
CLASSES: Mapping[str, ActorClass] = {
    **{name: name for name in get_args(ActorClass)},
    "bus": "truck",
    "truck_bus": "truck",
    "trailer": "truck",
    "cyclist": "bicycle",
    "motorcyclist": "motorcycle",
    "person": "pedestrian",
}
ID_PATTERN = r"[A-Za-z0-9_.:-]{1,64}"
"""Valid names of tracks in a road, `TrackId`."""
MAX_TIME_S = 1e6
"""Latest time for a road, `RecordedTime`."""
PEDESTRIAN_OR_BICYCLE = "pedestrian/bicycle"
"""INTERACTION's class for both."""
MAX_WALKING_SPEED_M_S = 3.0
"""A walker faster than this at any time rides a bicycle."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """Rows of a table, not yet sorted by track.

    Attributes:
        table: The table.
        ids: Track of every row.
        classes: Class of every row, by the recording's name.
        times_s: (n,).
        places: (n, 2).
        headings_rad: (n,) NaN without one.
        sizes: (n, 3) 0 without one.
        columns: Names of the columns of id, class, time and x, for messages.
        at_rest_rad: Heading by track without motion and heading; 0 if not given.
    """

    table: Table
    ids: Sequence[str]
    classes: Sequence[str]
    times_s: NDArray[np.float64]
    places: NDArray[np.float64]
    headings_rad: NDArray[np.float64]
    sizes: NDArray[np.float64]
    columns: tuple[str, str, str, str]
    at_rest_rad: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True)
class Layout:
    """A published layout of columns.

    Attributes:
        name: Its name, also of its row in the table of columns.
        marks: Columns missing in the other layouts.
        columns: Required columns.
        read: Reads a table in this layout.
    """

    name: str
    marks: frozenset[str]
    columns: Sequence[str]
    read: Callable[[Path], list[Track]]


def read_recording(path: Path, ledger: Ledger | None = None) -> list[Track]:
    """Read the tracks of a table, in the order of their first rows.

    Args:
        path: The table.
        ledger: Record of omitted columns.

    Raises:
        InputError: It is of no known layout, or a row cannot be used.
    """
    head = read_head(path)
    layout = next((item for item in LAYOUTS if item.marks <= {*head}), None)
    if layout is None:
        known = "; ".join(f"{item.name}: {', '.join(item.columns)}" for item in LAYOUTS)
        message, hint = "has the columns of no known layout", f"rename them ({known})"
        text = ",".join(head)
        raise DiagnosticsError(Diagnostic(path, 1, 1, "", message, hint, text, len(text)))
    if ledger is not None:
        load_standard("recorded_tables").audit_columns(layout.name, head, ledger)
    return layout.read(path)


def _read_own(path: Path) -> list[Track]:
    return build_own_tracks(read_table(path, OWN_COLUMNS, OWN_OPTIONAL))


def build_own_tracks(table: Table) -> list[Track]:
    """Build the tracks of a table of our own layout; InputError if a row cannot be used."""
    samples = _Samples(
        table,
        ids=table.columns["id"],
        classes=table.columns["class"],
        times_s=table.parse_numbers("time_s"),
        places=_parse_places(table, "x_m", "y_m"),
        headings_rad=np.radians(_parse_optional(table, "heading_deg", np.nan)),
        sizes=_parse_sizes(table, "length_m", "width_m", "height_m"),
        columns=("id", "class", "time_s", "x_m"),
    )
    return _build_tracks(samples)


def _read_ind(path: Path) -> list[Track]:
    table = read_table(path, IND_COLUMNS)
    ids = table.columns["trackId"]
    (classes,) = _read_tracks_meta(table, "trackId", ("class",))
    samples = _Samples(
        table,
        ids=ids,
        classes=[classes[name] for name in ids],
        times_s=table.parse_numbers("frame") / _read_rate_hz(path),
        places=_parse_places(table, "xCenter", "yCenter"),
        headings_rad=np.radians(table.parse_numbers("heading")),
        sizes=_parse_sizes(table, "length", "width"),
        columns=("trackId", "trackId", "frame", "xCenter"),
    )
    return _build_tracks(samples)


def _read_highd(path: Path) -> list[Track]:
    table = read_table(path, HIGHD_COLUMNS)
    ids = table.columns["id"]
    classes, directions = _read_tracks_meta(table, "id", ("class", "drivingDirection"))
    sizes = _parse_sizes(table, "width", "height")
    corners = _parse_places(table, "x", "y")
    samples = _Samples(
        table,
        ids=ids,
        classes=[classes[name] for name in ids],
        times_s=table.parse_numbers("frame") / _read_rate_hz(path),
        places=(corners + sizes[:, :2] / 2) * (1, -1),
        headings_rad=np.full(len(table), np.nan),
        sizes=sizes,
        columns=("id", "id", "frame", "x"),
        at_rest_rad={
            name: math.pi if direction == LEFTWARD else 0.0
            for name, direction in directions.items()
        },
    )
    return _build_tracks(samples)


def _read_tracks_meta(table: Table, column: str, wanted: Sequence[str]) -> list[dict[str, str]]:
    """Read columns of `NN_tracksMeta.csv` by track, whose name has the same column there."""
    meta = _read_companion(table.path, "tracksMeta", (column, *wanted))
    known = {*meta.columns[column]}
    for row, name in enumerate(table.columns[column]):
        if name not in known:
            raise table.build_error(row, column, f"track {name} is not in {meta.path.name}")
    return [dict(zip(meta.columns[column], meta.columns[name], strict=True)) for name in wanted]


def _read_rate_hz(path: Path) -> float:
    recording = _read_companion(path, "recordingMeta", ("frameRate",))
    rate_hz = float(recording.parse_numbers("frameRate")[0])
    if rate_hz <= 0:
        raise recording.build_error(0, "frameRate", "is not above 0")
    return rate_hz


def _read_companion(path: Path, name: str, columns: Sequence[str]) -> Table:
    """Read `NN_<name>.csv`, next to `NN_tracks.csv`."""
    other = path.with_name(path.name.replace("tracks", name, 1))
    if other == path or not other.is_file():
        message = f"needs {other.name if other != path else f'NN_{name}.csv'}, which is not there"
        hint = "keep the files of a recording together, named as they were published"
        raise DiagnosticsError(Diagnostic(path, 0, 0, "", message, hint))
    return read_table(other, columns)


def _read_interaction(path: Path) -> list[Track]:
    return [track for part in _list_interaction_files(path) for track in _read_part(part)]


def _list_interaction_files(path: Path) -> list[Path]:
    """List the tables of vehicles and people of one recording."""
    other = path.with_name(path.name.replace("vehicle_tracks", "pedestrian_tracks", 1))
    return [path, other] if other != path and other.is_file() else [path]


def _read_part(path: Path) -> list[Track]:
    table = read_table(path, INTERACTION_COLUMNS, INTERACTION_OPTIONAL)
    samples = _Samples(
        table,
        ids=table.columns["track_id"],
        classes=table.columns["agent_type"],
        times_s=table.parse_numbers("timestamp_ms") / 1000,
        places=_parse_places(table, "x", "y"),
        headings_rad=_parse_optional(table, "psi_rad", np.nan),
        sizes=_parse_sizes(table, "length", "width"),
        columns=("track_id", "agent_type", "timestamp_ms", "x"),
    )
    return _build_tracks(samples)


def _parse_places(table: Table, x: str, y: str) -> NDArray[np.float64]:
    return np.column_stack([table.parse_numbers(x), table.parse_numbers(y)])


def _parse_optional(table: Table, name: str, blank: float) -> NDArray[np.float64]:
    if name not in table.columns:
        return np.full(len(table), blank)
    return table.parse_numbers(name, blank=blank)


def _parse_sizes(table: Table, *names: str) -> NDArray[np.float64]:
    sizes = np.zeros((len(table), 3))
    for column, name in enumerate(names):
        sizes[:, column] = _parse_optional(table, name, 0.0)
        wrong = np.flatnonzero((sizes[:, column] < 0) | (sizes[:, column] > MAX_SIZE_M))
        if len(wrong):
            row = int(wrong[0])
            message = f"{sizes[row, column]:g} m is the size of no road user"
            raise table.build_error(row, name, message)
    return sizes


def _build_tracks(samples: _Samples) -> list[Track]:
    late = np.flatnonzero(np.abs(samples.times_s) > MAX_TIME_S)
    if len(late):
        row = int(late[0])
        message = f"{samples.times_s[row]:.12g} s is not within {MAX_TIME_S:,.0f} s of time 0"
        hint = "count times from the begin of the recording, in the unit of this column"
        raise samples.table.build_error(row, samples.columns[2], message, hint)
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(samples.ids):
        if name not in rows and not re.fullmatch(ID_PATTERN, name):
            hint = "use up to 64 letters, digits and _ . : -"
            message = f"'{name[:70]}' is no id of a track"
            raise samples.table.build_error(row, samples.columns[0], message, hint)
        rows.setdefault(name, []).append(row)
    return [_build_track(name, samples, np.array(own)) for name, own in rows.items()]


def _build_track(name: str, samples: _Samples, rows: NDArray[np.int64]) -> Track:
    rows = rows[np.argsort(samples.times_s[rows], kind="stable")]
    times_s, places = samples.times_s[rows], samples.places[rows]
    try:
        check_samples(times_s, places)
    except BadSampleError as error:
        column = samples.columns[3] if "moves" in error.message else samples.columns[2]
        raise samples.table.build_error(
            int(rows[error.index]), column, f"track {name} {error.message}", error.hint
        ) from None
    headings = samples.headings_rad[rows]
    if np.isnan(headings).any():
        headings = derive_headings(times_s, places, at_rest_rad=samples.at_rest_rad.get(name, 0.0))
    return Track(
        id=name,
        actor_class=_find_class(samples, int(rows[0]), times_s, places),
        size=tuple(np.median(samples.sizes[rows], axis=0).tolist()),
        times_s=times_s,
        places=places,
        headings_rad=np.unwrap(headings),
    )


def _find_class(
    samples: _Samples, row: int, times_s: NDArray[np.float64], places: NDArray[np.float64]
) -> ActorClass:
    written = samples.classes[row].lower()
    if written == PEDESTRIAN_OR_BICYCLE:
        moved_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
        is_fast = bool((moved_m > MAX_WALKING_SPEED_M_S * np.diff(times_s)).any())
        return "bicycle" if is_fast else "pedestrian"
    if written not in CLASSES:
        message = f"'{samples.classes[row][:40]}' is no class of road users"
        hint = suggest_name(written, CLASSES)
        raise samples.table.build_error(row, samples.columns[1], message, hint)
    return CLASSES[written]


LAYOUTS = (
    Layout("own", frozenset({"x_m"}), OWN_COLUMNS, _read_own),
    Layout("inD", frozenset({"trackId", "xCenter"}), IND_COLUMNS, _read_ind),
    Layout("highD", frozenset({"id", "frame", "x", "y", "height"}), HIGHD_COLUMNS, _read_highd),
    Layout(
        "INTERACTION",
        frozenset({"track_id", "timestamp_ms"}),
        INTERACTION_COLUMNS,
        _read_interaction,
    ),
)
"""Layouts, in the order in which they are tried."""
