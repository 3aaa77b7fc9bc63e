"""Tells people of one blueprint apart: each has a number, by which bodies differ."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from advercity.frames import Actor, Frame


def number_figures(actors: Iterable[Actor]) -> dict[int, int]:
    """Number the people of each blueprint from 0, by ascending id; the numbers by id.

    The trace of a scenario is the same in all weathers, so a person is, too.
    """
    counts: dict[str, int] = {}
    figures: dict[int, int] = {}
    for actor in sorted(actors, key=lambda actor: actor.id):
        if actor.actor_class == "pedestrian":
            figures[actor.id] = counts.get(actor.blueprint, 0)
            counts[actor.blueprint] = figures[actor.id] + 1
    return figures


def assign_figures(frame: Frame, figures: Mapping[int, int]) -> Frame:
    """Give the people of a frame their numbers."""
    states = tuple(replace(state, figure=figures.get(state.actor.id, 0)) for state in frame.states)
    return replace(frame, states=states)
