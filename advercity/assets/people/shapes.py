"""Shapes the base mesh to a person: by sex, age, weight, muscles and ancestry.

The shape is a sum of targets, each weighted by the product of the fractions in its name, as
MakeHuman's own macro targets are combined.
"""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np
from advercity_dsl.catalogue import PersonShape

from advercity.assets.people.base_mesh import BaseMesh
from advercity.geometry.arrays import Float64Array

_AGES = {"baby": 1.0, "child": 11.0, "young": 25.0, "old": 85.0}
"""Years of full weight of each age of the targets."""
_MUSCLES = {"minmuscle": 0.0, "averagemuscle": 0.5, "maxmuscle": 1.0}
_WEIGHTS = {"minweight": 0.0, "averageweight": 0.5, "maxweight": 1.0}
_ANCESTRIES = {"african": "african", "asian": "asian", "european": "caucasian"}
"""Names in the targets' files."""


def list_target_names() -> list[str]:
    """List all possible targets of people."""
    ancestral = product(_ANCESTRIES.values(), ("female", "male"), _AGES)
    built = product(("female", "male"), _AGES, _MUSCLES, _WEIGHTS)
    return ["-".join(parts) for parts in ancestral] + [
        "-".join(("universal", *parts)) for parts in built
    ]


def shape_person(base: BaseMesh, person: PersonShape) -> Float64Array:
    """Compute the vertices (n, 3) of the base mesh in a person's shape, in metres."""
    vertices = base.vertices.copy()
    for name, fraction in _iterate_targets(person):
        rows, shifts = base.load_target(name)
        vertices[rows] += fraction * shifts
    return vertices


def _iterate_targets(person: PersonShape) -> Iterator[tuple[str, float]]:
    ages = _interpolate(_AGES, person.age_years)
    muscles, weights = _interpolate(_MUSCLES, person.muscle), _interpolate(_WEIGHTS, person.weight)
    for age, of_age in ages.items():
        yield f"{_ANCESTRIES[person.ancestry]}-{person.sex}-{age}", of_age
        for (muscle, of_muscle), (weight, of_weight) in product(muscles.items(), weights.items()):
            name = f"universal-{person.sex}-{age}-{muscle}-{weight}"
            yield name, of_age * of_muscle * of_weight


def _interpolate(anchors: Mapping[str, float], value: float) -> dict[str, float]:
    """Interpolate between named anchors; fractions of 0 are left out."""
    names, places = list(anchors), np.array(list(anchors.values()))
    after = int(np.clip(np.searchsorted(places, value), 1, len(places) - 1))
    low, high = places[after - 1], places[after]
    fraction = float(np.clip((value - low) / (high - low), 0.0, 1.0))
    found = {names[after - 1]: 1.0 - fraction, names[after]: fraction}
    return {name: part for name, part in found.items() if part > 0.0}
