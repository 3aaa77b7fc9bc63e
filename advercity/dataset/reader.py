"""Reads a dataset lazily: scenarios, their frames, and the data of each agent in them.

Objects here are paths and numbers, cheap to make and to pickle. A file is read when a property asks
for it, and is not kept, except for the manifest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.formats import DatasetFormat, find_format, format_frame_name
from advercity.dataset.sample_series import (
    SampleKind,
    SampleSeries,
    join_can_samples,
    join_fixes,
    join_imu_samples,
)
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    MANIFEST_VERSION,
    find_journals,
    find_scenarios,
)
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity_dsl import Channel, Spec
    from advercity_dsl.road import LeftOut

    from advercity.conflicts.roles import ConflictRoles
    from advercity.dataset.manifest import Manifest
    from advercity.dataset.received_messages import ReceivedMessage


class FrameView:
    """One frame of a scenario, with the view of every agent.

    Attributes:
        scenario: The scenario.
        index: Number of the frame, counted from the first kept one.
        name: Beginning of its files' names, six digits.
        views: Views by agent id, in the order of the spec.
    """

    def __init__(self, scenario: Scenario, index: int) -> None:
        self.scenario = scenario
        self.index = index
        self.name = scenario.format_frame_name(index)
        self.views = {view.id: view for view in scenario.open_views(index)}

    @property
    def time_s(self) -> float:
        """Time since the scenario's start in seconds, warm-up included."""
        return self.scenario.find_time_s(self.index)

    def messages(self, receiver: str, *, latest: bool = True) -> tuple[ReceivedMessage, ...]:
        """Load the V2X messages received by an agent up to this frame.

        Only written frames count: messages sent before the first of them are missing.

        Args:
            receiver: Id of the agent: `cav1`.
            latest: Only the newest of each sender and kind; else all within the channel's lifetime.

        Raises:
            InputError: The scenario has no channel, or a file cannot be read.
        """
        # Imported here: most datasets have no messages.
        from advercity.dataset.received_messages import find_received_messages

        return tuple(find_received_messages(self, receiver, latest=latest))

    def __getitem__(self, agent: str) -> AgentView:
        """Return the view of an agent by its id: `cav1`, `rsu2`."""
        return self.views[agent]


class Scenario(Sequence[FrameView]):
    """The written frames of one scenario, in order.

    Args:
        path: Folder of the scenario.

    Raises:
        InputError: The folder is no scenario.
        RunError: Its manifest is damaged or of another version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._frame_numbers = self._load_frame_numbers()

    @cached_property
    def manifest(self) -> Manifest:
        """The manifest with the spec, read at the first use and then kept."""
        # Imported here: building its pydantic models takes longer than opening a dataset.
        from advercity.dataset.manifest import Manifest

        return Manifest.load(self.path)

    @property
    def spec(self) -> Spec:
        """The spec of the scenario."""
        return self.manifest.spec

    @property
    def format(self) -> DatasetFormat:
        """The layout of the files."""
        return find_format(self.manifest.identity.format)

    @property
    def id(self) -> str:
        """Id of the scenario, as in predictions."""
        return self.spec.id

    @property
    def agents(self) -> tuple[str, ...]:
        """Ids of the agents."""
        return tuple(agent.id for agent in self.spec.recorded_agents)

    @property
    def ego(self) -> str:
        """Id of the ego agent."""
        return self.spec.ego.id

    @property
    def ego_size(self) -> tuple[float, float, float] | None:
        """Length, width and height of the ego in metres; None if unknown."""
        return self.spec.blueprints[str(self.spec.ego.blueprint)].size

    @property
    def channel(self) -> Channel | None:
        """The V2X channel; None without messages."""
        return self.spec.channel

    @property
    def labels(self) -> Mapping[str, str]:
        """Properties by which scenarios differ: weather, time, density, road, swept value."""
        spec = self.spec
        swept = [format_swept_value(point.value) for point in spec.provenance.sweep_points]
        return {
            "weather": spec.weather.id,
            "time": spec.weather.time,
            "density": spec.density.id,
            "road": spec.road.id,
            **({"sweep": ", ".join(swept)} if swept else {}),
        }

    @cached_property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Unread parts of foreign files; empty for a dataset of advercity."""
        return ()

    def format_frame_name(self, index: int) -> str:
        """Format the beginning of the names of a frame's files."""
        return format_frame_name(self.spec, index)

    def find_time_s(self, index: int) -> float:
        """Find the time of a frame since the scenario's start in seconds, warm-up included."""
        return int(self.format_frame_name(index)) * self.spec.timing.tick_s

    def open_views(self, index: int) -> Sequence[AgentView]:
        """Open the view of every agent of a frame."""
        name, layout = self.format_frame_name(index), self.format
        return [
            AgentView(agent, index, layout, self.path / layout.format_folder(agent) / name)
            for agent in self.spec.recorded_agents
        ]

    @property
    def roles(self) -> ConflictRoles:
        """Roles of actors in staged conflicts, by actor id as in `Boxes.ids`."""
        from advercity.conflicts.roles import find_conflict_roles

        return find_conflict_roles(self.spec)

    @property
    def frame_numbers(self) -> tuple[int, ...]:
        """Numbers of the written frames, counted from the first kept one."""
        return self._frame_numbers

    def frame(self, index: int) -> FrameView:
        """Return the frame with a number, counted from the first kept one."""
        return FrameView(self, index)

    def load_samples(self, agent: str, kind: SampleKind) -> SampleSeries:
        """Load all samples of an agent's receiver, inertial unit or bus in the written frames.

        Frames are at `frame.time_s` on the same time axis; a missing sensor has no samples. Reads
        one file per frame.
        """
        views = [(frame.time_s, frame[agent]) for frame in self]
        if kind == "gnss":
            return join_fixes((time_s, view.motion[0]) for time_s, view in views)
        if kind == "imu":
            return join_imu_samples((time_s, view.motion[1]) for time_s, view in views)
        return join_can_samples((time_s, view.can) for time_s, view in views)

    def load_stamps(self, agent: str) -> dict[str, NDArray[np.float64]]:
        """Load the times (n,) of an agent's measurements since the scenario's start, by sensor.

        `camera0`, `lidar0`, `radar0` and `thermal0` count as in the files and have a time for
        every frame: the time of the sample in its file, unchanged if there was no new sample.
        `gnss`, `imu` and `can` are present if the agent has them.
        """
        # Imported here: the models of the language take longer than opening a dataset.
        from advercity_dsl.sensor_kinds import load_sensor_kinds

        sensors = self[0][agent].agent.sensors
        found = [(frame.time_s, frame[agent].stamps) for frame in self]
        names = [
            f"{kind.name}{number}"
            for kind in load_sensor_kinds().found.values()
            if kind.has_place
            for number in range(len(sensors.list_sensors(kind.name)))
        ]
        stamps = {
            name: np.array([own.get(name, time_s) for time_s, own in found]) for name in names
        }
        kinds: tuple[SampleKind, ...] = ("gnss", "imu", "can")
        series = {kind: self.load_samples(agent, kind).times_s for kind in kinds}
        return stamps | {kind: times for kind, times in series.items() if len(times)}

    def find_nearest(self, agent: str, sensor: str, times_s: ArrayLike) -> NDArray[np.int64]:
        """Find the numbers (m,) of the frames whose sample of a sensor is nearest to times (m,).

        `sensor` is a name of `load_stamps`, such as `lidar0`; equal samples give the first frame.
        """
        stamps = self.load_stamps(agent)
        if sensor not in stamps or sensor in ("gnss", "imu", "can"):
            raise InputError(f"{agent} has no sensor '{sensor}' with a moment of its own")
        off = np.abs(np.atleast_1d(np.asarray(times_s, np.float64))[:, None] - stamps[sensor])
        return np.array(self._frame_numbers)[off.argmin(axis=1)]

    def __len__(self) -> int:
        """Return the number of written frames."""
        return len(self._frame_numbers)

    @overload
    def __getitem__(self, index: int) -> FrameView: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameView]: ...
    def __getitem__(self, index: int | slice) -> FrameView | list[FrameView]:
        """Return the frame at a position among the written ones."""
        if isinstance(index, slice):
            return [self.frame(number) for number in self._frame_numbers[index]]
        return self.frame(self._frame_numbers[index])

    def _load_frame_numbers(self) -> tuple[int, ...]:
        """Read the numbers of the written frames, without the models of the manifest if possible.

        Damaged manifests, and manifests of interrupted runs, go through `Manifest.load`.
        """
        try:
            path = self.path / MANIFEST_FILE
            document = parse_json(read_bytes(path, max_bytes=MAX_JSON_BYTES), path)
            if document["manifest_version"] == MANIFEST_VERSION and not find_journals(self.path):
                return tuple(document["frames"])
        except (InputError, LookupError, OSError, TypeError):
            pass
        return self.manifest.frames


