"""Recorded trajectories for the actors of a road, in place of simulated traffic."""

from typing import Annotated, Self

from pydantic import Field, StringConstraints, model_validator

from advercity_dsl.base import Digest, InvalidCombination, Items, Model, is_empty
from advercity_dsl.road.streets import LeftOut
from advercity_dsl.units import Seconds

RecordedTime = Annotated[Seconds, Field(ge=-1e6, le=1e6)]
TrackId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:-]{1,64}$")]
"""Name of a track in its recording."""


class _RecordedSpan(Model):
    from_s: RecordedTime
    """Time of the recording at which the first frame is taken."""
    to_s: RecordedTime
    """Time of the recording after which no frame is taken."""
    left_out: Items[LeftOut] = Field(default=(), exclude_if=is_empty)
    """Omitted parts of the recording."""

    @model_validator(mode="after")
    def _check_span(self) -> Self:
        if self.to_s <= self.from_s:
            message = f"{self.to_s:g} is not after from_s {self.from_s:g}"
            raise InvalidCombination(("to_s",), message, "give the end of the recording to take")
        return self


class TrajectoryFile(_RecordedSpan):
    """A table of trajectories in the frame of the road, as `advercity import` writes it."""

    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    """Path of the table, relative to the declaration's file."""
    sha256: Digest | None = None
    """SHA-256 of the file; a table with another one is rejected."""


class TrajectorySet(_RecordedSpan):
    """The trajectories compiled from a table; a spec needs no other file."""

    sha256: Digest
    """SHA-256 of the table's file."""
    tracks: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]+={0,2}$")]
    """Rows of the table, compressed with zlib and encoded in Base64."""
