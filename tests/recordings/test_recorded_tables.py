"""Tables in published layouts become the same tracks, and what cannot be used is said by place."""

import math
from pathlib import Path

import numpy as np
import pytest

from advercity.diagnostics import DiagnosticsError
from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.recordings.recorded_tables import LAYOUTS, Layout, read_recording
from advercity.recordings.track_file import format_tracks
from advercity.recordings.tracks import Track, derive_headings
from tests.recordings.recorded_files import write_highd, write_ind, write_interaction

ROW = "7,1,{frame},0,{x},-1.75,0,1.8,4.6,0,0,0,0,0,0,0,0\n"
TABLE = "id,class,time_s,x_m,y_m\na,car,0,0,0\na,car,0.1,1,0\n"


def test_a_recording_of_ind_has_centres_headings_sizes_and_classes(tmp_path: Path) -> None:
    tracks = {track.id: track for track in read_recording(write_ind(tmp_path))}

    car = tracks["1"]
    assert (car.actor_class, car.size) == ("car", (4.6, 1.8, 0.0))
    assert car.times_s[50] == 2.0
    assert car.places[50] == pytest.approx([50 + 10 * 2 + 0.5 * 2**2, -1.75])
    assert tracks["2"].headings_rad == pytest.approx(math.pi)
    assert (tracks["3"].actor_class, tracks["3"].size[:2]) == ("truck", (9.0, 2.5))
    assert (tracks["4"].actor_class, tracks["4"].size) == ("pedestrian", (0.0, 0.0, 0.0))


def test_a_recording_of_interaction_has_people_from_their_own_file(tmp_path: Path) -> None:
    tracks = {track.id: track for track in read_recording(write_interaction(tmp_path))}

    assert {*tracks} == {"1", "2", "3", "P4"}
    assert tracks["1"].places[10] == pytest.approx([72.0, -1.75])
    assert tracks["1"].times_s[10] == 2.0
    assert tracks["2"].headings_rad == pytest.approx(math.pi)
    person = tracks["P4"]
    assert person.actor_class == "pedestrian"
    assert person.headings_rad == pytest.approx(math.pi / 2)  # it walks to the north
    assert person.places[-1] == pytest.approx([100.0, -3.0])


def test_one_that_interaction_does_not_tell_apart_rides_if_it_is_fast(tmp_path: Path) -> None:
    path = write_interaction(tmp_path)
    people = tmp_path / "pedestrian_tracks_000.csv"
    rows = [
        f"P9,{number + 1},{number * 100},pedestrian/bicycle,{0.4 * number},0,4,0\n"
        for number in range(5)
    ]
    people.write_text(people.read_text() + "".join(rows))

    classes = {track.id: track.actor_class for track in read_recording(path)}

    assert (classes["P4"], classes["P9"]) == ("pedestrian", "bicycle")


def test_a_recording_of_highd_has_corners_of_boxes_and_y_down(tmp_path: Path) -> None:
    ledger = Ledger()
    tracks = {track.id: track for track in read_recording(write_highd(tmp_path), ledger)}

    car = tracks["1"]
    assert (car.actor_class, car.size) == ("car", (4.6, 1.8, 0.0))
    assert car.times_s[50] == 2.0
    assert car.places[50] == pytest.approx([50 + 10 * 2 + 0.5 * 2**2, -1.75])
    assert car.headings_rad == pytest.approx(0.0)
    assert tracks["2"].headings_rad == pytest.approx(math.pi)
    # One that stands all the time looks where its lanes lead.
    assert tracks["3"].places[0] == pytest.approx([120.0, -1.75])
    assert (tracks["3"].actor_class, tracks["3"].size[:2]) == ("truck", (9.0, 2.5))
    assert tracks["3"].headings_rad == pytest.approx(math.pi)
    assert {(part.name, part.count) for part in ledger.left_out} == {
        ("columns of velocity", 2),
        ("column of lanes", 1),
        ("column weather", 1),
    }


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_every_column_that_is_read_is_in_the_table_of_columns(layout: Layout) -> None:
    row = load_standard("recorded_tables").elements[layout.name]
    assert {name for name in layout.columns if row[name] != "read"} == set()
    assert layout.marks <= {*row}


def test_what_is_written_is_read_again_as_it_was(tmp_path: Path) -> None:
    tracks = read_recording(write_ind(tmp_path))
    (tmp_path / "own.csv").write_text(format_tracks(tracks))

    again = read_recording(tmp_path / "own.csv")

    assert [track.id for track in again] == [track.id for track in tracks]
    for before, after in zip(tracks, again, strict=True):
        assert (after.actor_class, after.size) == (before.actor_class, before.size)
        assert after.times_s == pytest.approx(before.times_s, abs=1e-6)
        assert after.places == pytest.approx(before.places, abs=1e-6)
        assert after.headings_rad == pytest.approx(before.headings_rad, abs=1e-7)


