"""The search for traffic in which conflicts happen; what a simulation says is given here."""

from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec, Vehicle

from advercity.compiler.assembly import is_edited
from advercity.compiler.crossing import compile_library
from advercity.compiler.settling import Settler
from advercity.errors import InputError
from tests.compiler.test_refusals import write_suite


def settle(
    library: Path, folder: Path, judge: Callable[[Spec], str], attempts: int = 5
) -> tuple[list[Spec], list[str]]:
    lines: list[str] = []
    settler = Settler(judge, attempts, lines.append)
    return compile_library(library, folder, suite="mine", settler=settler), lines


def get_waits_s(spec: Spec) -> dict[str, float]:
    places = {agent.id: agent.place for agent in spec.agents}
    return {name: place.waits_s for name, place in places.items() if isinstance(place, Vehicle)}


def test_traffic_that_happens_as_declared_is_kept(library: Path, tmp_path: Path) -> None:
    write_suite(tmp_path)
    (plain,) = compile_library(library, tmp_path, suite="mine")

    (spec,), lines = settle(library, tmp_path, lambda _: "")

    assert (spec.seeds, spec.agents, spec.road) == (plain.seeds, plain.agents, plain.road)
    settled = spec.provenance.settled
    assert settled is not None
    # The solver shortens the wait that the road declares for its ego.
    assert (settled.traffic, settled.waits_s, settled.attempts) == (1, {spec.ego.id: 0}, 1)
    (line,) = lines
    assert line.startswith("ui: ltap_od_ego_turns (sparse): attempt 1, traffic seed 1")
    assert line.endswith(": happens as declared")
    assert not is_edited(spec)


def test_others_get_out_of_the_way_and_then_other_seeds_are_tried(
    library: Path, tmp_path: Path
) -> None:
    """The third attempt is the second seed, with all but the ego waiting for its conflict."""
    write_suite(tmp_path)
    tried: list[Spec] = []

    def judge(spec: Spec) -> str:
        tried.append(spec)
        return "" if len(tried) == 3 else "cav2 is in the way"

    (spec,), lines = settle(library, tmp_path, judge)

    settled = spec.provenance.settled
    assert settled is not None
    assert (settled.traffic, settled.attempts) == (2, 3)
    (conflict,) = spec.conflicts
    waits_s = get_waits_s(spec)
    ego = spec.ego.id
    others = set(waits_s) - {ego}
    assert len(others) == 2
    for name in others:
        assert conflict.window_s[1] - 1 <= waits_s[name] == settled.waits_s[name]
    assert len({item.seeds.traffic for item in tried}) == 2
    assert [line.endswith("cav2 is in the way") for line in lines] == [True, True, False]


def test_the_same_declarations_settle_to_the_same_spec(library: Path, tmp_path: Path) -> None:
    write_suite(tmp_path)

    def compile_once() -> Spec:
        answers = iter(["late", "blocked", "late", ""])
        (spec,), _ = settle(library, tmp_path, lambda _: next(answers))
        return spec

    assert compile_once() == compile_once()


def test_one_traffic_is_simulated_once_for_all_its_weathers(library: Path, tmp_path: Path) -> None:
    write_suite(tmp_path, weathers=["fog_day", "clear_day", "hard_rain_night"][:2])

    specs, lines = settle(library, tmp_path, lambda _: "")

    assert len(specs) == 2
    assert len(lines) == 1


def test_a_road_on_which_nothing_helps_is_one_line(
    library: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_suite(tmp_path, roads=["ui", "ri"])

    def judge(spec: Spec) -> str:
        return "the ego is late" if spec.road.id == "ui" else ""

    specs, lines = settle(library, tmp_path, judge, attempts=4)

    assert [spec.road.id for spec in specs] == ["ri"]
    assert len(lines) == 4 + 1
    assert caplog.messages == [
        "ui: cannot stage ltap_od_ego_turns: in 4 simulations, in the last since the ego is late"
    ]
    with pytest.raises(InputError, match="in 2 simulations, in the last since late"):
        settle(library, tmp_path, lambda _: "late", attempts=2)


def test_an_ego_that_is_too_early_for_its_conflict_waits(library: Path, tmp_path: Path) -> None:
    """A recording that begins 8 s later than usual is too late without a wait."""
    write_suite(tmp_path, timing={"warm_up_ticks": 139})

    (plain,) = compile_library(library, tmp_path, suite="mine")
    (spec,), _ = settle(library, tmp_path, lambda _: "")

    ego, settled = spec.ego.id, spec.provenance.settled
    assert settled is not None
    assert 0 < get_waits_s(spec)[ego] == settled.waits_s[ego] <= 8
    assert get_waits_s(plain)[ego] == settled.waits_s[ego]
    write_suite(tmp_path, timing={"warm_up_ticks": 300})
    with pytest.raises(InputError, match="after the recording begins"):
        compile_library(library, tmp_path, suite="mine")
