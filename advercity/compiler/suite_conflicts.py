"""Select, match and solve the conflicts of a suite's scenarios, with diagnostics."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from advercity_dsl import Blueprint, Conflict, Density, Road, StagedConflict, Suite
from advercity_dsl.spec import CrashGroup

from advercity.compiler.library import Library
from advercity.conflicts.binding import (
    Binding,
    is_crossing,
    match_conflict,
    with_ego_manoeuvre,
)
from advercity.conflicts.case import CALM_S, UnsolvableError
from advercity.conflicts.checks import (
    Finding,
    compute_first_event_s,
    compute_meeting_s,
    find_crowding,
    find_infeasibility,
)
from advercity.conflicts.ego_motion import build_ego_drive
from advercity.conflicts.solver import solve_conflict
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.errors import InputError
from advercity.roads.plan_frame import mirror_conflict, mirror_road, to_plan_frame

_logger = logging.getLogger(__name__)
CrashGroups = Mapping[str, tuple[CrashGroup, ...]]
EGO_WAITS_S = (0.0, 4.0, 8.0)
"""Extra waits of the ego, until a conflict has room before it."""


@dataclass(frozen=True)
class RoadConflicts:
    """A road and the conflicts of one of its scenarios."""

    road: Road
    conflicts: tuple[Conflict, ...]
    crossed: Conflict | None = None
    """The conflict crossed with roads by the suite; its id is part of the scenario's."""
    elsewhere: tuple[Road, ...] = ()
    """The road with the ego on other arms of its junction, for conflicts not possible here."""

    @property
    def places(self) -> tuple["RoadConflicts", ...]:
        """The conflicts with the ego on each arm."""
        roads = (self.road, *self.elsewhere)
        return tuple(replace(self, road=road, elsewhere=()) for road in roads)

    def change_roads(self, change: Callable[[Road], Road]) -> "RoadConflicts":
        """Return the conflicts with the road changed, on whichever arm the ego is."""
        return replace(self, road=change(self.road), elsewhere=tuple(map(change, self.elsewhere)))

    @property
    def crossed_id(self) -> str | None:
        """Id of the conflict crossed with roads by the suite."""
        return self.crossed.id if self.crossed else None


class UnstageableError(Exception):
    """A conflict cannot be staged on a road.

    Attributes:
        road: The road.
        conflict: The conflict.
        finding: Why not.
    """

    def __init__(self, road: Road, conflict: Conflict, finding: Finding) -> None:
        super().__init__(f"{road.id}: cannot stage {conflict.id}: {finding.message}")
        self.road, self.conflict, self.finding = road, conflict, finding


Turns = tuple[RoadConflicts, ...]
"""Staged conflicts of a road's scenarios in turn, from repeat to repeat."""


def select_conflicts(
    library: Library, suite: Suite, roads: Mapping[str, Road], groups: CrashGroups
) -> list[Turns]:
    """Select the conflicts of every road by its suite.

    Raises:
        DiagnosticsError: A conflict does not fit its road, or lacks a required group.
    """
    if suite.cross_conflicts:
        return [(item,) for item in _select_crossed(library, suite, roads, groups)]
    return list(_select_listed(library, suite, roads, groups))


def solve_road_conflicts(
    library: Library,
    suite: Suite,
    cell: RoadConflicts,
    density: Density,
    blueprints: Mapping[str, Blueprint],
    *,
    ego: Blueprint,
    sample_key: tuple[str, ...] = (),
) -> tuple[tuple[StagedConflict, ...], Road]:
    """Solve the conflicts of a scenario; paired weathers share them.

    The ego comes from the first arm from which they can be staged. It waits longer than declared
    where it would meet the first actor too soon.

    Returns:
        The conflicts, and the road with lights and waits timed for them.

    Raises:
        DiagnosticsError: A conflict stages crash types of several groups.
        UnstageableError: One cannot be solved on its road.
    """
    if cell.road.trajectories is not None:
        return (), cell.road
    refusals: list[UnstageableError] = []
    for place in cell.places:
        for longer_s in EGO_WAITS_S:
            waiting = place.change_roads(partial(_let_ego_wait, longer_s=longer_s))
            try:
                return _solve_place(
                    library, suite, waiting, density, blueprints, ego=ego, sample_key=sample_key
                )
            except UnstageableError as refusal:
                refusals.append(refusal)
                if not refusal.finding.comes_too_soon:
                    break
    raise refusals[0]


