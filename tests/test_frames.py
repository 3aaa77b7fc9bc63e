"""The record of traffic: kept, stored, asked for plans, and lit."""

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from advercity.errors import RunError
from advercity.frames import STATE_DTYPE, Actor, Lamp, Signal, Trace, extract_planned_trajectory
from advercity.geometry.poses import rotation_matrix

CAR = Actor(101, "car", "sedan", "car_paint_blue", (4.5, 1.8, 1.5))
WALKER = Actor(5001, "pedestrian", "adult", "cloth_dark", (0.4, 0.4, 1.8))
BICYCLE = Actor(1001, "bicycle", "roadster", "car_paint_red", (1.8, 0.6, 1.7))


def row(
    tick: int,
    actor: int,
    x: float,
    speed: float = 10.0,
    lamps: int = 0,
    roll: tuple[float, float] = (0.0, 0.0),
):
    pose = x, 2.0, 0.5, np.pi / 2, 0.1, roll[0]
    motion = 0.0, speed, 0.0, 0.3, 0.6, 0.9, 0.2, 0.4, roll[1], speed, 0.0
    return (tick, actor, *pose, *motion, 0.05, 12.0, lamps)


def trace_of(*rows: tuple[object, ...], ticks: int = 3) -> Trace:
    return Trace(
        tick_s=0.1,
        first_tick=60,
        actors=(CAR, WALKER, BICYCLE),
        states=np.array(list(rows), dtype=STATE_DTYPE),
        signal_ids=("junction/north", "junction/south"),
        signals=np.array([[0, 2]] * ticks, dtype=np.uint8),
    )


def test_a_frame_holds_who_is_there_and_what_the_lights_show():
    trace = trace_of(row(0, 0, 1.0), row(1, 0, 2.0), row(1, 1, 9.0), row(2, 0, 3.0))

    frame = trace.build_frame(1)

    assert [state.actor.id for state in frame.states] == [101, 5001]
    assert frame.signals == {"junction/north": Signal.RED, "junction/south": Signal.GREEN}
    assert frame.time_s == pytest.approx(6.1)


def test_a_state_is_posed_nose_down_for_positive_pitch():
    pose = trace_of(row(0, 0, 7.0)).build_frame(0).get_state(101).world_from_body

    np.testing.assert_allclose(pose[:3, 3], [7.0, 2.0, 0.5])
    np.testing.assert_allclose(pose[:3, 0], [0, np.cos(0.1), -np.sin(0.1)], atol=1e-12)


@pytest.mark.parametrize("roll", [(0.08, 0.05), (-0.12, 0.0), (0.0, -0.3)])
def test_a_rolled_state_turns_as_its_angles_change(roll: tuple[float, float], tmp_path: Path):
    trace = trace_of(row(0, 0, 7.0, roll=roll))
    trace.save(tmp_path / "trace.npz")
    state = Trace.load(tmp_path / "trace.npz").build_frame(0).get_state(101)

    later = state.advance(0.001).world_from_body
    angles = {"yaw": np.pi / 2 + 0.0002, "pitch": 0.1004, "roll": roll[0] + 0.001 * roll[1]}

    # A positive roll lifts the left side.
    assert np.sign(state.world_from_body[2, 1]) == np.sign(roll[0])
    np.testing.assert_allclose(later[:3, :3], rotation_matrix(**angles), atol=1e-6)


def test_upright_traces_have_the_columns_of_earlier_versions(tmp_path: Path):
    trace_of(row(0, 0, 7.0)).save(tmp_path / "trace.npz")

    with np.load(tmp_path / "trace.npz") as stored:
        assert not {"state_roll", "state_roll_rate"} & {*stored}


def test_a_state_has_the_derivatives_of_its_pose():
    motion = trace_of(row(0, 0, 7.0)).build_frame(0).get_state(101).motion

    np.testing.assert_allclose(motion.velocity, [0.0, 10.0, 0.0])
    np.testing.assert_allclose(motion.acceleration, [0.3, 0.6, 0.9])
    # Nose down by 0.1, a left turn about the vertical rolls the body, too.
    expected = [-0.2 * np.sin(0.1), 0.4, 0.2 * np.cos(0.1)]
    np.testing.assert_allclose(motion.angular_rate, expected)


def test_asking_for_what_is_not_there_is_an_error():
    trace = trace_of(row(0, 0, 1.0))

    with pytest.raises(IndexError):
        trace.build_frame(3)
    with pytest.raises(KeyError):
        trace.build_frame(0).get_state(5001)


def test_a_trace_comes_back_from_its_file_and_has_the_same_bytes_again(tmp_path: Path):
    trace = trace_of(row(0, 0, 1.0, lamps=Lamp.BRAKE), row(1, 1, 2.0))
    trace.save(tmp_path / "first.npz")

    again = Trace.load(tmp_path / "first.npz")
    again.save(tmp_path / "second.npz")

    assert again.actors == trace.actors
    assert again.signal_ids == trace.signal_ids
    assert (again.tick_s, again.first_tick) == (0.1, 60)
    np.testing.assert_array_equal(again.states, trace.states)
    np.testing.assert_array_equal(again.signals, trace.signals)
    assert (tmp_path / "first.npz").read_bytes() == (tmp_path / "second.npz").read_bytes()


def test_the_hash_of_a_trace_is_that_of_what_it_holds_however_its_file_is_packed(tmp_path: Path):
    trace = trace_of(row(0, 0, 1.0, lamps=Lamp.BRAKE), row(1, 1, 2.0))
    trace.save(tmp_path / "small.npz")
    with np.load(tmp_path / "small.npz") as packed:
        np.savez(tmp_path / "large.npz", allow_pickle=False, **packed)

    small, large = (Trace.load(tmp_path / f"{name}.npz") for name in ("small", "large"))

    assert (tmp_path / "small.npz").read_bytes() != (tmp_path / "large.npz").read_bytes()
    assert small.compute_sha256() == large.compute_sha256() == trace.compute_sha256()
    assert trace_of(row(0, 0, 1.0), row(1, 1, 2.0)).compute_sha256() != trace.compute_sha256()


