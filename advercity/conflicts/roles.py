"""Which actors take part in which staged conflict, and in which role.

The dataset reader imports this module, so it imports neither numpy nor shapely.
"""

from collections.abc import Mapping
from typing import Literal

from advercity_dsl import Spec

ConflictRole = Literal["subject", "other", "bystander"]
"""The subject's action is the critical one; a bystander hides the actor, or is overtaken by it."""
ConflictRoles = Mapping[int, Mapping[str, ConflictRole]]
"""Roles by id of the actor, then by id of the conflict."""


def find_conflict_roles(spec: Spec) -> ConflictRoles:
    """Find the roles of all participants of a spec's conflicts, the ego among them."""
    roles: dict[int, dict[str, ConflictRole]] = {}
    for conflict in spec.conflicts:
        roles.setdefault(spec.ego.number, {})[conflict.id] = conflict.ego
        for actor in conflict.actors:
            roles.setdefault(actor.number, {})[conflict.id] = actor.part
    return roles