def _let_ego_wait(road: Road, longer_s: float) -> Road:
    name = next(name for name, place in road.agents.items() if place is road.ego)
    return with_waits(road, {name: road.ego.waits_s + longer_s}) if longer_s else road


def with_waits(road: Road, waits_s: Mapping[str, float]) -> Road:
    """Return a road with other waits of vehicles, by name."""
    agents = {
        name: place.model_copy(update={"waits_s": waits_s[name]}) if name in waits_s else place
        for name, place in road.agents.items()
    }
    return road.model_copy(update={"agents": agents})


def _solve_place(
    library: Library,
    suite: Suite,
    cell: RoadConflicts,
    density: Density,
    blueprints: Mapping[str, Blueprint],
    *,
    ego: Blueprint,
    sample_key: tuple[str, ...],
) -> tuple[tuple[StagedConflict, ...], Road]:
    solutions: list[StagedConflict] = []
    drive = build_ego_drive(to_plan_frame(cell.road), ego.actor_class)
    not_before_s = compute_first_event_s(suite.timing)
    for index, conflict in enumerate(cell.conflicts, start=1):
        if solutions and solutions[-1].resolved_by == "nobody":
            message = f"the scenario ends with the collision of '{solutions[-1].conflict}'"
            finding = Finding(("id",), message, "stage one in a scenario: `staged_at_once: 1`")
            raise UnstageableError(cell.road, conflict, finding)
        if suite.resolved_by is not None:
            conflict = conflict.model_copy(update={"resolved_by": suite.resolved_by})
        key = "/".join((cell.road.id, conflict.id, density.id, *sample_key))
        try:
            solution, limited = solve_conflict(
                conflict,
                find_typology(library, conflict),
                drive,
                blueprints,
                ego=ego,
                seed=suite.seeds.traffic,
                key=key,
                index=index,
                not_before_s=not_before_s,
                least_speed_share=density.least_speed_share,
            )
        except (UnsolvableError, InputError) as error:
            finding = Finding(("id",), str(error), "")
            raise UnstageableError(cell.road, conflict, finding) from None
        # The drive limited by earlier conflicts alone shows whether it leaves room.
        drive = limited.with_zones(*drive.zones)
        finding = find_infeasibility(conflict, drive, density, solution) or find_crowding(
            solution, solutions, suite.timing
        )
        if finding is not None:
            raise UnstageableError(cell.road, conflict, finding)
        drive = limited
        solutions.append(solution)
        not_before_s = compute_meeting_s(solution) + CALM_S
    if cell.road.is_left_hand:
        return tuple(map(mirror_conflict, solutions)), mirror_road(drive.road)
    return tuple(solutions), drive.road


def build_refusal_diagnostic(
    library: Library, suite: Suite, refusal: UnstageableError
) -> Diagnostic:
    """Build a diagnostic in the suite, or in the conflict if it is the author's."""
    conflict, finding = refusal.conflict, refusal.finding
    message = f"cannot be staged on '{refusal.road.id}': {finding.message}"
    if not library.is_shipped(conflict):
        return library.build_diagnostic(
            conflict, *finding.field, message=message, hint=finding.hint
        )
    road = library.find_declared_id(refusal.road.id)
    staged = suite.stage.get(road, ())
    if conflict.id in suite.cross_conflicts:
        at = ("cross_conflicts", suite.cross_conflicts.index(conflict.id))
    elif conflict.id in staged:
        at = ("stage", road, staged.index(conflict.id))
    else:
        at = ("cross_conflicts",)
    hint = "choose another conflict or road" if finding.field != ("id",) else finding.hint
    message = f"'{conflict.id}' {message}"
    return library.build_diagnostic(suite, *at, message=message, hint=hint)


