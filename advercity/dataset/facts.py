"""Collect the fact table of statistics: every annotated object of every frame, once."""

import os
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.message_facts import (
    NO_AGES,
    NO_MESSAGES,
    collect_age_facts,
    collect_message_facts,
)
from advercity.dataset.reader import FrameView, Scenario, open_scenarios
from advercity.dataset.scenario_folders import no_frames_error
from advercity.dataset.weather_truth import WeatherTruth
from advercity.errors import RunError
from advercity.physics.timeline import WeatherTimeline
from advercity.processes import end_with_parent
from advercity.sensors.measurements import PointKind

OBJECT_FACT = np.dtype(
    [
        ("frame", "<i4"),
        ("id", "<i8"),
        ("class", "<U12"),
        ("connected", "?"),
        ("speed_km_h", "<f8"),
        ("ego_distance_m", "<f8"),
        ("ego_bearing_rad", "<f8"),
        ("ego_hits", "<f8"),
        ("ego_points", "<f8"),
        ("ego_detections", "<f8"),
        ("visible_fraction", "<f8"),
    ]
)
"""An object in a frame, once however many agents annotate it.

Fields with the prefix `ego` are NaN if the ego does not annotate the object; `ego_detections`, of
its radars, also without a radar. `visible_fraction` is the maximum over all agents.
"""
_NOT_BY_EGO = (np.nan,) * 5
NUM_POINT_KINDS = 256
"""Point kinds are bytes; other distributions have their own."""
UNKNOWN_LABEL = "unknown"
"""Road, density and weather of scenarios that do not state them."""


@dataclass(frozen=True, eq=False)
class ScenarioFacts:
    """Facts of one scenario.

    Attributes:
        road: Id of the road; `unknown` in other datasets, as density and weather.
        density: Id of the density.
        weather: Id of the weather.
        weathers: (frames,) weather of each frame in physical quantities; empty if unknown.
        objects: (n,) of `OBJECT_FACT`, without parked cars.
        parked: (m,) of `OBJECT_FACT`, the parked cars.
        num_annotations: (frames,) number of `objects`.
        speeds_km_h: (frames, connected vehicles), the ego's first.
        radars: Number of radars of all agents.
        radar_detections: (frames, NUM_POINT_KINDS) detections of all radars.
        messages: (k,) of `MESSAGE_FACT`.
        message_ages: (l,) of `AGE_FACT`.
    """

    road: str
    density: str
    weather: str
    weathers: tuple[WeatherTruth, ...]
    objects: NDArray[np.void]
    parked: NDArray[np.void]
    num_annotations: NDArray[np.int64]
    speeds_km_h: NDArray[np.float64]
    radars: int
    radar_detections: NDArray[np.int64]
    messages: NDArray[np.void] = field(default_factory=lambda: NO_MESSAGES)
    message_ages: NDArray[np.void] = field(default_factory=lambda: NO_AGES)

    @property
    def num_frames(self) -> int:
        """Number of frames."""
        return len(self.num_annotations)


def collect_dataset_facts(dataset: Path, layout: str | None = None) -> list[ScenarioFacts]:
    """Collect the facts of every scenario with frames, in parallel processes.

    Args:
        dataset: The folder.
        layout: Layout of a folder in another format, as for `open_dataset`.

    Raises:
        InputError: There is no dataset, it has no frames, or a file of it cannot be read.
        RunError: A reading process cannot start, or was ended.
    """
    scenarios = open_scenarios(dataset, layout)
    # Forking a process with threads, as OpenCV starts them, may deadlock.
    try:
        with ProcessPoolExecutor(
            mp_context=get_context("spawn"), initializer=end_with_parent, initargs=(os.getpid(),)
        ) as pool:
            facts = list(pool.map(collect_scenario_facts, scenarios))
    except BrokenProcessPool as error:
        raise RunError(
            f"{dataset}: a process that read it has ended; is memory short, or may it not start?"
        ) from error
    found = [item for item in facts if item.num_frames]
    if not found:
        raise no_frames_error(dataset)
    return found


