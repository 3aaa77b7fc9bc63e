"""Reading a scenario: its entities, its map, and the tracks of its played actors.

Parts without effect on motion are omitted and listed. Unsupported parts are refused by name and
line, since the result would be another scenario. World positions are right-handed, h is
counter-clockwise from x; they are of the entity's reference point, from which the bounding box has
its own centre.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from advercity_dsl.road import LeftOut

from advercity.errors import InputError
from advercity.recordings.openscenario.catalogues import Catalogues, start_scope
from advercity.recordings.openscenario.document import Findings, Scope, open_source
from advercity.recordings.openscenario.entities import read_entities
from advercity.recordings.openscenario.player import play
from advercity.recordings.openscenario.road_map import RoadMap
from advercity.recordings.openscenario.stage import Mover, Stage
from advercity.recordings.openscenario.storyboard import StoryboardParser
from advercity.recordings.openscenario.tracks import build_track, has_moved
from advercity.recordings.tracks import Track
from advercity.roads.opendrive.parsing import parse_opendrive


@dataclass(frozen=True)
class RecordedScenario:
    """A scenario's data of its actors.

    Attributes:
        tracks: One per entity with a place, in their order.
        map_file: Path of the OpenDRIVE file as written; None without one.
        left_out: Omitted parts of the file.
    """

    tracks: list[Track]
    map_file: str | None
    left_out: tuple[LeftOut, ...]


def read_scenario(
    path: Path,
    *,
    map_file: Path | None = None,
    root: Path | None = None,
    parameters: Mapping[str, str] | None = None,
) -> RecordedScenario:
    """Read a scenario, and play it.

    Args:
        path: The file.
        map_file: OpenDRIVE file in place of the scenario's.
        root: Folder in which its catalogues must be; None is the one around the scenario's folder.
        parameters: Values in place of the declared ones.

    Raises:
        InputError: It cannot be read, or has unsupported parts, all listed.
    """
    findings = Findings()
    scope = start_scope(open_source(path), findings, parameters or {})
    _check_header(scope)
    findings.raise_problems()
    scope.audit(scope.source.root)
    folder = path.absolute().parent.parent if root is None else root
    findings.find_entry = Catalogues(scope, folder).find
    movers = {entity.name: Mover(entity) for entity in read_entities(scope)}
    storyboard = StoryboardParser(scope).parse()
    logic = scope.source.root.find("RoadNetwork/LogicFile")
    named = scope.get(logic, "filepath") if logic is not None else None
    findings.raise_problems()
    opened = map_file or (path.parent / named if named else None)
    values = {**_read_variables(scope), **scope.parameters}
    stage = Stage(movers, _prepare_map(opened), scope, values=values)
    play(storyboard, stage)
    if not any(has_moved(mover) for mover in movers.values()):
        scope.refuse(scope.source.root, "no entity moves")
    findings.raise_problems()
    tracks = [
        track for mover in movers.values() if (track := build_track(scope, mover)) is not None
    ]
    findings.raise_problems()
    return RecordedScenario(tracks, named or None, findings.ledger.left_out)


def _check_header(scope: Scope) -> None:
    root = scope.source.root
    if root.tag not in ("OpenSCENARIO", "OpenScenario"):
        scope.refuse(root, "is not an <OpenSCENARIO> document")
    header = root.find("FileHeader")
    if header is not None and header.get("revMajor", "1") != "1":
        message = f"is version {header.get('revMajor')}.{header.get('revMinor', '')}"
        scope.refuse(header, message, "versions 1.0 to 1.3 are read")


def _read_variables(scope: Scope) -> dict[str, str]:
    declared = scope.source.root.iterfind("VariableDeclarations/VariableDeclaration")
    return {scope.get(item, "name"): scope.get(item, "value") for item in declared}


def _prepare_map(path: Path | None) -> Callable[[], RoadMap | None]:
    """Return a function to open the map at its first use."""

    @cache
    def open_map() -> RoadMap | None:
        if path is None:
            return None
        source = open_source(path)
        if source.root.tag != "OpenDRIVE":
            raise InputError(f"{path}: is no OpenDRIVE map, which places on lanes need")
        try:
            return RoadMap(parse_opendrive(source.root))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    return open_map
