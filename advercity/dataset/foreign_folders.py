"""Folders of other programs in the layout of OPV2V: scenarios, agents and frames by their names.

Without a manifest there is no spec: road, weather, density and conflicts are not known, and an
agent's sensors are found from its frames.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from advercity.dataset.cloud_files import read_foreign_pcd
from advercity.dataset.foreign_view import ForeignView
from advercity.dataset.formats import ADVER_CITY, OPV2V, DatasetFormat
from advercity.dataset.reader import Scenario
from advercity.dataset.scenario_folders import check_is_readable
from advercity.documents import suggest_path
from advercity.errors import InputError
from advercity.foreign.ledger import Ledger

if TYPE_CHECKING:
    from advercity_dsl.road import LeftOut

    from advercity.dataset.manifest import Manifest

LAYOUTS = {
    OPV2V.name: replace(OPV2V, read_cloud=read_foreign_pcd),
    ADVER_CITY.name: ADVER_CITY,
}
FRAME_S = 0.1
"""Time between frames; OPV2V's loaders take it for granted, and V2V4Real is recorded at 10 Hz."""
NOT_HELD = (
    "road",
    "weather",
    "visibility",
    "density",
    "traffic lights",
    "conflicts",
    "V2X messages",
)
"""Facts missing in folders without a manifest."""


def open_foreign_scenarios(path: Path, layout: str) -> tuple[ForeignScenario, ...]:
    """Open the scenarios in a folder, in its splits, or the folder itself.

    Raises:
        InputError: There is no such layout, or no scenario of it.
        RunError: A folder may not be read.
    """
    if layout not in LAYOUTS:
        raise InputError(f"`layout` {layout}: no such layout; {' or '.join(LAYOUTS)}")
    check_is_readable(path)
    for folders in ([path], path.glob("*/"), path.glob("*/*/")):
        found = [folder for folder in sorted(folders) if _find_agent_folders(folder)]
        if found:
            return tuple(ForeignScenario(folder, LAYOUTS[layout]) for folder in found)
    if not path.is_dir():
        raise InputError(f"{path}: no such folder; {suggest_path(path) or 'is the path right?'}")
    raise InputError(
        f"{path}: not in the layout {layout}: no scenario with agents' numbered folders, such as"
        " 641, with frames, such as 000068.yaml"
    )


@dataclass(frozen=True)
class _AgentFolder:
    path: Path

    @property
    def number(self) -> int:
        return int(self.path.name)

    def list_frames(self) -> list[str]:
        """List the names of the frames, in the order of loaders."""
        names = (item.stem for item in self.path.glob("[0-9]*.yaml"))
        return sorted(name for name in names if re.fullmatch(r"[0-9]+", name))


def _find_agent_folders(scenario: Path) -> list[_AgentFolder]:
    """Find the folders of agents, the ego's first.

    Loaders take the first in the order of text as the ego, but no roadside unit.
    """
    paths = sorted(path for path in scenario.glob("*/") if re.fullmatch(r"[+-]?[0-9]+", path.name))
    found = [item for item in map(_AgentFolder, paths) if item.list_frames()]
    return sorted(found, key=lambda item: item.number < 0)


class ForeignScenario(Scenario):
    """A scenario of another program.

    Args:
        path: Folder of the scenario.
        layout: Layout of its files.

    Raises:
        InputError: Two folders have one number.
    """

    def __init__(self, path: Path, layout: DatasetFormat) -> None:
        self._layout = layout
        self._folders = _find_agent_folders(path)
        numbers = [item.number for item in self._folders]
        if len(set(numbers)) < len(numbers):
            raise InputError(f"{path}: two folders of agents have one number; rename one of them")
        names = [item.list_frames() for item in self._folders]
        self._names = sorted(set(names[0]).intersection(*names))
        self._incomplete = len(set(chain(*names))) - len(self._names)
        super().__init__(path)

    @cached_property
    def manifest(self) -> Manifest:
        """Raises an InputError: there is none."""
        raise InputError(
            f"{self.path}: of another program, which does not say: {', '.join(NOT_HELD)}"
        )

    @property
    def format(self) -> DatasetFormat:
        """The layout of the files."""
        return self._layout

    @property
    def id(self) -> str:
        """Name of the folder."""
        return self.path.name

    @property
    def agents(self) -> tuple[str, ...]:
        """Ids of the agents, their numbers; the ego's first."""
        return tuple(str(item.number) for item in self._folders)

    @property
    def ego(self) -> str:
        """Id of the first vehicle, which loaders of OPV2V take as the ego."""
        return self.agents[0]

    @property
    def ego_size(self) -> None:
        """None: no file says it."""

    @property
    def channel(self) -> None:
        """None: the folder has no messages."""

    @property
    def labels(self) -> Mapping[str, str]:
        """Empty: the folder does not say how scenarios differ."""
        return {}

    @cached_property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Keys of the first frame without a reader, and frames missing at some agents."""
        ledger = Ledger()
        for view in self.open_views(0) if self._names else ():
            view.audit(ledger)
        if self._incomplete:
            ledger.leave_out(
                "frame missing at some agents",
                plural="frames missing at some agents",
                count=self._incomplete,
            )
        return ledger.left_out

    def format_frame_name(self, index: int) -> str:
        """Return the name of a frame, which its files begin with."""
        return self._names[index]

    def find_time_s(self, index: int) -> float:
        """Find the time of a frame since the first one in seconds."""
        return index * FRAME_S

    def open_views(self, index: int) -> list[ForeignView]:
        """Open the view of every agent of a frame."""
        name = self.format_frame_name(index)
        return [
            ForeignView(
                folder.number,
                index,
                self._layout,
                folder.path / name,
                is_ego=folder is self._folders[0],
            )
            for folder in self._folders
        ]

    def _load_frame_numbers(self) -> tuple[int, ...]:
        return tuple(range(len(self._names)))
