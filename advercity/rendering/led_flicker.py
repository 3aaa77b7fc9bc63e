"""Flicker of LEDs: light collected by a camera from lamps switching while its shutter is open.

Signals run on rectified mains. Tail lamps are often brake lamps dimmed by pulses, which are on for
the ratio of the two luminances. Both are taken for square waves, so the light in an exposure has a
closed form: a short one collects much more than the mean light, or none.
"""

import math
from dataclasses import replace

from advercity.frames import ActorState, Frame
from advercity.randomness import create_generator
from advercity.rendering.light_sources import BRAKE_CD, TAIL_CD

SIGNAL_HZ, SIGNAL_DUTY = 120.0, 0.5
"""Twice the frequency of North American mains, and the fraction of a half-wave in which the voltage
exceeds the LEDs' forward voltage; an engineering value."""
TAIL_HZ_RANGE = (90.0, 300.0)
"""Range of the frequencies of pulses; from 90 Hz on drivers do not see them."""
TAIL_DUTY = TAIL_CD / BRAKE_CD


def compute_collected_ratio(
    start_s: float, end_s: float, *, frequency_hz: float, duty: float, phase: float
) -> float:
    """Compute the light of a lamp in an exposure relative to its mean, 0 to 1 / duty.

    The lamp is on in the first `duty` of each period; `phase`, in periods, holds at time 0.
    """

    def count_on_periods(time_s: float) -> float:
        periods = time_s * frequency_hz + phase
        return math.floor(periods) * duty + min(periods % 1.0, duty)

    collected = count_on_periods(end_s) - count_on_periods(start_s)
    return collected / ((end_s - start_s) * frequency_hz * duty)


def apply_led_flicker(frame: Frame, exposure_s: float, *, seed: int) -> Frame:
    """Dim or brighten the lamps of a frame to their light in an exposure around its instant.

    Each vehicle has a frequency and a phase of its own; signals have the mains' frequency and,
    since they are on different phases of it, one of three phases.
    """
    start_s, end_s = frame.time_s - exposure_s / 2, frame.time_s + exposure_s / 2

    def dim_tail_lamps(state: ActorState) -> ActorState:
        rng = create_generator(seed, "tail lamps", state.actor.id)
        ratio = compute_collected_ratio(
            start_s,
            end_s,
            frequency_hz=rng.uniform(*TAIL_HZ_RANGE),
            duty=TAIL_DUTY,
            phase=rng.random(),
        )
        return replace(state, tail_light_ratio=ratio)

    signals = {
        name: compute_collected_ratio(
            start_s,
            end_s,
            frequency_hz=SIGNAL_HZ,
            duty=SIGNAL_DUTY,
            phase=create_generator(seed, "signal", name).integers(3) / 3,
        )
        for name in frame.signals
    }
    states = tuple(dim_tail_lamps(state) if state.lamps else state for state in frame.states)
    return replace(frame, states=states, signal_light_ratios=signals)