def find_typology(library: Library, conflict: Conflict) -> str:
    """Find the typology of a conflict's crash types.

    Raises:
        DiagnosticsError: They belong to several.
    """
    groups = sorted({library.crash_types[name] for name in conflict.stages})
    if len(groups) > 1:
        message = f"belong to {' and '.join(groups)}; a conflict stages one group"
        raise DiagnosticsError(library.build_diagnostic(conflict, "stages", message=message))
    return groups[0]


def _match_conflict(
    library: Library, conflict: Conflict, road: Road, groups: CrashGroups
) -> Binding:
    called_for = _is_called_for(library, conflict, road, groups)
    return match_conflict(conflict, road, called_for=called_for)


def _is_called_for(library: Library, conflict: Conflict, road: Road, groups: CrashGroups) -> bool:
    typology = find_typology(library, conflict)
    return any(group.typology == typology for group in groups.get(road.id, ()))


def _select_listed(
    library: Library, suite: Suite, roads: Mapping[str, Road], groups: CrashGroups
) -> Iterator[Turns]:
    problems: list[Diagnostic] = []
    declared = library.get_declarations(Conflict)
    for road in roads.values():
        declared_id = library.find_declared_id(road.id)
        names = suite.stage.get(declared_id, ())
        conflicts = tuple(declared[name] for name in names)
        for index, conflict in enumerate(conflicts):
            binding = _match_conflict(library, conflict, road, groups)
            if binding.standing == "invalid" or (
                binding.standing == "variant" and "variant" not in suite.standings
            ):
                message = f"'{conflict.id}' cannot be staged on '{road.id}': {binding.reason}"
                problems.append(
                    library.build_diagnostic(suite, "stage", declared_id, index, message=message)
                )
        count = suite.staged_at_once or max(len(conflicts), 1)
        turns = [conflicts[at : at + count] for at in range(0, max(len(conflicts), 1), count)]
        staged = tuple(conflict for turn in turns[: suite.repeats] for conflict in turn)
        problems += _find_unstaged_groups(library, suite, road, staged, groups)
        for turn in turns:
            others = {item.ego.manoeuvre for item in turn[1:] if not is_crossing(item)}
            if len(manoeuvres := {item.ego.manoeuvre for item in turn[:1]} | others) > 1:
                message = f"the ego cannot go {' and '.join(sorted(manoeuvres))} in one scenario"
                problem = library.build_diagnostic(suite, "stage", declared_id, message=message)
                problems.append(problem)
        if not problems:
            yield tuple(_stage_on_road(road, turn) for turn in turns)
    if problems:
        raise DiagnosticsError(*problems)


def _stage_on_road(road: Road, conflicts: tuple[Conflict, ...]) -> RoadConflicts:
    moved = with_ego_manoeuvre(road, conflicts[0]) if conflicts else None
    return RoadConflicts(moved or road.model_copy(update={"ego_routes": {}}), conflicts)


