"""Suggest conflicts for the junctions of a map, with the road and the suite to paste.

Conflicts are bound and solved, not simulated: `compile --settle` shows the effect of traffic.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from advercity_dsl import Blueprint, Catalogue, Conflict, Density, MapFile, Road, Suite
from advercity_dsl.road import JunctionAgents, LeftOut, MapSource
from advercity_dsl.road.streets import DrivingSide

from advercity.atomic_files import write_atomically
from advercity.compiler.library import Library, load_library
from advercity.compiler.shipped_library import find_shipped_library
from advercity.compiler.suite_conflicts import (
    UnstageableError,
    bind_crossed,
    solve_road_conflicts,
)
from advercity.errors import InputError, report_write_errors
from advercity.roads.arms import MisplacedPartError
from advercity.roads.junction_arms import JunctionArms, place_at_every_arm
from advercity.roads.lanelet2.placing import find_middle
from advercity.roads.map_files import read_map_file
from advercity.roads.map_import import import_map
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.routes import RoutePlanner

MAX_JUNCTIONS = 50
"""Number of junctions to try, the ones with the most arms first; each takes about a second."""
MAX_NAME_LENGTH = 12
"""Limit for a road named after its file: ids of specs also hold junction, conflict and weather."""
WEATHER, DENSITY, LIBRARY_NAME = "fog_day", "sparse", "adver_city"
UNIT = {"kind": "roadside_unit", "arm": "same"}
CREWS: Mapping[str, Mapping[str, Mapping[str, str]]] = {
    "": {
        "cav1": {"kind": "vehicle", "role": "ego"},
        "cav2": {"kind": "vehicle", "arm": "opposite"},
        "rsu1": UNIT,
    },
    "_alone": {"cav1": {"kind": "vehicle", "role": "ego"}, "rsu1": UNIT},
}
"""Agents of a junction by the end of the road's id; the second crew where nothing is opposite."""
ROAD = {
    "land_use": "urban",
    "junction": "intersection",
    "alignment": "straight",
    "profile": "level",
}
TRAFFIC = {
    "vehicles_per_area": 1,
    "walkers": 8,
    "crossing_share": 0.5,
    "around_agent_m": 50,
    "around_path_m": 15,
    "classes": {"car": 0.8, "van": 0.2, "truck": 0, "bicycle": 0, "motorcycle": 0},
}


@dataclass(frozen=True)
class JunctionSuggestion:
    """A junction and the conflicts to stage there with the agents of a road.

    Attributes:
        junction: Its id.
        control: Its rule of right of way.
        arms: Its arms and their destinations.
        road: Id of the road with the agents at it.
        conflicts: Ids of the conflicts, the surest first: nobody holds up actors on paths of their
            own, other traffic holds up those in lanes.
        reason: Why it can stage none; empty if it can.
    """

    junction: str
    control: str
    arms: str
    road: str = ""
    conflicts: tuple[str, ...] = ()
    reason: str = ""


@dataclass(frozen=True)
class MapSuggestions:
    """Conflicts to stage on a map.

    Attributes:
        junctions: Junctions of three arms or more, the ones with the most conflicts first; twice
            where some conflicts have a place only for an ego without another vehicle.
        documents: Declarations of roads and suite, by the name of their file.
        suite: Id of the suite.
        driving_side: Side on which traffic drives.
        untried_count: Number of smaller junctions left untried.
        left_out: Omitted parts of the map.
    """

    junctions: tuple[JunctionSuggestion, ...]
    documents: Mapping[str, str]
    suite: str
    driving_side: DrivingSide
    untried_count: int = 0
    left_out: tuple[LeftOut, ...] = ()


