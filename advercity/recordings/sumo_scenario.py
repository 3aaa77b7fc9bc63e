"""Foreign SUMO scenarios: the parts of a configuration and its files safe for SUMO.

A configuration names files to write, programs to wait for and files to read. Only options and
elements of `foreign/tables/sumo_scenario.yaml` pass, in copies without names of files.
"""

import gzip
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from advercity.documents import parse_yaml, read_bytes
from advercity.errors import InputError, describe_cause
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import TABLES, apply_disposition, load_standard
from advercity.foreign.xml_documents import MAX_XML_BYTES, get_line, parse_xml, to_xml_bytes
from advercity.recordings.tracks import MAX_GAP_S

FILE_OPTIONS = ("net-file", "route-files", "additional-files")
TIME_OPTIONS = ("begin", "end")
DEPARTING = ("vehicle", "trip", "flow", "person", "personFlow")
SYNONYMS = {
    **dict.fromkeys(("net", "n"), "net-file"),
    **dict.fromkeys(("routes", "r"), "route-files"),
    **dict.fromkeys(("additional", "a"), "additional-files"),
    **{"b": "begin", "e": "end"},
}
PLAIN_VALUE = re.compile(r"[A-Za-z0-9_.,:+ -]{0,200}")
"""Values of options without a file name."""
GZIP_MAGIC = b"\x1f\x8b"
LANE_CHANGE_S = 3.0
"""Time of a change of lanes if the scenario has it instant."""
NETWORK_COPY = "town.net.xml"


@dataclass(frozen=True, eq=False)
class SumoScenario:
    """A scenario with documents safe for SUMO.

    Attributes:
        network: Published content of its network.
        options: Options of SUMO by name, without files and times.
        routes: Documents of routes and vehicle types.
        additional: Documents of lights, stops and the like.
        begin_s: Begin of the simulation.
        end_s: End of the simulation; None if it ends with its last vehicle.
    """

    network: bytes
    options: Mapping[str, str]
    routes: tuple[Element, ...]
    additional: tuple[Element, ...]
    begin_s: float
    end_s: float | None

    def write(self, folder: Path) -> list[str]:
        """Write copies of the documents into a folder and return SUMO's options."""
        network = folder / NETWORK_COPY
        network.write_bytes(to_xml_bytes(_copy_network(parse_xml(self.network))))
        options = {**self.options, "net-file": str(network), "begin": f"{self.begin_s:g}"}
        for name, documents in (("route", self.routes), ("additional", self.additional)):
            files = [folder / f"{name}{number}.xml" for number in range(len(documents))]
            for file, document in zip(files, documents, strict=True):
                file.write_bytes(to_xml_bytes(document))
            if files:
                options[f"{name}-files"] = ",".join(map(str, files))
        return [word for name, value in options.items() for word in (f"--{name}", value)]


def read_sumo_scenario(path: Path, ledger: Ledger) -> SumoScenario:
    """Read a configuration (`*.sumocfg`) and its files.

    Args:
        path: The configuration.
        ledger: Record of omissions.

    Raises:
        InputError: A file is missing or damaged, or a part of it is refused.
    """
    root = _parse_file(path, path.name)
    if root.tag not in ("configuration", "sumoConfiguration"):
        raise InputError(f"{path}: begins with <{root.tag[:40]}>; a configuration of SUMO does not")
    options = _read_options(root, path, ledger)
    if not options.get("net-file"):
        raise InputError(f"{path}: names no network (<net-file value=.../>)")
    routes, additional = (
        tuple(_read_document(path.parent, name, ledger) for name in _split_names(options, option))
        for option in ("route-files", "additional-files")
    )
    network_name = options["net-file"].strip()
    network = _read_file(path.parent, network_name)
    if _parse_raw(network, network_name).tag != "net":
        raise InputError(f"{path.parent / network_name}: is no network of SUMO (<net>)")
    step_s = _parse_time(options.get("step-length", "1"), path)
    if step_s > MAX_GAP_S:
        raise InputError(
            f"{path}: <step-length>: its steps are {step_s:g} s long; motion is unknown between"
            f" places more than {MAX_GAP_S:g} s apart"
        )
    begin_s = _parse_time(options.get("begin", "0"), path)
    end_s = _parse_time(options.get("end", "-1"), path)
    return SumoScenario(
        network=network,
        options=_smooth_lane_changes(options)
        | {
            name: value
            for name, value in options.items()
            if name not in (*FILE_OPTIONS, *TIME_OPTIONS)
        },
        routes=routes,
        additional=additional,
        begin_s=begin_s,
        end_s=None if end_s < 0 else end_s,
    )


def _read_options(root: Element, path: Path, ledger: Ledger) -> dict[str, str]:
    """Read the options of a configuration with an effect here."""
    found: dict[str, str] = {}
    for item in root.iter():
        value = item.get("value", item.get("v"))
        if value is None:
            continue
        name = SYNONYMS.get(item.tag, item.tag)
        known = _find_row("options", name)
        if known is None:
            ledger.leave_out(f"option {name[:60]}", plural=f"options {name[:60]}", at=item)
            continue
        try:
            is_left_out = apply_disposition(known, value, item, ledger)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if is_left_out or known == "none":
            continue
        if name not in FILE_OPTIONS and not PLAIN_VALUE.fullmatch(value):
            raise InputError(f"{path}: line {get_line(item)}: <{item.tag}>: '{value[:60]}' is none")
        found[name] = value
    return found


