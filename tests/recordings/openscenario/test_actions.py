"""Entities are put, added and taken away; what would be a jump of a recorded actor is refused."""

from pathlib import Path

import pytest

from advercity.diagnostics import DiagnosticsError
from tests.recordings.openscenario.scenarios import (
    EGO_AT_20,
    at,
    begin,
    event,
    find_rear_axle,
    maneuver,
    play,
    world,
)


def teleport(x: float) -> str:
    return f"<TeleportAction><Position>{world(x, -1.75, 0)}</Position></TeleportAction>"


def test_a_jump_is_refused_where_it_is_written(tmp_path: Path) -> None:
    group = maneuver("Ego", event(teleport(90), at(4)))
    with pytest.raises(DiagnosticsError) as caught:
        play(tmp_path, group, init=begin("Ego", EGO_AT_20, 10))
    (diagnostic,) = caught.value.diagnostics

    assert "<TeleportAction>: 'Ego' jumps 30.0 m at 4 s" in diagnostic.headline
    assert (
        "<TeleportAction>"
        in (tmp_path / "crash.xosc").read_text().splitlines()[diagnostic.line - 1]
    )


def test_a_teleport_to_where_an_actor_is_moves_it_by_no_more(tmp_path: Path) -> None:
    group = maneuver("Ego", event(teleport(60.5), at(4)))
    ego = play(tmp_path, group, init=begin("Ego", EGO_AT_20, 10))["Ego"]

    assert find_rear_axle(ego, 3.9, 5.0)[:, 0] == pytest.approx([59, 70.5], abs=0.1)


def test_one_that_was_deleted_does_not_come_back_as_the_same_actor(tmp_path: Path) -> None:
    add = f"<AddEntityAction><Position>{world(90, 0, 0)}</Position></AddEntityAction>"
    groups = [
        maneuver("Ego", event("", at(time_s))).replace(
            "<PrivateAction>\n      </PrivateAction>",
            f'<GlobalAction><EntityAction entityRef="Ego">{action}</EntityAction></GlobalAction>',
        )
        for time_s, action in ((3, "<DeleteEntityAction/>"), (5, add))
    ]
    with pytest.raises(DiagnosticsError, match="'Ego' comes back at 5 s; an actor is there once"):
        play(tmp_path, *groups, init=begin("Ego", EGO_AT_20, 10))
    ego = play(tmp_path, groups[0], init=begin("Ego", EGO_AT_20, 10))["Ego"]
    assert ego.times_s[-1] == 3.0
