"""Bodies come from the scenario or from catalogues, with the parameters that a scenario assigns."""

import re
from pathlib import Path

import pytest

from advercity.diagnostics import DiagnosticsError
from advercity.foreign.ledger import describe_left_out
from advercity.recordings.openscenario.scenario import RecordedScenario, read_scenario
from tests.recordings.recorded_files import write_openscenario

PARAMETERS = """<ParameterDeclarations>
  <ParameterDeclaration name="towed" parameterType="string" value=""/>
  <ParameterDeclaration name="length" parameterType="double" value="9"/></ParameterDeclarations>"""
TRAILER = '<Trailer><TrailerRef entityRef="$towed"/></Trailer>'


def read_bus(folder: Path, assigned: str, *, file_name: str = "Buses") -> RecordedScenario:
    """Read a scenario whose truck is a bus of a catalogue."""
    path = write_openscenario(folder)
    text = path.read_text()
    found = re.search(r'<Vehicle name="bus".*?</Vehicle>', text, re.DOTALL)
    assert found is not None
    body = (
        found[0]
        .replace('"bus">', f'"bus">{PARAMETERS}', 1)
        .replace('length="9"', 'length="$length"')
    )
    body = body.replace("</Vehicle>", f"{TRAILER}</Vehicle>")
    (folder / f"{file_name}.xosc").write_text(
        f'<OpenSCENARIO><Catalog name="Bodies">{body}</Catalog></OpenSCENARIO>'
    )
    name = "Bodies" if file_name == "Buses" else file_name
    reference = f"""<CatalogReference catalogName="{name}" entryName="bus">
      <ParameterAssignments>{assigned}</ParameterAssignments></CatalogReference>"""
    place = '<VehicleCatalog><Directory path="."/></VehicleCatalog>'
    text = text.replace("<CatalogLocations/>", f"<CatalogLocations>{place}</CatalogLocations>")
    path.write_text(text.replace(found[0], reference))
    return read_scenario(path)


def assign(name: str, value: str) -> str:
    return f'<ParameterAssignment parameterRef="{name}" value="{value}"/>'


@pytest.mark.parametrize(("name", "value"), [("length", "4.5"), ("$length", "18.75")])
def test_a_parameter_is_assigned_by_its_name(name: str, value: str, tmp_path: Path) -> None:
    tracks = {track.id: track for track in read_bus(tmp_path, assign(name, value)).tracks}
    assert tracks["Truck"].size == (float(value), 2.5, 3.0)


def test_an_assignment_of_no_parameter_is_listed(tmp_path: Path) -> None:
    left_out = read_bus(tmp_path, assign("width", "3")).left_out
    assert "1 assignment of a parameter that 'bus' has not" in describe_left_out(left_out)


def test_a_catalogue_may_be_named_as_its_file(tmp_path: Path) -> None:
    assert len(read_bus(tmp_path, "", file_name="OtherName").tracks) == 4


def test_an_entity_that_tows_another_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DiagnosticsError, match="<TrailerRef>: another entity is towed"):
        read_bus(tmp_path, assign("towed", "Other"))