def _find_unstaged_groups(
    library: Library, suite: Suite, road: Road, conflicts: tuple[Conflict, ...], groups: CrashGroups
) -> Iterator[Diagnostic]:
    """Find required groups not staged on their road, and staged groups not required.

    Only a suite of all roads must cover the crash groups: who lists roads lists conflicts, too. A
    group without any declared conflict cannot be staged; this is no mistake of the suite.
    """
    declared_id = library.find_declared_id(road.id)
    if suite.roads != "all" or declared_id not in suite.stage:
        return
    wanted = {group.typology for group in groups[road.id]}
    staged = {find_typology(library, conflict) for conflict in conflicts}
    stageable = {
        find_typology(library, conflict) for conflict in library.get_declarations(Conflict).values()
    }
    for name in sorted((wanted & stageable) - staged):
        message = f"'{road.id}' is selected for {name}, which none of its scenarios stages"
        hint = (
            "add one of that group's conflicts, or repeats until its turn; or list the suite's"
            " `roads` in place of `all`, to stage any conflict on them"
        )
        yield library.build_diagnostic(suite, "stage", declared_id, message=message, hint=hint)
    for name in sorted(staged - wanted):
        message = f"no selected group calls for {name} on '{road.id}'"
        hint = (
            "leave the conflict out, change the suite's selection or coverage, or list the suite's"
            " `roads` in place of `all`"
        )
        yield library.build_diagnostic(suite, "stage", declared_id, message=message, hint=hint)


def _select_crossed(
    library: Library, suite: Suite, roads: Mapping[str, Road], groups: CrashGroups
) -> list[RoadConflicts]:
    declared = library.get_declarations(Conflict)
    wanted = tuple(declared) if suite.cross_conflicts == "all" else suite.cross_conflicts
    found: list[RoadConflicts] = []
    misfits: list[str] = []
    for road in roads.values():
        for conflict in map(declared.__getitem__, wanted):
            called_for = _is_called_for(library, conflict, road, groups)
            places = (road, *library.find_entry(road).elsewhere)
            cell = bind_crossed(conflict, places, suite.standings, called_for=called_for)
            if cell is not None:
                found.append(cell)
            else:
                binding = match_conflict(conflict, road, called_for=called_for)
                misfits.append(f"{road.id}: cannot stage {conflict.id}: {_explain(binding)}")
    if not found:
        raise DiagnosticsError(*_describe_misfits(library, suite, roads, groups, wanted))
    # `all` selects the conflicts that fit.
    for line in misfits if suite.cross_conflicts != "all" else ():
        _logger.warning("%s", line)
    return found


def bind_crossed(
    conflict: Conflict, places: Iterable[Road], standings: Sequence[str], *, called_for: bool
) -> RoadConflicts | None:
    """Bind a conflict to a road whose ego may be at several places; None if it fits at none."""
    fitting = (
        road
        for road in places
        if match_conflict(conflict, road, called_for=called_for).standing in standings
    )
    moved = (with_ego_manoeuvre(road, conflict) for road in fitting)
    roads = [road for road in moved if road is not None]
    if not roads:
        return None
    return RoadConflicts(roads[0], (conflict,), crossed=conflict, elsewhere=tuple(roads[1:]))


def _explain(binding: Binding) -> str:
    standing = f"it is of standing '{binding.standing}', which `standings` does not select"
    return binding.reason or standing


def _describe_misfits(
    library: Library,
    suite: Suite,
    roads: Mapping[str, Road],
    groups: CrashGroups,
    wanted: Iterable[str],
) -> Iterator[Diagnostic]:
    """Describe why each crossed conflict fits no road, and which road would fit."""

    def match(name: str, road: Road) -> Binding:
        return _match_conflict(library, declared[name], road, groups)

    declared = library.get_declarations(Conflict)
    fitting = [
        name
        for name in sorted(declared)
        if any(match(name, road).standing in suite.standings for road in roads.values())
    ]
    hint = f"these fit: {', '.join(fitting)}" if fitting else "select other roads"
    for index, name in enumerate(wanted):
        bindings = {road_id: match(name, road) for road_id, road in roads.items()}
        reasons = {road_id: _explain(binding) for road_id, binding in bindings.items()}
        why = "; ".join(
            f"{reason} ({', '.join(key for key, other in reasons.items() if other == reason)})"
            for reason in dict.fromkeys(reasons.values())
        )
        at = (index,) if suite.cross_conflicts != "all" else ()
        message = f"'{name}' has a place on no road of the suite: {why}"
        yield library.build_diagnostic(suite, "cross_conflicts", *at, message=message, hint=hint)
