"""From a recording to a library: road, suite, table and map, compiled into specs."""

import hashlib
import math
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from advercity_dsl import Catalogue, Rig, Spec, Weather
from advercity_dsl.base import ID_HINT, ID_PATTERN, suggest_name
from advercity_dsl.road import LeftOut
from advercity_dsl.suite import Looks
from advercity_dsl.units import KM_H_PER_M_S

from advercity.compiler.crossing import compile_library
from advercity.compiler.library import Library, load_library
from advercity.compiler.recorded_places import check_places
from advercity.compiler.shipped_library import find_shipped_library, suggest_declaration
from advercity.compiler.spec_files import check_spec_files
from advercity.compiler.suites import CONNECTED_CLASSES
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.errors import InputError, report_write_errors
from advercity.foreign.ledger import Ledger
from advercity.output_files import open_output_folder
from advercity.recordings.bodies import select_blueprint
from advercity.recordings.openscenario.scenario import read_scenario
from advercity.recordings.recorded_tables import read_recording
from advercity.recordings.track_file import MARGIN_S, format_tracks
from advercity.recordings.tracks import Track, cut_tracks, find_connected
from advercity.roads.map_files import is_lanelet2_file
from advercity.roads.recorded_programs import RecordedPrograms, replace_programs

MAX_DURATION_S = 180.0
"""Longest part taken of a recording without a given end."""
MAX_PLACE_M = 1e7
"""Farthest place from the origin of a map, the bound of `Metres`."""
MAX_LATITUDE_DEG, MAX_LONGITUDE_DEG = 89, 180
MIN_DURATION_S = 0.1
"""One frame."""
MAX_DURATION_TICKS = 1_000_000
"""Highest `max_ticks` of a suite."""
SUGGESTED_EGOS = 8
EGO_NAMES = ("ego", "hero", "egovehicle")
MAP_SOURCES = {".xodr": "opendrive", ".osm": "osm", ".net.xml": "sumo"}
TABLE_FILE, ROAD_FILE, SUITE_FILE = "trajectories.csv", "road.yaml", "suite.yaml"
SPECS_FOLDER = "specs"


@dataclass(frozen=True)
class Recording:
    """Tracks of a file, and its map.

    Attributes:
        path: The file.
        tracks: Its tracks.
        map_file: Its map; None if it names none.
        left_out: Omitted parts of the file.
        programs: Recorded states of lights of a SUMO network; others run the programs of the map.
    """

    path: Path
    tracks: Sequence[Track]
    map_file: Path | None = None
    left_out: Sequence[LeftOut] = ()
    programs: RecordedPrograms = field(default_factory=dict[str, Sequence[tuple[float, str]]])


@dataclass(frozen=True)
class ReplayChoice:
    """Choices of a user about a recording; see `advercity import trajectories --help`."""

    name: str | None = None
    ego: str | None = None
    connected: Sequence[str] = ()
    connected_count: int = 2
    from_s: float | None = None
    to_s: float | None = None
    offset_m: tuple[float, float] = (0.0, 0.0)
    turn_deg: float = 0.0
    weathers: Sequence[str] = ("clear_day",)
    rig: str = "adver_city"
    looks: Looks = "full"
    land_use: Literal["urban", "rural"] = "urban"
    origin_deg: tuple[float, float] | None = None


def load_recorded_table(path: Path) -> Recording:
    """Load a table of trajectories; InputError if it cannot be used."""
    ledger = Ledger()
    return Recording(path, read_recording(path, ledger), left_out=ledger.left_out)


def load_recorded_scenario(
    path: Path,
    map_file: Path | None = None,
    *,
    root: Path | None = None,
    parameters: Mapping[str, str] | None = None,
) -> Recording:
    """Load an OpenSCENARIO file; InputError if it cannot be used.

    Args:
        path: The file.
        map_file: Map in place of its own.
        root: Folder in which its catalogues must be.
        parameters: Values in place of the declared ones.
    """
    found = read_scenario(path, map_file=map_file, root=root, parameters=parameters)
    named = path.parent / found.map_file if found.map_file else None
    return Recording(path, found.tracks, named, found.left_out)


