"""Chooses the sensors and agents whose data a run makes."""

from collections.abc import Collection, Sequence
from typing import Any

from advercity_dsl import Agent, Spec, Unrecorded
from advercity_dsl.base import suggest_name
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.compiler.assembly import is_edited, with_digest
from advercity.errors import InputError
from advercity.run_options import DatasetOptions

EGO = "ego"
"""Name of the ego in `agents`, whatever its id."""


def choose_sensors(spec: Spec, options: DatasetOptions) -> Spec:
    """Leave out of a spec the sensors and agents that the options do not name.

    Agents left out still drive, and their radars disturb others. The spec records what is left
    out, and counts as edited only if it did before.

    Raises:
        InputError: A name is unknown, the ego is left out, or the options need a part that is.
    """
    agents = _choose_agents(spec, options.agents) if options.agents else spec.recorded_agents
    _check_min_points(spec, agents, options)
    present = [
        kind.name
        for kind in load_sensor_kinds().found.values()
        if kind.has_place and any(agent.sensors.list_sensors(kind.name) for agent in agents)
    ]
    for name in options.sensors:
        if name not in present:
            found = ", ".join(present) or "none"
            raise InputError(f"`sensors` {name}: the chosen agents of {spec.id} have {found}")
    kinds = {kind for kind in present if options.sensors and kind not in options.sensors}
    before, chosen = spec.unrecorded or Unrecorded(), {agent.id for agent in agents}
    unrecorded = Unrecorded(
        sensors=tuple(sorted(kinds.union(before.sensors))),
        agents=tuple(agent.id for agent in spec.agents if agent.id not in chosen),
    )
    if unrecorded == before:
        return spec
    left = tuple(_remove_sensors(agent, kinds) for agent in spec.agents)
    found = spec.model_copy(update={"agents": left, "unrecorded": unrecorded})
    return found if is_edited(spec) else with_digest(found)


def _choose_agents(spec: Spec, names: Sequence[str]) -> tuple[Agent, ...]:
    known = {agent.id: agent for agent in spec.recorded_agents}
    known = {EGO: spec.ego, **known}
    for name in names:
        if name not in known:
            hint = suggest_name(name, known)
            raise InputError(f"`agents` {name}: {spec.id} has no such agent; {hint}")
    chosen = {known[name].id for name in names}
    if spec.ego.id not in chosen:
        raise InputError(
            f"`agents` {','.join(names)}: readers of datasets need the ego; add '{EGO}'"
        )
    if spec.channel is not None and len(chosen) < len(spec.agents):
        raise InputError(
            f"`agents` {','.join(names)}: all agents of {spec.id} send messages over its V2X"
            " channel; leave `agents` out, or compile a suite without `channel`"
        )
    return tuple(agent for agent in spec.agents if agent.id in chosen)


def _check_min_points(spec: Spec, agents: Sequence[Agent], options: DatasetOptions) -> None:
    is_left_out = options.sensors and "lidar" not in options.sensors
    for agent in agents if options.min_points else ():
        if is_left_out or not agent.sensors.lidars:
            raise InputError(
                f"`min_points` {options.min_points}: {agent.id} of {spec.id} has no LiDAR"
            )


def _remove_sensors(agent: Agent, kinds: Collection[str]) -> Agent:
    fields = type(agent.sensors).model_fields
    gone: dict[str, Any] = dict.fromkeys(kinds)
    gone |= {f"more_{kind}s": {} for kind in kinds if f"more_{kind}s" in fields}
    return agent.model_copy(update={"sensors": agent.sensors.model_copy(update=gone)})
