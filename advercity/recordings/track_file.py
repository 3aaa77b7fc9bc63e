"""A road's table of trajectories, and its form in a spec.

It has the own layout of `recorded_tables`, every value given, in the frame of the road.
"""

import base64
import binascii
import hashlib
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from advercity_dsl import TrajectoryFile, TrajectorySet
from advercity_dsl.units import Point2

from advercity.documents import decode_text, read_bytes
from advercity.errors import InputError, describe_cause
from advercity.recordings.recorded_tables import (
    OWN_COLUMNS,
    OWN_OPTIONAL,
    build_own_tracks,
    read_recording,
)
from advercity.recordings.tables import MAX_TABLE_BYTES, parse_csv
from advercity.recordings.tracks import Track, cut_tracks

MAX_PACKED_BYTES = 256_000_000
MARGIN_S = 1.0
"""Time of extra samples before and after the taken time, for smooth ends."""
SPEC_TABLE = Path("trajectories.tracks")
"""Name of the table of a spec in messages."""
_HEAD = ",".join((*OWN_COLUMNS, *OWN_OPTIONAL))


def format_tracks(tracks: Iterable[Track]) -> str:
    """Format a table: micrometres, microseconds, and headings to 1e-6 degrees."""
    rows = [_HEAD]
    for track in tracks:
        size = ",".join(f"{value:.6g}" for value in track.size)
        degrees = np.degrees(track.headings_rad)
        rows += [
            f"{track.id},{track.actor_class},{time:.6f},{x:.6f},{y:.6f},{heading:.6f},{size}"
            for time, (x, y), heading in zip(
                track.times_s.tolist(), track.places.tolist(), degrees.tolist(), strict=True
            )
        ]
    return "\n".join(rows) + "\n"


def load_trajectories(
    declared: TrajectoryFile, folder: Path, origin_m: Point2 = (0.0, 0.0)
) -> tuple[TrajectorySet, dict[str, Track]]:
    """Load a road's part of its table, whose path is relative to a folder.

    Args:
        declared: The table.
        folder: Base of its path.
        origin_m: The table's coordinates, east and north, of the world's origin.

    Returns:
        The set for the spec, and the tracks in it by id.

    Raises:
        InputError: The table is missing or another one, or a row is not valid.
    """
    name = Path(declared.file)
    if name.is_absolute():
        raise InputError(f"{declared.file}: is an absolute path; write it relative to this file")
    try:
        raw = read_bytes(folder / name, max_bytes=MAX_TABLE_BYTES)
    except OSError as error:
        raise InputError(f"{declared.file}: cannot be read: {describe_cause(error)}") from None
    digest = hashlib.sha256(raw).hexdigest()
    if declared.sha256 not in (None, digest):
        raise InputError(
            f"{declared.file}: is not the table that this road was made for: its sha256 is"
            f" {digest}; fetch the right one, or check the tracks and declare this sha256"
        )
    tracks = read_recording(folder / name)
    kept = cut_tracks(tracks, declared.from_s - MARGIN_S, declared.to_s + MARGIN_S)
    kept = [track for track in kept if track.cut(declared.from_s, declared.to_s) is not None]
    if not kept:
        begins = min(track.times_s[0] for track in tracks)
        ends = max(track.times_s[-1] for track in tracks)
        raise InputError(
            f"{declared.file}: has no samples from {declared.from_s:g} to {declared.to_s:g} s;"
            f" it has {begins:g} to {ends:g} s"
        )
    if origin_m != (0.0, 0.0):
        east_m, north_m = origin_m
        kept = [track.transform(east_m=-east_m, north_m=-north_m, turn_rad=0.0) for track in kept]
    found = TrajectorySet(
        sha256=digest,
        from_s=declared.from_s,
        to_s=declared.to_s,
        left_out=declared.left_out,
        tracks=_pack_tracks(kept),
    )
    return found, {track.id: track for track in unpack_tracks(found)}


def mirror_trajectories(packed: TrajectorySet) -> TrajectorySet:
    """Mirror the tracks of a spec at the x axis."""
    tracks = [track.mirror() for track in unpack_tracks(packed)]
    return packed.model_copy(update={"tracks": _pack_tracks(tracks)})


def _pack_tracks(tracks: Iterable[Track]) -> str:
    return base64.b64encode(zlib.compress(format_tracks(tracks).encode(), 9)).decode("ascii")


def unpack_tracks(packed: TrajectorySet) -> list[Track]:
    """Unpack the tracks of a spec; InputError if it has something else."""
    try:
        inflate = zlib.decompressobj()
        raw = inflate.decompress(base64.b64decode(packed.tracks, validate=True), MAX_PACKED_BYTES)
    except (binascii.Error, zlib.error) as error:
        raise InputError(f"trajectories.tracks: not a packed table: {error}") from None
    if inflate.unconsumed_tail:
        raise InputError(f"trajectories.tracks: inflates to more than {MAX_PACKED_BYTES} bytes")
    text = decode_text(raw, SPEC_TABLE)
    return build_own_tracks(parse_csv(SPEC_TABLE, text, OWN_COLUMNS, OWN_OPTIONAL))
