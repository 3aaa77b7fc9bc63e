"""`Track`: the motion of one recorded road user, and the checks of every recording."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.errors import InputError

MAX_GAP_S = 1.0
"""Longest interpolated time between two samples."""
MAX_SIZE_M = 50.0
"""Largest size of a road user, in each direction."""
MAX_SPEED_M_S = 100.0
"""Faster ones have jumped, or are in other units."""
MIN_HEADING_SPEED_M_S = 0.3
"""Below this speed the direction of motion does not show the heading."""


@dataclass(frozen=True, eq=False)
class Track:
    """One road user of a recording.

    Attributes:
        id: Its name in the recording.
        actor_class: Its class.
        size: Length, width and height in metres; 0 if unknown.
        times_s: (n,) times of the samples, rising.
        places: (n, 2) centre of its box, east and north in metres.
        headings_rad: (n,) counter-clockwise from east, without jumps by full turns.
    """

    id: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    times_s: NDArray[np.float64]
    places: NDArray[np.float64]
    headings_rad: NDArray[np.float64]

    def covers(self, from_s: float, to_s: float, *, tolerance_s: float = 1e-6) -> bool:
        """Return whether it was recorded all the time."""
        begins, ends = self.times_s[0] - tolerance_s, self.times_s[-1] + tolerance_s
        return bool(begins <= from_s and to_s <= ends)

    def transform(self, *, east_m: float, north_m: float, turn_rad: float) -> "Track":
        """Turn it counter-clockwise around the origin of its frame, then move it."""
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        turned = self.places @ np.array([[cos, sin], [-sin, cos]])
        return replace(
            self,
            places=turned + np.array([east_m, north_m]),
            headings_rad=self.headings_rad + turn_rad,
        )

    def mirror(self) -> "Track":
        """Mirror it at the x axis of its frame."""
        return replace(self, places=self.places * (1.0, -1.0), headings_rad=0.0 - self.headings_rad)

    def cut(self, from_s: float, to_s: float) -> "Track | None":
        """Keep the samples of a time and one more on each side; None if fewer than two are left."""
        first = max(int(np.searchsorted(self.times_s, from_s, side="right")) - 1, 0)
        last = int(np.searchsorted(self.times_s, to_s)) + 1
        kept = slice(first, last)
        times = self.times_s[kept]
        if len(times) < 2 or times[-1] < from_s or times[0] > to_s:
            return None
        return replace(
            self, times_s=times, places=self.places[kept], headings_rad=self.headings_rad[kept]
        )


class BadSampleError(InputError):
    """A sample impossible after the one before.

    Attributes:
        index: Index of the sample in its track.
        hint: How to correct it.
    """

    def __init__(self, index: int, message: str, hint: str) -> None:
        super().__init__(f"{message}; {hint}")
        self.index = index
        self.message = message
        self.hint = hint


def check_samples(times_s: NDArray[np.float64], places: NDArray[np.float64]) -> None:
    """Check that samples (n,) and (n, 2), sorted by time, are a possible motion.

    Raises:
        BadSampleError: Two are of the same time, too far apart in time, or too far in space.
    """
    steps_s = np.diff(times_s)
    same = np.flatnonzero(steps_s <= 0)
    if len(same):
        index = int(same[0]) + 1
        raise BadSampleError(
            index, f"there are two places at {times_s[index]:g} s", "give every actor its own id"
        )
    gaps = np.flatnonzero(steps_s > MAX_GAP_S)
    if len(gaps):
        index = int(gaps[0]) + 1
        message = f"has no samples in the {steps_s[index - 1]:.1f} s before {times_s[index]:g} s"
        hint = f"gaps of up to {MAX_GAP_S:g} s are interpolated; split the track into two ids"
        raise BadSampleError(index, message, hint)
    with np.errstate(over="ignore"):  # an infinite speed is too fast, too
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / steps_s
    jumps = np.flatnonzero(speeds > MAX_SPEED_M_S)
    if len(jumps):
        index = int(jumps[0]) + 1
        moved_m, step_s = speeds[index - 1] * steps_s[index - 1], steps_s[index - 1]
        message = f"moves {moved_m:.6g} m in {step_s:.3g} s, {speeds[index - 1]:.4g} m/s"
        raise BadSampleError(index, message, "places are in metres, times in seconds")


def derive_headings(
    times_s: NDArray[np.float64], places: NDArray[np.float64], *, at_rest_rad: float = 0.0
) -> NDArray[np.float64]:
    """Derive headings (n,) from the direction of motion; one at rest keeps the last.

    Before its first motion it has the heading of this motion; `at_rest_rad` without any motion.
    """
    at_rest = np.full(len(times_s), at_rest_rad)
    if len(times_s) < 2:
        return at_rest
    velocities = np.gradient(places, times_s, axis=0)
    moving = np.flatnonzero(np.linalg.norm(velocities, axis=1) >= MIN_HEADING_SPEED_M_S)
    if not len(moving):
        return at_rest
    headings = np.unwrap(np.arctan2(velocities[moving, 1], velocities[moving, 0]))
    last = np.searchsorted(moving, np.arange(len(times_s)), side="right") - 1
    return headings[np.maximum(last, 0)]


def find_connected(
    tracks: Sequence[Track], ego: Track, count: int, *, from_s: float, to_s: float
) -> list[Track]:
    """Find the vehicles recorded all the time and on average nearest to the ego.

    Args:
        tracks: All tracks.
        ego: The ego's.
        count: Number of vehicles at most.
        from_s: Begin of the time.
        to_s: End of it.
    """
    vehicles = (
        track
        for track in tracks
        if track is not ego
        and track.actor_class in ("car", "van", "truck")
        and track.covers(from_s, to_s)
    )
    times_s = np.linspace(from_s, to_s, 50)

    def locate(track: Track) -> NDArray[np.float64]:
        columns = [np.interp(times_s, track.times_s, column) for column in track.places.T]
        return np.stack(columns, axis=1)

    around = locate(ego)
    distances = [
        (float(np.linalg.norm(locate(track) - around, axis=1).mean()), number, track)
        for number, track in enumerate(vehicles)
    ]
    return [track for _, _, track in sorted(distances, key=lambda item: item[:2])[:count]]


def cut_tracks(tracks: Iterable[Track], from_s: float, to_s: float) -> list[Track]:
    """Cut tracks to a time, and keep the non-empty ones."""
    return [found for track in tracks if (found := track.cut(from_s, to_s)) is not None]