def collect_scenario_facts(scenario: Scenario) -> ScenarioFacts:
    """Collect the facts of one scenario; InputError if a file of it cannot be read."""
    found = [_collect_frame_facts(frame) for frame in scenario]
    none, labels = np.empty(0, OBJECT_FACT), scenario.labels
    return ScenarioFacts(
        road=labels.get("road", UNKNOWN_LABEL),
        density=labels.get("density", UNKNOWN_LABEL),
        weather=labels.get("weather", UNKNOWN_LABEL),
        weathers=_list_weathers(scenario) if "weather" in labels else (),
        objects=np.concatenate([none, *(item.objects for item in found)]),
        parked=np.concatenate([none, *(item.parked for item in found)]),
        num_annotations=np.array([len(item.objects) for item in found], np.int64),
        speeds_km_h=np.array([item.speeds_km_h for item in found], np.float64),
        radars=sum(view.radars for view in scenario[0].views.values()) if found else 0,
        radar_detections=np.array([item.radar_detections for item in found], np.int64),
        messages=np.concatenate([NO_MESSAGES, *(item.messages for item in found)]),
        message_ages=np.concatenate([NO_AGES, *(item.message_ages for item in found)]),
    )


def _list_weathers(scenario: Scenario) -> tuple[WeatherTruth, ...]:
    timeline = WeatherTimeline.from_spec(scenario.spec)
    return tuple(WeatherTruth.from_weather(timeline.weather_at(frame.index)) for frame in scenario)


class _FrameFacts(NamedTuple):
    """Facts of one frame, with the fields of `ScenarioFacts`."""

    objects: NDArray[np.void]
    parked: NDArray[np.void]
    speeds_km_h: list[float]
    radar_detections: NDArray[np.int64]
    messages: NDArray[np.void]
    message_ages: NDArray[np.void]


def _collect_frame_facts(frame: FrameView) -> _FrameFacts:
    # The ego first: the first row of an object is kept.
    views = sorted(frame.views.values(), key=lambda view: not view.is_ego)
    vehicles = [view for view in views if not view.is_roadside_unit]
    connected = {view.number for view in vehicles}
    objects: dict[int, tuple[Any, ...]] = {}
    visible: dict[int, float] = {}
    parked: set[int] = set()
    radar_detections = np.zeros(NUM_POINT_KINDS, np.int64)
    for view in views:
        boxes, detections = view.boxes, _load_detections(view)
        radar_detections += np.bincount(detections["kind"], minlength=NUM_POINT_KINDS)
        detected = _count_detections(view, detections, boxes.ids)
        hits = np.where(boxes.lidar_hits < 0, np.nan, boxes.lidar_hits)
        parked.update(boxes.ids[boxes.is_parked].tolist())
        for row, number in enumerate(boxes.ids.tolist()):
            visible[number] = np.fmax(visible.get(number, np.nan), boxes.visible_fraction[row])
            by_agent = (
                *(boxes.distances_m[row], boxes.bearings_rad[row]),
                *(hits[row], boxes.lidar_points[row], detected[row]),
            )
            fact = (
                *(frame.index, number, boxes.classes[row], number in connected),
                boxes.speeds_m_s[row] * KM_H_PER_M_S,
                *(by_agent if view.is_ego else _NOT_BY_EGO),
            )
            objects.setdefault(number, fact)
    facts = np.array([(*fact, visible[number]) for number, fact in objects.items()], OBJECT_FACT)
    is_parked = np.isin(facts["id"], list(parked))
    speeds = [view.speed_m_s * KM_H_PER_M_S for view in vehicles]
    return _FrameFacts(
        facts[~is_parked],
        facts[is_parked],
        speeds,
        radar_detections,
        collect_message_facts(frame),
        collect_age_facts(frame),
    )


def _load_detections(view: AgentView) -> NDArray[np.void]:
    """Load kind and object (n,) of the detections of all radars of an agent."""
    names = ["object_id", "kind"]
    tables = [view.load_radar(number)[names] for number in range(view.radars)]
    none = np.empty(0, [("object_id", "<i4"), ("kind", "u1")])
    return np.concatenate(tables) if tables else none


def _count_detections(
    view: AgentView, detections: NDArray[np.void], ids: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Count the detections of objects (n,) without mirror images; NaN if there is no radar."""
    if not view.radars:
        return np.full(len(ids), np.nan)
    found = detections["object_id"][detections["kind"] == PointKind.SURFACE]
    return (found[None, :] == ids[:, None]).sum(axis=1).astype(np.float64)