def suggest_conflicts(
    file: Path,
    source: MapSource,
    name: str | None = None,
    *,
    on_junction: Callable[[int, int], None] = lambda done, total: None,
) -> MapSuggestions:
    """Find the conflicts to stage at each junction of a map.

    Args:
        file: The map.
        source: Its format.
        name: Id of road and suite; by default the name of the file.
        on_junction: Called before each junction with the numbers of finished and of all junctions.

    Raises:
        InputError: The map cannot be used, or has no junction of three arms.
    """
    name = name or _name_road(file)
    declared = {"source": source, "file": file.name}
    data = {"kind": "road", "id": name, **ROAD, **_locate(file, source), "imported": declared}
    bare = Road.model_validate({**data, "agents": {}, "traffic": TRAFFIC})
    network = import_map(MapFile.model_validate(declared), bare, file.parent)
    road = bare.model_copy(update={"imported": network})
    finder = _Finder.for_road(road)
    junctions = finder.list_junctions()
    if not junctions:
        raise InputError(f"{file}: has no junction of three arms or more, to stage conflicts at")
    tried = junctions[:MAX_JUNCTIONS]
    found: list[JunctionSuggestion] = []
    for index, arms in enumerate(tried):
        on_junction(index, len(tried))
        found += finder.suggest(arms)
    found.sort(key=lambda item: -len(item.conflicts))
    documents = dict(_write_documents(data, found))
    untried_count = len(junctions) - len(tried)
    return MapSuggestions(
        junctions=tuple(found),
        documents=documents,
        suite=name,
        driving_side=network.driving_side,
        untried_count=untried_count,
        left_out=network.left_out,
    )


def _name_road(file: Path) -> str:
    stem = file.stem.lower().removesuffix(".net")
    name = re.sub(r"[^a-z0-9]+", "_", stem).strip("_")[:MAX_NAME_LENGTH].rstrip("_")
    return name if re.match(r"[a-z]", name) else f"town_{name}".rstrip("_")


def _locate(file: Path, source: MapSource) -> dict[str, float]:
    """Find the middle of an OpenStreetMap extract or Lanelet2 map, where the origin is to be."""
    if source not in ("osm", "lanelet2"):
        return {}
    root = read_map_file(MapFile(source=source, file=file.name), file.parent).root
    if source == "lanelet2":
        middle = find_middle(root.iter("node"))
        return dict(zip(("origin_lat_deg", "origin_lon_deg"), middle or (), strict=False))
    try:
        nodes = [
            (float(item.attrib["lat"]), float(item.attrib["lon"])) for item in root.iter("node")
        ]
    except (KeyError, ValueError):
        raise InputError(f"{file}: has a node without latitude and longitude") from None
    if not nodes:
        raise InputError(f"{file}: has no nodes")
    latitude, longitude = np.mean(nodes, axis=0).round(5).tolist()
    return {"origin_lat_deg": latitude, "origin_lon_deg": longitude}


