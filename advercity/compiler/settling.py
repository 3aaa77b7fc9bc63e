"""Search by simulation for the seed and the waits with which conflicts happen.

Attempts come in a fixed order and the first success counts: specs are reproducible.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

from advercity_dsl import Road, RoadsideUnit, Spec, StagedConflict, Suite, Vehicle
from advercity_dsl.spec import Settlement

from advercity.compiler.scenarios import ScenarioInputs
from advercity.compiler.suite_conflicts import RoadConflicts, UnstageableError, with_waits
from advercity.conflicts.checks import Finding

MAX_SEEDS = 20
"""Number of seeds tried for a conflict; seeds without a solution are not simulated."""

Judge = Callable[[Spec], str]
"""Simulates a spec and describes any event that did not happen as declared; else empty."""


@dataclass(frozen=True)
class SolvedTraffic:
    """Common parts of the scenarios with the same traffic.

    Attributes:
        suite: The suite, with the traffic's seed.
        conflicts: The staged conflicts.
        road: The road with lights and waits timed for them.
        settlement: Seed and waits found by simulation; None without a search.
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
            arm = _describe_start(inputs.road.ego, tried.road.ego)
            found = f"{_name_cell(inputs)}: attempt {attempts}, {_describe(settlement)}{arm}"
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
        """Yield attempts: as declared, then with others out of the way, by seed and ego's arm."""
        for number, place in product(range(MAX_SEEDS), inputs.conflicts.places):
            seed = suite.seeds.traffic + number
            seeds = suite.seeds.model_copy(update={"traffic": seed})
            seeded = suite.model_copy(update={"seeds": seeds})
            try:
                solved = solve(seeded, _at_place(inputs, place))
                if number == 0 and place.road is inputs.road:
                    yield solved
                waits_s = _let_others_wait(solved)
                waiting = place.change_roads(partial(with_waits, waits_s=waits_s))
                yield solve(seeded, _at_place(inputs, waiting))
            except UnstageableError as refusal:
                yield refusal


def _at_place(inputs: ScenarioInputs, place: RoadConflicts) -> ScenarioInputs:
    return replace(inputs, road=place.road, conflicts=place)


def _let_others_wait(solved: SolvedTraffic) -> dict[str, float]:
    """Make all others wait until the ego has met its last actor.

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


def _name_cell(inputs: ScenarioInputs) -> str:
    names = ", ".join(conflict.id for conflict in inputs.conflicts.conflicts)
    return f"{inputs.road.id}: {names} ({inputs.density.id})"


def _describe_start(declared: Vehicle, solved: Vehicle) -> str:
    same = declared.spawn_m == solved.spawn_m
    return "" if same else f", ego from {solved.route[0]}"


def _describe(settlement: Settlement) -> str:
    waits = "".join(f", {name} waits {s:g} s" for name, s in settlement.waits_s.items())
    return f"traffic seed {settlement.traffic}{waits}"