class Dataset(Sequence[FrameView]):
    """All frames of all scenarios of a dataset, one scenario after the other.

    It has a length and an index, all that PyTorch's `DataLoader` asks for.

    Args:
        path: Folder of a dataset, or of one scenario.
        layout: Layout of a foreign folder, as for `open_dataset`.

    Raises:
        InputError: The folder holds no scenario.
    """

    def __init__(self, path: Path, layout: str | None = None) -> None:
        self.scenarios = open_scenarios(path, layout)
        self._ends = np.cumsum([len(scenario) for scenario in self.scenarios])

    def __len__(self) -> int:
        """Return the number of frames of all scenarios."""
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> FrameView: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameView]: ...
    def __getitem__(self, index: int | slice) -> FrameView | list[FrameView]:
        """Return the frame at a position, counted through all scenarios."""
        if isinstance(index, slice):
            return [self[position] for position in range(len(self))[index]]
        position = range(len(self))[index]  # resolves negative positions, raises IndexError
        number = int(np.searchsorted(self._ends, position, side="right"))
        scenario = self.scenarios[number]
        return scenario[position - int(self._ends[number])]

    def __iter__(self) -> Iterator[FrameView]:
        """Iterate over the frames, scenario by scenario."""
        for scenario in self.scenarios:
            yield from scenario


def format_swept_value(value: float) -> str:
    """Format the value of a swept field as a label."""
    return f"{value:g}"


def open_scenarios(path: Path, layout: str | None = None) -> tuple[Scenario, ...]:
    """Open the scenarios of a folder, as `open_dataset` does."""
    if layout is None:
        return tuple(map(Scenario, find_scenarios(path)))
    # Imported here, because it builds on this module.
    from advercity.dataset.foreign_folders import open_foreign_scenarios

    return open_foreign_scenarios(path, layout)


def open_dataset(path: Path | str, layout: str | None = None) -> Dataset:
    """Open the folder of a dataset, or of one scenario.

    Only frame numbers are read; the first frame taken from a scenario reads its manifest.

    Args:
        path: The folder.
        layout: Layout of a foreign folder: `opv2v` (OPV2V, V2XSet, V2V4Real) or `adver_city`.

    Raises:
        InputError: The folder holds no scenario, or none of this layout.
    """
    return Dataset(Path(path), layout)
