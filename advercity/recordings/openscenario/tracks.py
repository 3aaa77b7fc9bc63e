"""Tracks of the entities of a played scenario."""

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.stage import Entity, Mover, Sample
from advercity.recordings.tracks import BadSampleError, Track, check_samples, derive_headings

SAME_TIME_S = 1e-6
MOVED_M = 0.01


def format_id(name: str) -> str:
    """Format the name of an entity as a road may call a track, `TrackId`."""
    return re.sub(r"[^A-Za-z0-9_.:-]", "_", name)[:64]


def build_track(scope: Scope, mover: Mover) -> Track | None:
    """Build the track of an entity; None if it is nowhere, or cannot have moved so."""
    entity = mover.entity
    samples = _drop_repeated(mover.samples)
    if len(samples) < 2:
        name = "entity that is nowhere"
        scope.findings.ledger.leave_out(name, plural="entities that are nowhere")
        return None
    times_s = np.array([item.time_s for item in samples])
    points = np.array([item.pose.point for item in samples], dtype=np.complex128)
    plan = np.column_stack([points.real, points.imag]).astype(np.float64)
    try:
        check_samples(times_s, plan)
    except BadSampleError as error:
        hint = f"{error.hint}; teleports and gaps are not followed"
        scope.refuse(_find_object(scope, entity), f"'{entity.name}' {error.message}", hint)
        return None
    headings = np.array([item.pose.heading for item in samples], dtype=np.float64)
    unknown = np.isnan(headings)
    headings[unknown] = derive_headings(times_s, plan)[unknown]
    ahead = entity.centre.real * np.array([item.pose.level for item in samples])
    centres = points + (ahead + 1j * entity.centre.imag) * np.exp(1j * headings)
    return Track(
        id=format_id(entity.name),
        actor_class=entity.actor_class,
        size=entity.size,
        times_s=times_s,
        places=np.column_stack([centres.real, centres.imag]).astype(np.float64),
        headings_rad=np.unwrap(headings),
    )


def _drop_repeated(samples: Sequence[Sample]) -> list[Sample]:
    """Keep the last of samples of one time, in the order of time."""
    ordered = sorted(samples, key=lambda item: item.time_s)
    kept: list[Sample] = []
    for item in ordered:
        if kept and item.time_s - kept[-1].time_s < SAME_TIME_S:
            kept.pop()
        kept.append(item)
    return kept


def _find_object(scope: Scope, entity: Entity) -> Element:
    root = scope.source.root
    found = (
        item
        for item in root.iterfind("Entities/ScenarioObject")
        if scope.get(item, "name") == entity.name
    )
    return next(found, root)


def has_moved(mover: Mover) -> bool:
    """Return whether an entity was at more than one place."""
    return bool(mover.samples) and mover.travelled_m > MOVED_M
