"""How a dataset keeps measurements: the files of a kind of sensor, and its part of documents."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from advercity_dsl import Agent

    from advercity.dataset.agent_view import AgentView
    from advercity.dataset.formats import DatasetFormat
    from advercity.geometry.poses import Matrix
    from advercity.run_options import CloudEncoding
    from advercity.sensors.sensor_frame import SensorFrame

EncodingJobs = Mapping[str, Callable[[], bytes]]
"""Functions making the bytes of files, by the ends of their names."""


@dataclass(frozen=True)
class FileOptions:
    """How the files of a run are written.

    Attributes:
        layout: Layout of the dataset.
        clouds: Encoding of PCD files.
    """

    layout: DatasetFormat
    clouds: CloudEncoding


def _list_none(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    return ()


def _encode_none(item: SensorFrame, number: int, options: FileOptions) -> EncodingJobs:
    return {}


def _describe_none(item: SensorFrame, number: int) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class SensorFiles:
    """How a dataset keeps the measurements of a kind of sensor.

    Documents hold plain types and are left-handed, as in `frame_documents`. Sensors are given by
    their number within the kind. Only sensors without a place may lack a measurement.

    Attributes:
        read: Reads a measurement back, right-handed, as its driver returned it.
        list_suffixes: Lists the ends of the names of a sensor's files in a layout.
        encode: Makes these files; files unknown to the layout are not written.
        describe: Makes entries of `<frame>.yaml`, the pose among them.
        report: Makes entries of the common document of receivers, inertial units and buses.
        label: Makes entries of an object of `_objects.json`, by the actor's id.
        annotate: Makes entries of `_objects.json` itself.
        locate: Reads the pose (4, 4) of a sensor; not of kinds without a place.
    """

    read: Callable[[AgentView, int], Any]
    list_suffixes: Callable[[Agent, int, DatasetFormat], tuple[str, ...]] = _list_none
    encode: Callable[[SensorFrame, int, FileOptions], EncodingJobs] = _encode_none
    describe: Callable[[SensorFrame, int], dict[str, Any]] = _describe_none
    report: Callable[[SensorFrame, int], dict[str, Any]] = _describe_none
    label: Callable[[SensorFrame, int], dict[str, Any]] = _describe_none
    annotate: Callable[[SensorFrame], dict[str, Any]] = lambda item: {}
    locate: Callable[[AgentView, int], Matrix] | None = None


@cache
def load_all_files() -> Mapping[str, SensorFiles]:
    """Load the `SensorFiles` of all kinds of sensors, by name."""
    # Imported here: the models of the language take longer than opening a dataset.
    from advercity_dsl.registry import load_named
    from advercity_dsl.sensor_kinds import load_sensor_kinds

    return {name: load_named(kind.files) for name, kind in load_sensor_kinds().found.items()}


def iterate_readings(
    item: SensorFrame, *, first: tuple[str, ...] = ()
) -> Iterator[tuple[SensorFiles, int]]:
    """Iterate over an agent's measurements: their `SensorFiles` and numbers.

    Kinds come in the order of `first`, then as they are registered.
    """
    kinds = load_all_files()
    for name in dict.fromkeys((*first, *kinds)):
        for number in range(len(item.readings.get(name, ()))):
            yield kinds[name], number