def write_recorded_road(
    recording: Recording, map_file: Path | None, choice: ReplayChoice, output: Path
) -> list[Spec]:
    """Write a library with a road for the tracks of a recording, and compile it.

    The specs are for `output / SPECS_FOLDER`.

    Args:
        recording: The recording.
        map_file: Its map; None is the map it names.
        choice: The part of it to take.
        output: Folder for road, suite, table and map.

    Raises:
        InputError: A choice does not exist, the map does not fit, or a file may not be replaced.
    """
    library = load_library(find_shipped_library())
    _check_choice(choice, library)
    name = _find_name(recording.path, choice.name)
    site = _find_map(recording, map_file)
    tracks = [
        track.transform(
            east_m=choice.offset_m[0],
            north_m=choice.offset_m[1],
            turn_rad=math.radians(choice.turn_deg),
        )
        for track in recording.tracks
    ]
    _check_extent(tracks)
    ego = find_ego(tracks, choice)
    from_s, to_s = _find_span(ego, choice)
    connected = [ego, *_find_others(tracks, ego, choice, from_s, to_s)]
    kept = cut_tracks(tracks, from_s - MARGIN_S, to_s + MARGIN_S)
    table = format_tracks(kept).encode()
    bodies = _select_bodies(connected, library)
    with report_write_errors(), open_output_folder(output) as folder:
        site_name = f"map{_find_map_suffix(site)}"
        shutil.copyfile(site, folder / site_name)
        if recording.programs:
            replace_programs(folder / site_name, recording.programs, from_s)
        (folder / TABLE_FILE).write_bytes(table)
        road = _build_road(name, choice, connected, folder / site_name)
        road["trajectories"] = {
            "file": TABLE_FILE,
            "sha256": hashlib.sha256(table).hexdigest(),
            "from_s": from_s,
            "to_s": to_s,
            "left_out": [part.model_dump(mode="json") for part in recording.left_out],
        }
        road["traffic"] = _NO_TRAFFIC
        _write_yaml(folder / ROAD_FILE, road)
        _write_yaml(folder / SUITE_FILE, _build_suite(name, choice, bodies, to_s - from_s))
        try:
            specs = compile_library(find_shipped_library(), folder, suite=name)
        except DiagnosticsError as error:
            named = str(site) if map_file else f"{recording.path}: {site.name}"
            lines = (_describe_problem(item, named, site_name) for item in error.diagnostics)
            raise InputError(*lines) from None
        check_places(specs[0], cut_tracks(kept, from_s, to_s))
        check_spec_files(specs, output / SPECS_FOLDER)  # before anything is written
    return specs


def _describe_problem(found: Diagnostic, site: str, site_name: str) -> str:
    """Describe a problem of the library without its place, since its files are gone by then.

    The user can change the map, which has another name there.
    """
    hint = f"; {found.hint}" if found.hint else ""
    return f"{site}: {found.message.removeprefix(f'{site_name}: ')}{hint}"


_NO_TRAFFIC = {
    "vehicles_per_area": 0,
    "walkers": 0,
    "around_agent_m": 50,
    "around_path_m": 15,
    "classes": {"car": 1, "van": 0, "truck": 0, "bicycle": 0, "motorcycle": 0},
}


def _check_choice(choice: ReplayChoice, library: Library) -> None:
    """Check the choices without the recording."""
    latitude_deg, longitude_deg = choice.origin_deg or (0.0, 0.0)
    if not (abs(latitude_deg) <= MAX_LATITUDE_DEG and abs(longitude_deg) <= MAX_LONGITUDE_DEG):
        raise InputError(
            f"`origin` {latitude_deg:g} {longitude_deg:g}: latitudes are -{MAX_LATITUDE_DEG} to"
            f" {MAX_LATITUDE_DEG} degrees, longitudes -{MAX_LONGITUDE_DEG} to {MAX_LONGITUDE_DEG}"
        )
    east_m, north_m = choice.offset_m
    if not (abs(east_m) <= MAX_PLACE_M and abs(north_m) <= MAX_PLACE_M):
        raise InputError(
            f"`offset` {east_m:g} {north_m:g}: give metres, at most {MAX_PLACE_M / 1000:,.0f} km"
        )
    if not abs(choice.turn_deg) <= 360:
        raise InputError(f"`turn` {choice.turn_deg:g}: give degrees, -360 to 360")
    _check_known("rig", choice.rig, library.get_declarations(Rig))
    for weather in choice.weathers:
        _check_known("weather", weather, library.get_declarations(Weather))


