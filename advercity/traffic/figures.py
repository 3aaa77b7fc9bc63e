"""Number people and semi-trailers of one blueprint, for different bodies."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from advercity.frames import Actor, Frame


def number_figures(actors: Iterable[Actor]) -> dict[int, int]:
    """Number the people and semi-trailers of each blueprint from 0 by ascending id; keys are ids.

    All weathers share a scenario's trace, so a person looks the same in all of them.
    """
    counts: dict[str, int] = {}
    figures: dict[int, int] = {}
    for actor in sorted(actors, key=lambda actor: actor.id):
        if actor.actor_class == "pedestrian" or actor.towed_by:
            figures[actor.id] = counts.get(actor.blueprint, 0)
            counts[actor.blueprint] = figures[actor.id] + 1
    return figures


def assign_figures(frame: Frame, figures: Mapping[int, int]) -> Frame:
    """Give the people and semi-trailers of a frame their numbers."""
    states = tuple(replace(state, figure=figures.get(state.actor.id, 0)) for state in frame.states)
    return replace(frame, states=states)
