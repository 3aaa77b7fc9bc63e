"""Search what only a simulation shows: the seed and the waits with which conflicts happen.

Attempts come in a fixed order, and the first that succeeds is taken, so that the same declarations
give the same specs.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from advercity_dsl import Road, RoadsideUnit, Spec, StagedConflict, Suite, Vehicle
from advercity_dsl.spec import Settlement

from advercity.compiler.scenarios import ScenarioInputs
from advercity.compiler.suite_conflicts import UnstageableError
from advercity.conflicts.checks import Finding

EGO_WAITS_S = (0.0, 4.0, 8.0)
"""Times that the ego waits longer than declared, until a conflict has room before it."""
MAX_SEEDS = 20
"""Number of seeds for which a conflict is solved; those that cannot be are not simulated."""

Judge = Callable[[Spec], str]
"""Simulates a spec and says what did not happen as declared; empty if everything did."""


@dataclass(frozen=True)
class SolvedTraffic:
    """What the scenarios that share one traffic have in common.

    Attributes:
        suite: The suite, with the traffic's seed.
        conflicts: The staged conflicts.
        road: The road with lights and waits timed for them.
        settlement: What was found by simulation; None if nothing was sought.
    """

    suite: Suite
    conflicts: tuple[StagedConflict, ...]
    road: Road
    settlement: Settlement | None = None


@dataclass(frozen=True)
class Settler:
    """Tries seeds and waits until the conflicts of a scenario happen.

    Attributes:
        judge: Simulates an attempt.
        max_attempts: Number of simulations for one traffic.
        report: Is told how each attempt went.
    """

    judge: Judge
    max_attempts: int
    report: Callable[[str], None]

    def settle(
        self,
        suite: Suite,
        inputs: ScenarioInputs,
        solve: Callable[[Suite, ScenarioInputs], SolvedTraffic],
        build: Callable[[ScenarioInputs, SolvedTraffic], Spec],
    ) -> SolvedTraffic:
        """Return the first attempt in which all conflicts happen as declared.

        Args:
            suite: The suite, with the first seed.
            inputs: A scenario of the traffic.
            solve: Solves its conflicts; raises UnstageableError.
            build: Builds the spec of an attempt.

        Raises:
            UnstageableError: They happen in none.
        """
        why = ""
        attempts = 0
        for tried in self._iterate_attempts(suite, inputs, solve):
            if isinstance(tried, UnstageableError):
                why = why or tried.finding.message
                continue
            attempts += 1
            settlement = Settlement(
                traffic=tried.suite.seeds.traffic,
                waits_s=_list_changed_waits(inputs.road, tried.road),
                attempts=attempts,
            )
            solved = replace(tried, settlement=settlement)
            why = self.judge(build(inputs, solved))
            found = f"{_name_cell(inputs)}: attempt {attempts}, {_describe(settlement)}"
            self.report(f"{found}: {why or 'happens as declared'}")
            if not why:
                return solved
            if attempts == self.max_attempts:
                break
        conflict = inputs.conflicts.conflicts[0]
        tries = f"in {attempts} simulations, in the last since " if attempts else ""
        raise UnstageableError(inputs.road, conflict, Finding(("id",), f"{tries}{why}", ""))

    def _iterate_attempts(
        self,
        suite: Suite,
        inputs: ScenarioInputs,
        solve: Callable[[Suite, ScenarioInputs], SolvedTraffic],
    ) -> Iterator[SolvedTraffic | UnstageableError]:
        """Yield attempts: as declared, then with others out of the way, from seed to seed."""
        for number in range(MAX_SEEDS):
            seed = suite.seeds.traffic + number
            seeds = suite.seeds.model_copy(update={"traffic": seed})
            seeded = suite.model_copy(update={"seeds": seeds})
            try:
                solved, waits_s = _solve_with_room(seeded, inputs, solve)
                if number == 0:
                    yield solved
                waits_s = waits_s | _let_others_wait(solved)
                yield solve(seeded, _with_waits(inputs, waits_s))
            except UnstageableError as refusal:
                yield refusal


def _solve_with_room(
    suite: Suite,
    inputs: ScenarioInputs,
    solve: Callable[[Suite, ScenarioInputs], SolvedTraffic],
) -> tuple[SolvedTraffic, dict[str, float]]:
    """Solve conflicts with an ego that waits no longer than they need to have room before it."""
    ego = next(name for name, place in inputs.road.agents.items() if place is inputs.road.ego)
    refusals: list[UnstageableError] = []
    for longer_s in EGO_WAITS_S:
        waits_s = {ego: inputs.road.ego.waits_s + longer_s} if longer_s else {}
        try:
            return solve(suite, _with_waits(inputs, waits_s)), waits_s
        except UnstageableError as refusal:
            refusals.append(refusal)
    raise refusals[0]


def _let_others_wait(solved: SolvedTraffic) -> dict[str, float]:
    """Let all others but the ego set out when it has met its last actor.

    They neither queue behind an actor that stands until then, nor have right of way over the ego.
    """
    if not solved.conflicts:
        return {}
    until_s = float(math.ceil(max(conflict.window_s[1] for conflict in solved.conflicts)))
    return {
        name: max(place.waits_s, until_s)
        for name, place in solved.road.agents.items()
        if isinstance(place, Vehicle) and not place.is_ego
    }


def _list_changed_waits(declared: Road, solved: Road) -> dict[str, float]:
    return {
        name: place.waits_s
        for name, place in solved.agents.items()
        if isinstance(place, Vehicle) and place.waits_s != _get_waits_s(declared.agents[name])
    }


def _get_waits_s(place: Vehicle | RoadsideUnit) -> float:
    return place.waits_s if isinstance(place, Vehicle) else 0.0


def _with_waits(inputs: ScenarioInputs, waits_s: Mapping[str, float]) -> ScenarioInputs:
    if not waits_s:
        return inputs
    agents = {
        name: place.model_copy(update={"waits_s": waits_s[name]}) if name in waits_s else place
        for name, place in inputs.road.agents.items()
    }
    road = inputs.road.model_copy(update={"agents": agents})
    return replace(inputs, road=road, conflicts=replace(inputs.conflicts, road=road))


def _name_cell(inputs: ScenarioInputs) -> str:
    names = ", ".join(conflict.id for conflict in inputs.conflicts.conflicts)
    return f"{inputs.road.id}: {names} ({inputs.density.id})"


def _describe(settlement: Settlement) -> str:
    waits = "".join(f", {name} waits {s:g} s" for name, s in settlement.waits_s.items())
    return f"traffic seed {settlement.traffic}{waits}"