@dataclass(frozen=True)
class _Finder:
    road: Road
    planner: RoutePlanner
    library: Library
    suite: Suite
    catalogue: Catalogue

    @staticmethod
    def for_road(road: Road) -> "_Finder":
        library = load_library(find_shipped_library())
        suite = Suite(id=road.id, rig=LIBRARY_NAME, catalogue=LIBRARY_NAME)
        catalogue = library.get_declarations(Catalogue)[LIBRARY_NAME]
        planner = RoutePlanner(to_plan_frame(road))
        return _Finder(road, planner, library, suite, catalogue)

    def list_junctions(self) -> list[JunctionArms]:
        """List the junctions of three arms or more, those with the most arms first."""
        left_hand = self.road.is_left_hand
        arms = [JunctionArms(self.planner, name, left_hand) for name in self.planner.movements]
        found = [item for item in arms if len(item.directions) > 2]
        return sorted(found, key=lambda item: -len(item.directions))

    def suggest(self, arms: JunctionArms) -> list[JunctionSuggestion]:
        """List the conflicts of each crew that the crews before it cannot stage; or why none."""
        control, text = self.planner.controls.get(arms.junction, "none"), arms.describe()
        try:
            return list(self._suggest(arms.junction, control, text))
        except InputError as error:
            return [JunctionSuggestion(arms.junction, control, text, reason=str(error))]

    def _suggest(self, junction: str, control: str, text: str) -> Iterator[JunctionSuggestion]:
        reason, known = "", set[str]()
        for suffix, crew in CREWS.items():
            declared = JunctionAgents.model_validate({"junction": junction, "agents": crew})
            name = f"{self.road.id}{suffix}"
            try:
                placed = place_at_every_arm(self.road, declared, junction)
            except MisplacedPartError as error:
                reason = str(error)
                continue
            update = {"id": f"{name}_{junction}"}
            places = [item.model_copy(update=update) for item in placed]
            conflicts = tuple(item.id for item in self._list_stageable(places, known))
            if conflicts:
                yield JunctionSuggestion(junction, control, text, name, conflicts)
            known.update(conflicts)
            reason = "none of the library's conflicts has a place here"
        if not known:
            yield JunctionSuggestion(junction, control, text, reason=reason)

    def _list_stageable(self, places: Sequence[Road], known: Collection[str]) -> list[Conflict]:
        found = [
            conflict
            for name, conflict in self.library.get_declarations(Conflict).items()
            if name not in known and self._can_stage(places, conflict)
        ]
        return sorted(found, key=_drives_in_lanes)

    def _can_stage(self, places: Sequence[Road], conflict: Conflict) -> bool:
        cell = bind_crossed(conflict, places, ["primary"], called_for=True)
        if cell is None:
            return False
        try:
            solve_road_conflicts(
                self.library,
                self.suite,
                cell,
                self.library.get_declarations(Density)[DENSITY],
                self._blueprints,
                ego=self.catalogue.blueprints[self.catalogue.ego],
            )
        except UnstageableError:
            return False
        return True

    @property
    def _blueprints(self) -> dict[str, Blueprint]:
        return {
            name: item
            for name, item in self.catalogue.blueprints.items()
            if item.land_use in ("any", self.road.land_use)
        }


def _drives_in_lanes(conflict: Conflict) -> bool:
    return not {"pedestrian", "bicycle"} >= set(conflict.actor.classes)


def _write_documents(
    road: Mapping[str, object], junctions: Sequence[JunctionSuggestion]
) -> Iterator[tuple[str, str]]:
    names: list[str] = []
    for suffix, crew in CREWS.items():
        name = f"{road['id']}{suffix}"
        placed = [item.junction for item in junctions if item.road == name]
        if placed:
            names.append(name)
            at_junction = {"junction": placed, "agents": crew}
            data = {**road, "id": name, "style": "residential", "at_junction": at_junction}
            yield f"{name}.yaml", _dump({**data, "traffic": TRAFFIC})
    if not names:
        return
    suite = {
        "kind": "suite",
        "id": road["id"],
        "roads": names,
        "weathers": [WEATHER],
        "densities": [DENSITY],
        "cross_conflicts": list(_choose(junctions)),
        "standings": ["primary", "extension"],
        "rig": LIBRARY_NAME,
        "catalogue": LIBRARY_NAME,
        "looks": "shaped",
    }
    yield "suite.yaml", _dump(suite)


def _choose(junctions: Iterable[JunctionSuggestion]) -> Iterator[str]:
    """Choose few conflicts of which every junction can stage one: always the commonest left."""
    left = [set(item.conflicts) for item in junctions if item.conflicts]
    while left:
        counts = {name: sum(name in other for other in left) for other in left for name in other}
        best = min(counts, key=lambda name: (-counts[name], name))
        yield best
        left = [other for other in left if best not in other]


def _dump(data: Mapping[str, object]) -> str:
    return yaml.safe_dump(dict(data), sort_keys=False, default_flow_style=None, width=100)


def write_suggestions(found: MapSuggestions, file: Path, output: Path) -> Iterator[Path]:
    """Write the declarations and a copy of their map to a folder; yield their paths.

    Raises:
        InputError: A file exists already, or the folder cannot be written.
    """
    contents = {name: text.encode() for name, text in found.documents.items()}
    contents[file.name] = file.read_bytes()
    with report_write_errors():
        output.mkdir(parents=True, exist_ok=True)
        for path in (output / name for name in contents):
            if path.exists() and not path.samefile(file):
                raise InputError(f"{path}: already exists; choose another folder")
        for name, content in contents.items():
            write_atomically(output / name, content)
            yield output / name
