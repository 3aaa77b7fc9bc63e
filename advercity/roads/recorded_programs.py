"""Lights of a SUMO network in their recorded states."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from advercity.foreign.xml_documents import parse_xml, to_xml_bytes

LAST_PHASE_S = 1e6
"""Duration of the last recorded state, which goes on."""
RecordedPrograms = Mapping[str, Sequence[tuple[float, str]]]
"""Times in seconds and states, as they change, by the id of a light."""


def replace_programs(file: Path, programs: RecordedPrograms, from_s: float) -> None:
    """Give lights of a network fixed programs of their recorded states.

    Args:
        file: The network, changed in place.
        programs: Recorded states.
        from_s: Time of the recording at the programs' begin.
    """
    net = parse_xml(file.read_bytes())
    place = next((at for at, item in enumerate(net) if item.tag == "tlLogic"), len(net))
    for item in net.findall("tlLogic"):
        if item.get("id") in programs:
            net.remove(item)
    for light, states in programs.items():
        net.insert(place, _build_program(light, states, from_s))
    file.write_bytes(to_xml_bytes(net))


def _build_program(light: str, states: Sequence[tuple[float, str]], from_s: float) -> Element:
    attributes = {"id": light, "type": "static", "programID": "recorded", "offset": "0"}
    program = Element("tlLogic", attributes)
    begins_s = from_s
    ends = [time_s for time_s, _ in states[1:]] + [from_s + LAST_PHASE_S]
    for (_, state), ends_s in zip(states, ends, strict=True):
        if ends_s > begins_s:
            phase = {"duration": f"{ends_s - begins_s:.3f}", "state": state}
            SubElement(program, "phase", phase)
            begins_s = ends_s
    return program
