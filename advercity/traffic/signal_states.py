"""States of traffic lights: of the links of an approach, and over a fixed program."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.frames import Signal
from advercity.roads.network_file import read_network, read_signal_groups

_SIGNALS = {"g": Signal.GREEN, "y": Signal.YELLOW}


def combine_links(states: Sequence[str], links: Iterable[tuple[int, int]]) -> Signal:
    """Return the signal of an approach: the most permissive state of its links."""
    return max(_SIGNALS.get(states[light][link].lower(), Signal.RED) for light, link in links)


def build_program_states(
    network: Path, times_s: NDArray[np.float64]
) -> tuple[tuple[str, ...], NDArray[np.uint8]]:
    """Build the signals of a SUMO network's lights by their fixed programs.

    Args:
        network: The network.
        times_s: (ticks,) times since the programs began.

    Returns:
        Ids of `SignalLamp`, and (ticks, signals) of `Signal`.
    """
    groups = read_signal_groups(network)
    programs = {program.light: program for program in read_network(network).programs}
    lights = list({light: None for links in groups.values() for light, _ in links})
    indexed = [[(lights.index(light), link) for light, link in links] for links in groups.values()]
    rows = [
        [
            combine_links([programs[light].find_state(time_s) for light in lights], links)
            for links in indexed
        ]
        for time_s in times_s.tolist()
    ]
    return tuple(groups), np.array(rows, dtype=np.uint8).reshape(len(times_s), len(groups))