def test_a_file_that_is_no_trace_says_so(tmp_path: Path):
    (tmp_path / "trace.npz").write_text("hello")

    with pytest.raises(RunError, match=r"trace\.npz: not a"):
        Trace.load(tmp_path / "trace.npz")


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a trace's file."""
    path = tmp_path_factory.mktemp("trace") / "trace.npz"
    trace_of(*(row(tick, actor, tick) for tick in range(3) for actor in range(3))).save(path)
    return path.read_bytes()


def test_a_trace_cut_off_anywhere_is_refused(saved: bytes, tmp_path: Path):
    path = tmp_path / "trace.npz"
    for length in range(0, len(saved), max(1, len(saved) // 50)):
        path.write_bytes(saved[:length])
        with pytest.raises(RunError, match=r"trace\.npz: "):
            Trace.load(path)


def test_a_trace_with_changed_bytes_is_refused_or_a_trace(saved: bytes, tmp_path: Path):
    path = tmp_path / "trace.npz"
    draw = np.random.default_rng(1)
    refused = 0
    for _ in range(400):
        changed = bytearray(saved)
        for place in draw.integers(0, len(saved), draw.integers(1, 6)):
            changed[place] ^= 1 << draw.integers(8)
        path.write_bytes(changed)
        try:
            trace = Trace.load(path)
        except RunError as error:
            assert len(str(error).splitlines()) == 1
            refused += 1
        else:
            assert [trace.build_frame(index) for index in range(len(trace))]
    assert refused > 300


def changed_columns() -> dict[str, dict[str, object]]:
    """Columns that no simulation writes, by what is wrong."""
    return {
        "no number": {"state_x": np.full(2, np.nan)},
        "infinite": {"actor_size": np.full((3, 3), np.inf)},
        "huge": {"state_yaw": np.full(2, 1e308)},
        "text for numbers": {"state_x": np.array(["1", "2"])},
        "other width": {"state_tick": np.array([2**32, 2**32 + 1])},
        "other length": {"state_x": np.zeros(3)},
        "other shape": {"signals": np.zeros(3, np.uint8)},
        "pickles": {"signal_ids": np.array([{}, []], object)},
        "unknown actor": {"state_actor": np.array([0, 3], np.int32)},
        "unknown class": {"actor_actor_class": np.array(["car", "dragon", "car"])},
        "equal ids": {"actor_id": np.array([101, 101, 102])},
        "unsorted": {"state_tick": np.array([1, 0], np.int32)},
        "tick beyond the end": {"state_tick": np.array([0, 3], np.int32)},
        "negative tick": {"state_tick": np.array([-1, 0], np.int32)},
        "unknown signal": {"signals": np.full((3, 2), 7, np.uint8)},
        "signals without ids": {"signals": np.zeros((3, 5), np.uint8)},
        "no time": {"tick_s": np.array(0.0)},
        "flat actors": {"actor_size": np.zeros((3, 3))},
    }


@pytest.mark.parametrize("wrong", changed_columns())
def test_columns_that_no_simulation_writes_are_refused(wrong: str, tmp_path: Path):
    path = tmp_path / "trace.npz"
    trace_of(row(0, 0, 1.0), row(1, 0, 2.0)).save(path)
    with np.load(path) as stored:
        columns = {**stored}
    np.savez(path, **(columns | changed_columns()[wrong]))  # pyright: ignore[reportArgumentType]
    with pytest.raises(RunError, match=r"trace\.npz: not a"):
        Trace.load(path)


def test_files_that_unpack_without_end_are_refused_at_once(tmp_path: Path):
    bomb, header = tmp_path / "bomb.npz", tmp_path / "header.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(11):
            archive.writestr(f"{number}.npy", bytes(10**8))
    with zipfile.ZipFile(header, "w") as archive, archive.open("state_x.npy", "w") as member:
        np.lib.format.write_array_header_1_0(
            member, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
        )
    with pytest.raises(RunError, match="unpacks to more than 1 GB"):
        Trace.load(bomb)
    with pytest.raises(RunError, match="another size than its header says"):
        Trace.load(header)


def test_what_is_no_regular_file_is_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", tmp_path / "missing", Path("/dev/zero")):
        with pytest.raises(RunError, match=str(path)):
            Trace.load(path)


def test_a_plan_is_what_the_trace_will_do_and_goes_straight_on_after_its_end():
    trace = trace_of(*(row(tick, 0, float(tick), speed=5.0 + tick) for tick in range(3)))

    plan = extract_planned_trajectory(trace, 101, 0, point_count=2, step_s=0.15)

    # At 0.15 s between ticks 1 and 2; at 0.3 s 0.1 s past the end, heading north at 7 m/s.
    np.testing.assert_allclose(plan, [[1.5, 2.0, 6.5], [2.0, 2.7, 7.0]])


def test_a_plan_starts_at_the_tick_that_is_asked_for():
    trace = trace_of(*(row(tick, 0, float(tick)) for tick in range(3)))

    np.testing.assert_allclose(
        extract_planned_trajectory(trace, 101, 1, point_count=1, step_s=0.1)[0, 0], 2.0
    )
    assert extract_planned_trajectory(trace, 101, 1).shape == (9, 3)
    with pytest.raises(KeyError):
        extract_planned_trajectory(trace, 5001, 0)
