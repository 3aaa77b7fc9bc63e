"""Sample times of a sensor with its own clock, and its samples in a frame."""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl.sampling import Sampled
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator

MAX_JITTER_PERIODS = 0.45
"""Largest jitter, in periods; from half a period on, samples could change places."""
_BLOCK = 64
"""Number of samples with jitter from one generator."""


@dataclass(frozen=True, eq=False)
class SampleTimes:
    """The n samples since the previous frame, including the frame's instant.

    Attributes:
        first: Number of the first sample, from 0 in a scenario; the others have successive numbers.
        fractions: (n,) times, from 0 at the previous frame to 1 at this one.
        step_s: Nominal time between samples.
    """

    first: int
    fractions: Float64Array
    step_s: float


def list_sample_times(
    sensor: Sampled, tick_s: float, frame: int, *, key: tuple[int | str, ...]
) -> SampleTimes:
    """List the samples of a sensor between two frames, a function of the frame alone.

    Args:
        sensor: Rate, offset and jitter.
        tick_s: Time between frames.
        frame: Number of the second frame from 0, whose instant is `frame * tick_s`.
        key: Key of the jitter, the same for all frames.
    """
    if sensor.rate_hz is None:
        return SampleTimes(frame, np.ones(1), tick_s)
    step_s = 1.0 / sensor.rate_hz
    steps_per_tick, offset = tick_s / step_s, sensor.offset_ms / 1000.0 / step_s
    # The first frame has samples of the tick before it, so the number 0 is before this tick.
    number_from_zero = math.ceil(steps_per_tick + offset) + 2
    first = math.floor((frame - 1) * steps_per_tick - offset) - 1
    numbers = np.arange(first, first + math.ceil(steps_per_tick) + 4)
    late = _draw_jitter(sensor, step_s, numbers + number_from_zero, key)
    # Rounded, so a sample at a frame's instant belongs to the frame on every machine.
    fractions = np.round((numbers + offset + late) / steps_per_tick - (frame - 1), 9)
    inside = (fractions > 0.0) & (fractions <= 1.0)
    begin = int(numbers[inside][0]) if inside.any() else first
    return SampleTimes(begin + number_from_zero, fractions[inside], step_s)


@dataclass(frozen=True)
class SampleMoment:
    """Time of a sensor's sample.

    Attributes:
        frame: Number of the frame at or after the sample.
        shift_s: Time from the frame, 0 or negative, less than a tick.
    """

    frame: int
    shift_s: float


def find_newest_sample(
    sensor: Sampled, tick_s: float, frame: int, *, key: tuple[int | str, ...]
) -> SampleMoment:
    """Find the newest sample of a sensor at or before a frame.

    There is no state before the first frame: a sensor without a sample up to a frame is taken to
    have measured at the first.
    """
    for number in range(frame, -1, -1):
        fractions = list_sample_times(sensor, tick_s, number, key=key).fractions
        if len(fractions):
            return SampleMoment(number, round((float(fractions[-1]) - 1.0) * tick_s, 9))
    return SampleMoment(0, 0.0)


def _draw_jitter(
    sensor: Sampled, step_s: float, numbers: NDArray[np.int64], key: tuple[int | str, ...]
) -> Float64Array:
    """Draw the delays (n,) of samples, in periods."""
    if sensor.jitter_ms == 0.0:
        return np.zeros(len(numbers))
    blocks = range(int(numbers[0]) // _BLOCK, int(numbers[-1]) // _BLOCK + 1)
    drawn = np.concatenate(
        [create_generator(*key, "jitter", block).standard_normal(_BLOCK) for block in blocks]
    )
    late = drawn[numbers - blocks[0] * _BLOCK] * sensor.jitter_ms / 1000.0 / step_s
    return np.clip(late, -MAX_JITTER_PERIODS, MAX_JITTER_PERIODS)
