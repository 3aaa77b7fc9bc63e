"""The table of recorded tables against the columns that their authors publish."""

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from advercity.foreign.ledger import Ledger, describe_left_out
from advercity.foreign.standards import is_disposition, list_dispositions, load_standard
from advercity.recordings.recorded_tables import read_recording
from tests.recordings.recorded_files import write_highd, write_ind, write_interaction

TABLE = load_standard("recorded_tables")
PUBLISHED = {
    "inD": """recordingId trackId frame trackLifetime xCenter yCenter heading width length
      xVelocity yVelocity xAcceleration yAcceleration lonVelocity latVelocity lonAcceleration
      latAcceleration""",
    "exiD": """traveledDistance latLaneCenterOffset laneWidth laneletId laneChange lonLaneletPos
      leadId rearId leftLeadId leftRearId leftAlongsideId rightLeadId rightRearId rightAlongsideId
      leadDHW leadDV leadTHW leadTTC""",
    "highD": """frame id x y width height xVelocity yVelocity xAcceleration yAcceleration
      frontSightDistance backSightDistance dhw thw ttc precedingXVelocity precedingId followingId
      leftPrecedingId leftAlongsideId leftFollowingId rightPrecedingId rightAlongsideId
      rightFollowingId laneId""",
    "INTERACTION": "track_id frame_id timestamp_ms agent_type x y vx vy psi_rad length width",
}
"""Columns of tracks by layout; exiD has those of inD and these."""


def test_every_published_column_has_a_disposition_and_no_other() -> None:
    listed = {name: set(row) for name, row in TABLE.elements.items()}

    assert listed["inD"] == {*PUBLISHED["inD"].split(), *PUBLISHED["exiD"].split()}
    assert listed["highD"] == {*PUBLISHED["highD"].split()}
    assert listed["INTERACTION"] == {*PUBLISHED["INTERACTION"].split()}
    assert all(is_disposition(text) for _, _, text in list_dispositions(TABLE))


@pytest.mark.parametrize("write", [write_ind, write_highd, write_interaction])
@settings(
    max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_an_unknown_column_is_reported_wherever_it_is(
    write: Callable[[Path], Path], data: st.DataObject, tmp_path: Path
) -> None:
    path = write(tmp_path)
    rows = [*csv.reader(path.read_text().splitlines())]
    place = data.draw(st.integers(0, len(rows[0])))
    name = data.draw(st.from_regex(r"[a-z][A-Za-z]{3,12}", fullmatch=True))
    name += "Novel"
    for row, value in zip(rows, [name] + ["0"] * (len(rows) - 1), strict=True):
        row.insert(place, value)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")

    ledger = Ledger()
    read_recording(path, ledger)
    assert f"1 column {name} (line 1)" in describe_left_out(ledger.left_out)