def _check_known(kind: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        hint = suggest_declaration(kind, name, known)
        raise InputError(f"`{kind}`: unknown {kind} '{name[:70]}'; {hint}")


def _check_extent(tracks: Iterable[Track]) -> None:
    """Check that tracks are within the limits of a map."""
    for track in tracks:
        if not np.abs(track.places).max() <= MAX_PLACE_M:
            raise InputError(
                f"track {track.id} leads farther than {MAX_PLACE_M / 1000:,.0f} km from the map's"
                " origin; are its places metres? move the recording to the map with `offset`"
            )


def _find_name(path: Path, name: str | None) -> str:
    if name is None:
        plain = re.sub(r"[^a-z0-9]+", "_", path.name.partition(".")[0].lower()).strip("_")
        return plain if re.match(r"[a-z]", plain) else f"recorded_{plain}".rstrip("_")
    if not re.fullmatch(ID_PATTERN, name):
        raise InputError(f"`name` {name}: is not an id; {ID_HINT}")
    return name


def _find_map(recording: Recording, map_file: Path | None) -> Path:
    found = map_file or recording.map_file
    if found is None:
        raise InputError(
            f"{recording.path}: names no map; give one with `map`: an OpenDRIVE (.xodr),"
            " OpenStreetMap (.osm) or SUMO (.net.xml) file"
        )
    if not found.is_file():
        named = "" if map_file else f", which {recording.path} names"
        raise InputError(f"{found}: there is no such map{named}; give one with `map`")
    return found


def _find_map_suffix(path: Path) -> str:
    for suffix in MAP_SOURCES:
        if path.name.lower().endswith(suffix):
            return suffix
    raise InputError(
        f"{path}: is a map of an unknown kind; name it *.xodr (OpenDRIVE), *.osm or *.net.xml"
    )


def find_ego(tracks: Sequence[Track], choice: ReplayChoice) -> Track:
    """Find the track of the ego; InputError, which lists vehicles, if it is not clear."""
    by_id = {track.id: track for track in tracks}
    vehicles = [track for track in tracks if track.actor_class in CONNECTED_CLASSES]
    if choice.ego is None:
        named = [track for track in vehicles if track.id.lower() in EGO_NAMES]
        if len(named) == 1:
            return named[0]
        if not vehicles:
            raise InputError(
                f"has no vehicle for the ego, which is a {' or '.join(CONNECTED_CLASSES)}"
            )
        longest = sorted(vehicles, key=lambda track: track.times_s[0] - track.times_s[-1])
        listed = ", ".join(
            f"{track.id} ({track.actor_class}, {track.times_s[0]:.1f} to {track.times_s[-1]:.1f} s)"
            for track in longest[:SUGGESTED_EGOS]
        )
        raise InputError(
            f"choose the ego among {len(vehicles)} vehicles with `ego`; recorded longest: {listed}"
        )
    return _get_vehicle(by_id, choice.ego, "ego")


def _get_vehicle(by_id: dict[str, Track], name: str, option: str) -> Track:
    track = by_id.get(name)
    if track is None:
        raise InputError(f"`{option}` {name}: no such track; {suggest_name(name, by_id)}")
    if track.actor_class not in CONNECTED_CLASSES:
        raise InputError(
            f"`{option}` {name}: is a {track.actor_class}; connected vehicles are"
            f" {', '.join(CONNECTED_CLASSES)}"
        )
    return track


def _find_span(ego: Track, choice: ReplayChoice) -> tuple[float, float]:
    """Find the time to take: the ego's recorded time, within the requested one."""
    begins, ends = float(ego.times_s[0]), float(ego.times_s[-1])
    from_s = begins if choice.from_s is None else choice.from_s
    to_s = min(ends, from_s + MAX_DURATION_S) if choice.to_s is None else choice.to_s
    if not begins - 1e-6 <= from_s < to_s <= ends + 1e-6:
        raise InputError(
            f"`from` {from_s:g}, `to` {to_s:g}: the ego '{ego.id}' was recorded from {begins:g}"
            f" to {ends:g} s; stay within that"
        )
    if not MIN_DURATION_S <= to_s - from_s <= MAX_DURATION_TICKS / 10 - 1:
        raise InputError(
            f"`from` {from_s:g}, `to` {to_s:g}: a scenario takes {MIN_DURATION_S:g} s to"
            f" {MAX_DURATION_TICKS / 10 - 1:g} s"
        )
    return round(from_s, 6), round(to_s, 6)


def _find_others(
    tracks: Sequence[Track], ego: Track, choice: ReplayChoice, from_s: float, to_s: float
) -> list[Track]:
    by_id = {track.id: track for track in tracks if track is not ego}
    if not choice.connected:
        return find_connected(tracks, ego, choice.connected_count, from_s=from_s, to_s=to_s)
    others = [_get_vehicle(by_id, name, "connected") for name in dict.fromkeys(choice.connected)]
    for track in others:
        if not track.covers(from_s, to_s):
            raise InputError(
                f"`connected` {track.id}: was recorded from {track.times_s[0]:g} to"
                f" {track.times_s[-1]:g} s, not from {from_s:g} to {to_s:g} s, which `from` and"
                " `to` narrow"
            )
    return others


def _select_bodies(connected: Iterable[Track], library: Library) -> dict[str, str]:
    catalogues = library.get_declarations(Catalogue)
    blueprints = {
        name: item
        for name, item in catalogues["adver_city"].blueprints.items()
        if item.land_use == "any"
    }
    return {
        _name_agent(number): select_blueprint(blueprints, track.actor_class, track.size, track.id)
        for number, track in enumerate(connected)
    }


def _name_agent(number: int) -> str:
    return f"cav{number + 1}"


def _build_road(
    name: str, choice: ReplayChoice, connected: Sequence[Track], site: Path
) -> dict[str, Any]:
    origin: dict[str, float] = {}
    if choice.origin_deg is not None:
        origin = dict(zip(("origin_lat_deg", "origin_lon_deg"), choice.origin_deg, strict=True))
    source = "lanelet2" if is_lanelet2_file(site) else MAP_SOURCES[_find_map_suffix(site)]
    return {
        "kind": "road",
        "id": name,
        "title": "Recorded traffic",
        "land_use": choice.land_use,
        "junction": "intersection",
        "alignment": "straight",
        "profile": "level",
        **origin,
        "imported": {"source": source, "file": site.name},
        "agents": {
            _name_agent(number): _build_vehicle(track, is_ego=number == 0)
            for number, track in enumerate(connected)
        },
    }


def _build_vehicle(track: Track, *, is_ego: bool) -> dict[str, Any]:
    steps = np.linalg.norm(np.diff(track.places, axis=0), axis=1) / np.diff(track.times_s)
    heading = math.degrees(float(track.headings_rad[0])) % 360
    return {
        "kind": "vehicle",
        "role": "ego" if is_ego else "other",
        "track": track.id,
        "spawn_m": np.round(track.places[0], 2).tolist(),
        "heading_deg": round(heading, 1),
        "destination_m": np.round(track.places[-1], 2).tolist(),
        "max_speed_km_h": float(np.clip(np.ceil(steps.max() * KM_H_PER_M_S), 1, 200)),
    }


def _build_suite(
    name: str, choice: ReplayChoice, bodies: dict[str, str], duration_s: float
) -> dict[str, Any]:
    return {
        "kind": "suite",
        "id": name,
        "title": "Recorded traffic",
        "roads": [name],
        "weathers": list(choice.weathers),
        "densities": ["sparse"],
        "rig": choice.rig,
        "catalogue": "adver_city",
        "bodies": bodies,
        "looks": choice.looks,
        "timing": {"warm_up_ticks": 0, "max_ticks": max(math.floor(duration_s * 10 + 1e-6) + 1, 3)},
    }


def _write_yaml(path: Path, data: dict[str, Any]) -> None:
    text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=100)
    path.write_text(text, encoding="utf-8", newline="\n")
