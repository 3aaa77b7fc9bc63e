"""When a sensor with a clock of its own samples: rate, phase and jitter."""

from typing import Annotated

from pydantic import Field

from advercity_dsl.base import CompactModel
from advercity_dsl.units import Hertz, Milliseconds, RangeReason


class Sampled(CompactModel):
    """A sensor with its own sampling rate, or one sample per frame."""

    rate_hz: Annotated[Hertz, Field(ge=0.1, le=1000)] | None = None
    """Samples per second, at whole multiples of their period; `null` is one with every frame."""
    offset_ms: Annotated[
        Milliseconds,
        Field(ge=0, le=10_000),
        RangeReason("a sample follows its trigger within ten seconds"),
    ] = 0
    """Delay of the samples after these multiples."""
    jitter_ms: Annotated[Milliseconds, Field(ge=0, le=1000)] = 0
    """Standard deviation of their times, which stay in order: at most 0.45 periods either way."""

    def count_rays(self, scale: float) -> int:
        """Count the rays cast by one such sensor in a frame, with images at a scale."""
        return 0
