"""Bursts of loss, errors of localisation and clocks: random, but fixed by their purpose.

Every number is drawn from a stream of its own, whose key has the scenario's seeds, road and traffic
but not its weather: all weathers lose the same messages, as far as their radio is the same.
"""

import math
from functools import lru_cache

import numpy as np
from advercity_dsl import Channel, Spec
from advercity_dsl.channel import Loss

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator, sample_gauss_markov

SHADOWING_STEPS = 4
"""Steps of the shadowing process in its decorrelation distance; it is interpolated between them."""
_CHUNK = 256


class ChannelRandomness:
    """The random numbers of a scenario's channel, in any order of frames and links."""

    def __init__(self, spec: Spec, channel: Channel, *, duration_s: float) -> None:
        self._key = (spec.seeds.sensors, spec.seeds.traffic, spec.road.id)
        self._channel, self._tick_s = channel, spec.timing.tick_s
        self._duration_s = duration_s
        self._find_switches = lru_cache(maxsize=1024)(self._draw_switches)

    def make_generator(self, purpose: str, *more: int | str) -> np.random.Generator:
        """Create the generator of a purpose, as `channel loss`."""
        return create_generator(*self._key, f"channel {purpose}", *more)

    def draw_shadowing(self, first: str, second: str, driven_m: float) -> float:
        """Draw the standard normal shadowing of a link, which has no direction.

        It is a stationary Gauss-Markov process over the distance driven by both stations (3GPP TR
        36.885, A.1.4), known at steps and interpolated to variance 1 between them.
        """
        radio = self._channel.radio
        assert radio is not None, "shadowing without a radio"
        step, fraction = divmod(driven_m / radio.shadow_decorrelation_m * SHADOWING_STEPS, 1.0)
        correlation = math.exp(-1.0 / SHADOWING_STEPS)
        generator = self.make_generator("shadowing", *sorted((first, second)))
        states = sample_gauss_markov(
            generator, int(step), int(step) + 1, correlation=correlation, axes=1
        )
        weights = np.array([1.0 - fraction, fraction])
        variance = weights @ weights + 2.0 * weights.prod() * correlation
        return float(weights @ states[:, 0]) / math.sqrt(variance)

    def draw_blockage(self, first: str, second: str, blocker: int) -> float:
        """Draw the standard normal number of a vehicle on a link, the same while it is there."""
        generator = self.make_generator("blockage", *sorted((first, second)), blocker)
        return float(generator.standard_normal())

    def find_loss_rate(self, sender: str, receiver: str, time_s: float) -> float:
        """Find the probability of loss on a link at a time since the scenario's start."""
        loss = self._channel.loss
        if not loss.burst_fraction:
            return loss.rate
        starts_in_burst, switches_s = self._find_switches(sender, receiver)
        is_switched = int(np.searchsorted(switches_s, time_s, side="right")) % 2 == 1
        return loss.burst_rate if starts_in_burst != is_switched else loss.rate

    def _draw_switches(self, sender: str, receiver: str) -> tuple[bool, Float64Array]:
        generator = self.make_generator("bursts", sender, receiver)
        return draw_burst_switches(self._channel.loss, self._duration_s, generator)

    def draw_clock_offset_s(self, agent: str) -> float:
        """Draw the offset of an agent's clock."""
        offset = self.make_generator("clock", agent).standard_normal()
        return float(offset) * self._channel.clock.offset_s

    def draw_pose_error(self, agent: str, frame: int) -> tuple[Float64Array, float]:
        """Draw the errors (3,) in metres, world axes, and in radians of an agent's pose."""
        error = self._channel.pose_error
        # Always four numbers each: a change of one error leaves the others.
        noise = self.make_generator("pose", agent, frame).standard_normal(4)
        wander = sample_gauss_markov(
            self.make_generator("pose wander", agent),
            frame,
            frame,
            correlation=math.exp(-self._tick_s / error.wander_time_s),
            axes=4,
        )[0]
        upwards = np.array([1.0, 1.0, error.vertical_factor])
        position = upwards * (error.white_noise_m * noise[:3] + error.wander_m * wander[:3])
        heading_deg = error.heading_noise_deg * noise[3] + error.heading_wander_deg * wander[3]
        return position, math.radians(heading_deg)


def draw_burst_switches(
    loss: Loss, duration_s: float, generator: np.random.Generator
) -> tuple[bool, Float64Array]:
    """Draw whether a link begins in a burst, and the times (n,) when bursts begin or end.

    Both kinds of intervals are exponentially distributed, which makes the start a stationary one:
    a time of any length drawn from a moment on is distributed as from any other.

    Args:
        loss: Loss with bursts.
        duration_s: Time to cover; a longer one gives the same times and more of them.
        generator: Generator of the link.
    """
    good_s = loss.burst_s * (1.0 - loss.burst_fraction) / loss.burst_fraction
    starts_in_burst = bool(generator.random() < loss.burst_fraction)
    means_s = np.array([loss.burst_s, good_s] if starts_in_burst else [good_s, loss.burst_s])
    switches_s = np.zeros(1)
    while switches_s[-1] < duration_s:
        lengths_s = (generator.standard_exponential((_CHUNK, 2)) * means_s).ravel()
        switches_s = np.append(switches_s, switches_s[-1] + np.cumsum(lengths_s))
    return starts_in_burst, switches_s[1:]