def _smooth_lane_changes(options: Mapping[str, str]) -> dict[str, str]:
    """Return the options without which vehicles would jump sideways into another lane."""
    is_smooth = {"lateral-resolution", "lanechange.duration"} & options.keys()
    return {} if is_smooth else {"lanechange.duration": f"{LANE_CHANGE_S:g}"}


def _split_names(options: Mapping[str, str], option: str) -> list[str]:
    return [name.strip() for name in re.split("[,;]", options.get(option, "")) if name.strip()]


def _parse_time(text: str, path: Path) -> float:
    total_s = _find_seconds(text)
    if total_s is None:
        raise InputError(f"{path}: '{text[:60]}' is no time")
    return total_s


def _find_seconds(text: str) -> float | None:
    """Read seconds, or days, hours, minutes and seconds with colons; None if it is no time."""
    try:
        parts = [float(part) for part in text.split(":")]
    except ValueError:
        return None
    factors = (1, 60, 3600, 86400)
    total_s = sum(part * factor for part, factor in zip(reversed(parts), factors, strict=False))
    return total_s if len(parts) <= len(factors) and abs(total_s) < 1e9 else None


def _read_document(folder: Path, name: str, ledger: Ledger) -> Element:
    """Read a file of routes or additional elements, without unsupported parts."""
    root = _parse_raw(_read_file(folder, name), name)
    copy = Element(root.tag)
    _list_unsorted(root, ledger)
    try:
        _copy_children(root, copy, ledger)
    except InputError as error:
        raise InputError(f"{folder / name}: {error}") from None
    return copy


def _list_unsorted(root: Element, ledger: Ledger) -> None:
    """List elements with a departure before one above them, which SUMO ignores."""
    latest_s = -np.inf
    for item in root:
        departs = item.get("depart", item.get("begin", "")) if item.tag in DEPARTING else ""
        departs_s = _find_seconds(departs)
        if departs_s is None:
            continue
        if departs_s < latest_s:
            why = "not sorted by departure (SUMO ignores"
            ledger.leave_out(f"{item.tag} {why} it)", plural=f"{item.tag}s {why} them)", at=item)
        latest_s = max(latest_s, departs_s)


def _copy_children(source: Element, target: Element, ledger: Ledger) -> None:
    for item in source:
        known = _find_row("elements", item.tag)
        if known is None:
            name = item.tag[:60]
            ledger.leave_out(f"element <{name}>", plural=f"elements <{name}>", at=item)
        elif not apply_disposition(known, "", item, ledger) and known == "read":
            if item.tag == "param" and not _is_known_parameter(item.get("key", "")):
                name = item.get("key", "")[:60]
                ledger.leave_out(f"parameter {name}", plural=f"parameters {name}", at=item)
                continue
            _copy_children(
                item, SubElement(target, item.tag, _copy_attributes(item, ledger)), ledger
            )


def _copy_attributes(item: Element, ledger: Ledger) -> dict[str, str]:
    kept: dict[str, str] = {}
    for name, value in item.attrib.items():
        known = _load_table()["attributes"].get(name)
        if known is None:
            kept[name] = value
        else:
            apply_disposition(known, value, item, ledger)
    return kept


def _copy_network(root: Element) -> Element:
    """Copy the elements and attributes of a network in its standard, and no parameters."""
    standard = load_standard("sumo_network")

    def copy(item: Element, tags: tuple[str, ...]) -> Iterator[Element]:
        row = standard.find_row(tags)
        if row is None or (item.tag == "param" and not _is_known_parameter(item.get("key", ""))):
            return
        found = Element(item.tag, {key: item.attrib[key] for key in item.attrib if key in row})
        if item.tag == "location":
            found.set("projParameter", "!")  # it could name files
        for child in item:
            found.extend(copy(child, (*tags, child.tag)))
        yield found

    return next(copy(root, (root.tag,)), Element("net"))


def _is_known_parameter(key: str) -> bool:
    return any(fnmatchcase(key, pattern) for pattern in _load_table()["parameters"])


def _find_row(table: str, name: str) -> str | None:
    """Find the disposition of a name by the longest matching pattern."""
    rows: Mapping[str, str] = _load_table()[table]
    fitting = (pattern for pattern in rows if fnmatchcase(name, pattern))
    best = max(fitting, key=len, default=None)
    return None if best is None else rows[best]


@cache
def _load_table() -> Mapping[str, Any]:
    path = TABLES / "sumo_scenario.yaml"
    return parse_yaml(path.read_bytes(), path)


def _parse_file(path: Path, name: str) -> Element:
    return _parse_raw(_read_file(path.parent, path.name), name)


def _parse_raw(raw: bytes, name: str) -> Element:
    try:
        return parse_xml(raw)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _read_file(folder: Path, name: str) -> bytes:
    """Read a file, unpacked if it is packed by gzip."""
    path = folder / name
    if Path(name).is_absolute():
        raise InputError(f"{name}: is an absolute path; write it relative to the configuration")
    try:
        raw = read_bytes(path, max_bytes=MAX_XML_BYTES)
        if raw.startswith(GZIP_MAGIC):
            with gzip.open(path) as stream:
                raw = stream.read(MAX_XML_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        cause = describe_cause(error) if isinstance(error, OSError) else "is damaged"
        raise InputError(f"{path}: cannot be read: {cause}") from None
    if len(raw) > MAX_XML_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_XML_BYTES} bytes")
    return raw
