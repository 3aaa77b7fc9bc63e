"""Tracks of the entities of an OpenSCENARIO scenario, of the vertices that lead them."""

import math
import re
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.recordings.openscenario_document import ScenarioDocument
from advercity.recordings.tracks import (
    MAX_GAP_S,
    BadSampleError,
    Track,
    check_samples,
    derive_headings,
)

SAME_PLACE_M = 0.01
"""An entity that is put no farther from its first vertex waits there until it sets out."""
TIME_TOLERANCE_S = 1e-6
MAX_VERTEX_STEP_S = MAX_GAP_S / 2
"""Points are added on edges of a polyline that take longer."""
MAX_SAMPLES = 10_000_000
"""Points of all trajectories together, added ones included."""


@dataclass(frozen=True)
class Entity:
    """A road user of the scenario; the centre of its box is relative to the reference point."""

    name: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    centre: complex


class Vertex(NamedTuple):
    """Where an entity is at a time.

    Attributes:
        time_s: The time.
        place: Its reference point, east + i north in m.
        heading: In rad; NaN if it is not given.
        level: How long what points ahead by 1 m is in the plan, by the pitch.
    """

    time_s: float
    place: complex
    heading: float
    level: float


@dataclass
class Motion:
    """What the scenario does to an entity.

    Attributes:
        teleport: Where it is put at the start, or None.
        vertices: Where it is led.
        added_s: Time at which it is added; None if it is there from the start.
        deleted_s: Time at which it is deleted.
        element: Its first trajectory, for messages.
        speed: The action that gives it a speed at the start.
    """

    teleport: Vertex | None = None
    vertices: list[Vertex] = field(default_factory=list[Vertex])
    added_s: float | None = None
    deleted_s: float = math.inf
    element: Element | None = None
    speed: Element | None = None


class TrackBuilder:
    """Builds the tracks of a scenario, which together have at most `MAX_SAMPLES` points.

    Attributes:
        remarks: What was left out.
    """

    def __init__(self, document: ScenarioDocument) -> None:
        self._document = document
        self._sample_count = 0
        self.remarks: list[str] = []

    def build(self, entity: Entity, motion: Motion, end_s: float) -> Track | None:
        """Build the track of an entity; None if it is nowhere, which is remarked."""
        vertices = sorted(motion.vertices, key=lambda vertex: vertex.time_s)
        begin = motion.teleport
        if begin is not None and motion.added_s is None:
            if not vertices:
                vertices = [begin, begin._replace(time_s=end_s)]
            elif vertices[0].time_s > 0 and abs(vertices[0].place - begin.place) < SAME_PLACE_M:
                vertices.insert(0, begin)
        if len(vertices) < 2:
            self.remarks.append(
                f"{self._document.path}: '{entity.name}' is left out: it is nowhere"
            )
            return None
        self._sample_count += len(vertices) + int(
            (vertices[-1].time_s - vertices[0].time_s) / MAX_VERTEX_STEP_S
        )
        if self._sample_count > MAX_SAMPLES:
            message = f"up to '{entity.name}', trajectories have more than {MAX_SAMPLES:,} points"
            hint = f"with one every {MAX_VERTEX_STEP_S:g} s; shorten the scenario or split it"
            self._document.refuse(self._document.root, message, hint)
            self._document.raise_problems()
        times_s = _densify_times(vertices)
        times_s = times_s[times_s <= motion.deleted_s + TIME_TOLERANCE_S]
        places, headings, levels = _interpolate(vertices, times_s)
        plan = np.column_stack([places.real, places.imag])
        try:
            check_samples(times_s, plan)
        except BadSampleError as error:
            where = motion.element if motion.element is not None else self._document.root
            self._document.refuse(where, f"'{entity.name}': {error.message}", error.hint)
            return None
        if np.isnan(headings).any():
            headings = derive_headings(times_s, plan)
        ahead, left = entity.centre.real * levels, entity.centre.imag
        centres = places + (ahead + 1j * left) * np.exp(1j * headings)
        return Track(
            id=format_id(entity.name),
            actor_class=entity.actor_class,
            size=entity.size,
            times_s=times_s,
            places=np.column_stack([centres.real, centres.imag]),
            headings_rad=np.unwrap(headings),
        )


def format_id(name: str) -> str:
    """Format the name of an entity as a road may call a track, `TrackId`."""
    return re.sub(r"[^A-Za-z0-9_.:-]", "_", name)[:64]


def _densify_times(vertices: list[Vertex]) -> NDArray[np.float64]:
    """List the times of vertices, and times between those that are far apart."""
    times_s = [vertex.time_s for vertex in vertices]
    pieces = [
        np.linspace(begin, end, max(math.ceil((end - begin) / MAX_VERTEX_STEP_S), 1) + 1)[:-1]
        for begin, end in pairwise(times_s)
    ]
    # Repeated times stay, so that they are found: they have no piece between them.
    return np.concatenate([*pieces, times_s[-1:]])


def _interpolate(
    vertices: list[Vertex], at_s: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """Interpolate places, headings and levels (n,) at times (n,)."""
    times_s, places, headings, levels = (np.array(column) for column in zip(*vertices, strict=True))
    if not np.isnan(headings).any():
        headings = np.unwrap(headings)
    return (
        np.asarray(np.interp(at_s, times_s, places), dtype=np.complex128),
        np.interp(at_s, times_s, headings),
        np.interp(at_s, times_s, levels),
    )
