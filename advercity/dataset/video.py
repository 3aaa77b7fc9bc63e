"""Films of a scenario, as MP4 by PyAV."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.dataset import film
from advercity.dataset.damage import no_frames
from advercity.dataset.manifest import scenarios
from advercity.dataset.reader import FrameView, Scenario
from advercity.errors import InputError
from advercity.reel import Reel

KINDS = ("front", "mosaic", "semantic", "lidar")

Draw = Callable[[FrameView], NDArray[np.uint8]]


def write_videos(dataset: Path, output: Path, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Film every scenario of a dataset; the files.

    `front` is one file per viewpoint, the others one per scenario.

    Raises:
        InputError: No such kind, no such dataset, or PyAV is not installed.
        RunError: A file cannot be written.
    """
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise InputError(f"--kind {unknown[0]}: no such film; {', '.join(KINDS)}")
    written: list[Path] = []
    for folder in scenarios(dataset):
        scenario = Scenario(folder)
        if not len(scenario):
            raise no_frames(folder)
        films = dict(_films(scenario, kinds))
        paths = {name: output / f"{folder.name}_{name}.mp4" for name in films}
        with ExitStack() as stack:
            tick_s = scenario.spec.timing.tick_s
            reels = {name: stack.enter_context(Reel(path, tick_s)) for name, path in paths.items()}
            for frame in scenario:
                for name, draw in films.items():
                    reels[name].add(draw(frame))
        written += paths.values()
    return written


def _films(scenario: Scenario, kinds: Sequence[str]) -> Iterator[tuple[str, Draw]]:
    whole: dict[str, Draw] = {
        "mosaic": film.mosaic,
        "semantic": film.semantic,
        "lidar": film.from_above,
    }
    for kind in kinds:
        if kind == "front":
            for agent in scenario.agents:
                yield f"{agent}_front", lambda frame, agent=agent: film.front(frame[agent])
        else:
            yield kind, whole[kind]