def test_parquet_and_a_semicolon_between_values_make_no_difference(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    times = np.arange(20) / 10
    columns = {"id": ["a"] * 20, "class": ["car"] * 20, "time_s": times, "x_m": 9 * times}
    columns |= {"y_m": np.zeros(20), "heading_deg": np.zeros(20)}
    parquet.write_table(arrow.table(columns), tmp_path / "a.parquet")
    rows = [";".join(columns), *(f"a;car;{t};{9 * t};0;0" for t in times.tolist())]
    (tmp_path / "a.csv").write_text("\n".join(rows))

    (packed,) = read_recording(tmp_path / "a.parquet")
    (plain,) = read_recording(tmp_path / "a.csv")

    assert (packed.places == plain.places).all()
    assert (packed.times_s == plain.times_s).all()


@pytest.mark.parametrize(
    ("content", "expected"),
    {
        "id,class,time_s,x_m,y_m\na,car,0,0,0\na,car,0.1,fast,0\n": (
            "{path}:3:11: x_m: 'fast' is not a number"
        ),
        "id,class,time_s,x_m,y_m\na,car,0,0,0\na,car,0.1,,0\n": "{path}:3:11: x_m: a blank is not",
        "id,class,time_s,x_m,y_m\na,car,0,0,0\na,car,0.1,nan,0\n": "{path}:3:11: x_m: 'nan' is not",
        "id,class,time_s,x_m,y_m\na,tram,0,0,0\na,tram,0.1,1,0\n": (
            "{path}:2:3: class: 'tram' is no class of road users; "
        ),
        "id,class,time_s,x_m,y_m\ncar 7,car,0,0,0\n": (
            "{path}:2:1: id: 'car 7' is no id of a track; use up to 64 letters"
        ),
        TABLE + "a,car,0.1,2,0\n": "{path}:4:7: time_s: track a there are two places at 0.1 s",
        TABLE + "a,car,3,2,0\n": "{path}:4:7: time_s: track a has no samples in the 2.9 s before",
        TABLE + "a,car,0.2,900,0\n": "{path}:4:11: x_m: track a moves 899 m in 0.1 s, 8990 m/s;",
        TABLE + "a,car,0.2,1e300,0\n": "{path}:4:11: x_m: track a moves inf m in 0.1 s, inf m/s;",
        TABLE + "a,car,0.2\n": "{path}:4:1: has 3 values below 5 names of columns",
        "id,class,time_s,x_m\na,car,0,0\n": "{path}:1:1: has no column 'y_m'",
        "a,b,c\n1,2,3\n": "{path}:1:1: has the columns of no known layout; rename them (own: id,",
        "id,class,time_s,x_m,y_m\n": "{path}: has no rows below its head",
        "": "{path}:1:1: has the columns of no known layout",
        TABLE + 'a,car,0.2,"2\n5",0\n': "{path}:4:1: has a value with a line break; write every",
        TABLE + '"a\nb",car,0.2,2,0\n': "{path}:4:1: has a value with a line break; write every",
        TABLE + "a,car,1.7e9,2,0\n": (
            "{path}:4:7: time_s: 1700000000 s is not within 1,000,000 s of time 0; count times from"
        ),
        "x" * 200_000 + ",b\n": "{path}:1:1: is not CSV: field larger than field limit",
        'id,class,time_s,x_m,y_m\na,"car"s,0,0,0\n': "{path}:2:1: is not CSV",
        TABLE + 'a,"car,0.2,2,0\n' + "a,car,0.3,2,0\n" * 9: "{path}:4:3: is not CSV",
        TABLE + 'a,"car",0.2,"2,0\na,car,0.3,2,0\n': "{path}:4:13: is not CSV",
    }.items(),
)
def test_a_row_that_cannot_be_used_is_named_by_place(
    content: str, expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(content)
    with pytest.raises(DiagnosticsError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(expected.format(path=path))


@pytest.mark.parametrize("line_end", ["\r", "\r\n"])
def test_lines_end_as_on_any_system(line_end: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    rows = TABLE.replace("x_m", "note,x_m").replace("0,0,0", '0,"a\nb",0,0').replace("1,1", "1,,1")
    path.write_text(rows.replace("\n", line_end), newline="")
    (track,) = read_recording(path)
    assert track.places.tolist() == [[0, 0], [1, 0]]


def test_a_recording_of_ind_needs_the_files_about_it(tmp_path: Path) -> None:
    path = write_ind(tmp_path)
    (tmp_path / "07_tracksMeta.csv").unlink()
    with pytest.raises(InputError, match=r"07_tracks.csv: needs 07_tracksMeta.csv, which is not"):
        read_recording(path)


def test_one_at_rest_keeps_the_heading_of_its_motion() -> None:
    times_s = np.arange(8) / 10
    east = np.array([0, 0, 0, 1, 2, 2, 2, 2.0])
    headings = derive_headings(times_s, np.column_stack([0 * east, east]))
    assert headings == pytest.approx(math.pi / 2)
    assert derive_headings(times_s, np.zeros((8, 2))) == pytest.approx(0.0)


def test_a_recording_is_turned_counter_clockwise_and_then_moved() -> None:
    track = Track(
        "a", "car", (0, 0, 0), np.array([0.0, 1]), np.array([[3.0, 1], [4, 1]]), np.zeros(2)
    )
    moved = track.transform(east_m=10, north_m=20, turn_rad=math.pi / 2)
    # (3, 1) turned by a right angle to the left is (-1, 3).
    assert moved.places == pytest.approx(np.array([[9, 23], [9, 24]]))
    assert moved.headings_rad == pytest.approx(math.pi / 2)
