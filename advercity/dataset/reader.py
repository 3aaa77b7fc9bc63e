"""Reads a dataset lazily: scenarios, their frames, and the viewpoints of each.

Nothing is read before it is asked for, and nothing is kept: objects here are paths and
numbers, cheap to make and to pickle.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np
from advercity_dsl import Spec

from advercity.conflicts.roles import ConflictRoles, find_conflict_roles
from advercity.dataset.agent_view import AgentView
from advercity.dataset.formats import DatasetFormat, find_format, format_frame_name
from advercity.dataset.manifest import Manifest, find_scenarios


class FrameView:
    """One frame of a scenario: all its viewpoints."""

    def __init__(self, scenario: "Scenario", index: int) -> None:
        self.scenario = scenario
        self.index = index
        layout = scenario.format
        self.views = {
            agent.id: AgentView(
                agent, index, layout, scenario.path / layout.format_folder(agent) / self.name
            )
            for agent in scenario.spec.agents
        }
        """By agent id, in the order of the spec."""

    @property
    def name(self) -> str:
        """As its files are called."""
        return format_frame_name(self.scenario.spec, self.index)

    @property
    def time_s(self) -> float:
        """Since the scenario's start, warm-up included."""
        return int(self.name) * self.scenario.spec.timing.tick_s

    def __getitem__(self, agent: str) -> AgentView:
        """The viewpoint of an agent, by its id: `cav1`, `rsu2`."""
        return self.views[agent]


class Scenario(Sequence[FrameView]):
    """The frames of one scenario that are there.

    Args:
        path: Its folder.

    Raises:
        InputError: It is not a scenario.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.manifest = Manifest.load(path)

    @property
    def spec(self) -> Spec:
        """What it was made from."""
        return self.manifest.spec

    @property
    def format(self) -> DatasetFormat:
        """How it is laid out."""
        return find_format(self.manifest.identity.format)

    @property
    def agents(self) -> tuple[str, ...]:
        """Ids of the viewpoints."""
        return tuple(agent.id for agent in self.spec.agents)

    @property
    def roles(self) -> ConflictRoles:
        """Who takes part in which staged conflict, and as what, by ids as in `Boxes`."""
        return find_conflict_roles(self.spec)

    def frame(self, index: int) -> FrameView:
        """The frame with that number, counted from the first kept one."""
        return FrameView(self, index)

    def __len__(self) -> int:
        """Frames that are there."""
        return len(self.manifest.frames)

    @overload
    def __getitem__(self, index: int) -> FrameView: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameView]: ...
    def __getitem__(self, index: int | slice) -> FrameView | list[FrameView]:
        """The frame at a position among those that are there."""
        if isinstance(index, slice):
            return [self.frame(number) for number in self.manifest.frames[index]]
        return self.frame(self.manifest.frames[index])


class Dataset(Sequence[FrameView]):
    """All frames of all scenarios of a dataset, one after the other.

    It has a length and takes an index, which is all that PyTorch's `DataLoader` asks for.

    Args:
        path: Folder of a dataset, or of one scenario.

    Raises:
        InputError: There is no scenario in it.
    """

    def __init__(self, path: Path) -> None:
        self.scenarios = tuple(Scenario(folder) for folder in find_scenarios(path))
        self._ends = np.cumsum([len(scenario) for scenario in self.scenarios])

    def __len__(self) -> int:
        """Frames in all."""
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> FrameView: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameView]: ...
    def __getitem__(self, index: int | slice) -> FrameView | list[FrameView]:
        """The frame at a position, counted through all scenarios."""
        if isinstance(index, slice):
            return [self[position] for position in range(len(self))[index]]
        position = range(len(self))[index]
        number = int(np.searchsorted(self._ends, position, side="right"))
        scenario = self.scenarios[number]
        return scenario[position - int(self._ends[number])]

    def __iter__(self) -> Iterator[FrameView]:
        """Scenario by scenario."""
        for scenario in self.scenarios:
            yield from scenario


def open_dataset(path: Path | str) -> Dataset:
    """Open the folder of a dataset, or of one scenario; InputError if it is none."""
    return Dataset(Path(path))
