"""Libraries: folders of declarations, loaded with `extends` resolved, found by kind and id."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from advercity_dsl import (
    DECLARATIONS,
    LANGUAGE_VERSION,
    Blueprint,
    Catalogue,
    Declaration,
    MapFile,
    MapNetwork,
    Rig,
    Road,
    TrajectoryFile,
    Typology,
    Vehicle,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.base import ID_HINT, suggest_name
from advercity_dsl.road import Surrounding

from advercity.compiler.agent_places import complete_routes, place_agents
from advercity.compiler.camera_calibrations import CALIBRATIONS_FOLDER, apply_calibrations
from advercity.compiler.distributions import Distributions, build_typical_weather
from advercity.compiler.extends import (
    DeclarationKey,
    Documents,
    ResolvedDeclaration,
    list_parents,
    resolve_extends,
)
from advercity.compiler.lidar_models import apply_lidar_models, names_lidar_model
from advercity.compiler.map_places import place_imported_road
from advercity.compiler.map_surroundings import read_surroundings
from advercity.compiler.shipped_library import (
    EXAMPLES_FOLDER,
    find_example,
    find_shipped_library,
    suggest_declaration,
)
from advercity.compiler.source import SourceDocument, read_document
from advercity.compiler.surrounding_styles import grow_surroundings
from advercity.compiler.validation import format_value, validate_model
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.digests import compute_json_digest
from advercity.documents import MAX_MODEL_BYTES, read_bytes, suggest_path
from advercity.errors import InputError, describe_cause
from advercity.recordings.track_file import load_trajectories
from advercity.roads.arms import MisplacedPartError
from advercity.roads.map_import import import_map

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
NO_DECLARATIONS = (EXAMPLES_FOLDER, CALIBRATIONS_FOLDER)
"""Folders whose files are not of the library."""
MAX_FILES = 10_000
LINK_OUT, LINK_OUT_HINT = "is a link out of the library", "put the file itself in its place"
GLB_MAGIC = b"glTF"


@dataclass(frozen=True)
class LibraryEntry(Generic[DeclarationT]):
    """A declaration and its source.

    Attributes:
        declaration: The model; a weather with distributions has typical values in their place.
        source: Data and positions.
        digest: SHA-256 of the data, with `extends` merged.
        distributions: Distributions of a weather.
        left_out: Junctions where a road's agents cannot be, and the reasons.
        elsewhere: The road with its ego on the other arms, if it may come from any.
    """

    declaration: DeclarationT
    source: ResolvedDeclaration
    digest: str
    distributions: Distributions = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    elsewhere: tuple[Road, ...] = ()


@dataclass(frozen=True)
class Library:
    """All declarations of one or several folders, by kind and id.

    Attributes:
        entries: Entries by kind and id.
        variants: Ids of the roads made of a road with agents at several junctions, by its id.
    """

    entries: Mapping[DeclarationKey, LibraryEntry[Declaration]]
    variants: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def list_weathers(self) -> dict[str, Weather]:
        """Return the weathers named by `all`, by id: those that are not optional."""
        return {
            name: item for name, item in self.get_declarations(Weather).items() if not item.optional
        }

    def list_selected(self, kind: str, name: str) -> tuple[str, ...]:
        """List the ids of declarations of a kind selected by a name, or a pattern with `*`, `?`."""
        if kind == "road" and name in self.variants:
            return self.variants[name]  # a road of each junction
        declared = sorted(other for of_kind, other in self.entries if of_kind == kind)
        return tuple(other for other in declared if fnmatchcase(other, name))

    def find_declared_id(self, name: str) -> str:
        """Return the id under which a road is declared."""
        found = (declared for declared, names in self.variants.items() if name in names)
        return next(found, name)

    def get_declarations(self, kind: type[DeclarationT]) -> dict[str, DeclarationT]:
        """Return all declarations of a kind by id, sorted by id."""
        return {
            name: entry.declaration
            for (_, name), entry in sorted(self.entries.items())
            if isinstance(entry.declaration, kind)
        }

    @cached_property
    def crash_types(self) -> dict[str, str]:
        """The typology of every crash type, by the id of the type."""
        return {
            item.id: typology.id
            for typology in self.get_declarations(Typology).values()
            for item in (*typology.crash_types, *typology.earlier)
        }

    def find_entry(self, declaration: DeclarationT) -> LibraryEntry[DeclarationT]:
        """Return the entry of one of the library's declarations."""
        entry = self.entries[get_declaration_kind(declaration), declaration.id]
        return cast(LibraryEntry[DeclarationT], entry)

    def is_shipped(self, declaration: Declaration) -> bool:
        """Return whether a declaration is in advercity's own library."""
        path = self.find_entry(declaration).source.document.path
        return path.resolve().is_relative_to(find_shipped_library().resolve())

    def build_diagnostic(
        self,
        declaration: Declaration,
        *value_path: str | int,
        message: str,
        hint: str = "",
        key: bool = False,
    ) -> Diagnostic:
        """Build a diagnostic at a value, or its key, of one of the library's declarations."""
        source = self.find_entry(declaration).source
        return source.build_diagnostic(value_path, message, hint=hint, key=key)

    def check_reference(
        self, declaration: Declaration, *value_path: str | int, kind: str, name: str
    ) -> list[Diagnostic]:
        """Return a diagnostic at a value if it names an unknown declaration of a kind."""
        if self.list_selected(kind, name):
            return []
        known = (other for of_kind, other in self.entries if of_kind == kind)
        hint = suggest_declaration(kind, name, known)
        message = f"unknown {kind} '{name}'"
        return [self.build_diagnostic(declaration, *value_path, message=message, hint=hint)]


def load_library(*folders: Path) -> Library:
    """Load every `*.yaml` below some folders; a file can take the place of a folder.

    Folders named `examples` and folders with a leading dot are skipped.

    Raises:
        DiagnosticsError: With the errors of all files.
        InputError: A folder does not exist, has no declarations, or is too large for a library.
    """
    diagnostics: list[Diagnostic] = []
    paths = [path for folder in folders for path in _list_declaration_files(folder, diagnostics)]
    documents = _index_documents(_read_documents(paths, diagnostics), diagnostics)
    known = _add_shipped_parents(documents)
    entries: dict[DeclarationKey, LibraryEntry[Declaration]] = {}
    variants: dict[str, tuple[str, ...]] = {}
    for kind, name in documents:
        try:
            built = _build_entries((kind, name), known)
        except DiagnosticsError as error:
            diagnostics += error.diagnostics
            continue
        ids = tuple(entry.declaration.id for entry in built)
        entries |= {(kind, item): entry for item, entry in zip(ids, built, strict=True)}
        if ids != (name,):
            variants[name] = ids
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    return Library(entries, variants)


def load_declaration(path: Path) -> LibraryEntry[Declaration]:
    """Load the declaration of a file, which may build on its neighbours and the shipped library.

    Raises:
        DiagnosticsError: With the errors of the file.
    """
    document = read_document(path)
    diagnostics: list[Diagnostic] = []
    documents = _index_documents([document], diagnostics)
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    (name,) = documents
    data: Any = document.data
    if "extends" in data or names_lidar_model(data):
        # Errors in other files matter only if they hide the parent, which is then unknown.
        ignored: list[Diagnostic] = []
        neighbours = (other for other in sorted(path.parent.glob("*.yaml")) if other != path)
        documents = _index_documents(_read_documents(neighbours, ignored), ignored) | documents
        documents = _read_shipped_documents() | documents
    return _build_entries(name, documents)[0]


def _add_shipped_parents(
    documents: dict[DeclarationKey, SourceDocument],
) -> dict[DeclarationKey, SourceDocument]:
    """Add the shipped library's documents if a declaration extends one that is not in its own."""
    parents = {
        (kind, parent)
        for (kind, _), document in documents.items()
        for parent in list_parents(document)
        if isinstance(parent, str)
    }
    missing = parents - documents.keys()
    shipped = _read_shipped_documents() if missing else {}
    return shipped | documents if missing & shipped.keys() else documents


def _read_shipped_documents() -> dict[DeclarationKey, SourceDocument]:
    ignored: list[Diagnostic] = []
    paths = _list_declaration_files(find_shipped_library(), ignored)
    return _index_documents(_read_documents(paths, ignored), ignored)


def find_declaration_file(name: str, *folders: Path) -> Path:
    """Find the file of a declaration in a library by its name, which is also the file's.

    Raises:
        InputError: There is none, or there are several of different kinds.
    """
    files = [path for folder in folders for path in _list_declaration_files(folder, [])]
    found = [path for path in files if path.stem == name]
    if len(found) > 1:
        raise InputError(f"{name}: name one of the files {', '.join(map(str, found))}")
    if not found:
        hint = suggest_name(name, {path.stem for path in files})
        raise InputError(f"{name}: no such file, and no declaration of that name; {hint}")
    return found[0]


def find_weather(text: str, *folders: Path) -> LibraryEntry[Weather]:
    """Load the weather in the file `text`, or by this name from a library.

    Args:
        text: A file, or a name.
        folders: The library; by default advercity's own.

    Raises:
        InputError: Neither exists, or the file is not a weather.
    """
    path = Path(text)
    if path.suffix in (".yaml", ".yml") or path.exists():
        entry = load_declaration(path)
        if not isinstance(entry.declaration, Weather):
            raise DiagnosticsError(
                entry.source.build_diagnostic(
                    ("kind",), "is not a weather", hint="give the file of a weather"
                )
            )
        return cast(LibraryEntry[Weather], entry)
    library = load_library(*folders or [find_shipped_library()])
    weathers = library.get_declarations(Weather)
    if text not in weathers:
        example = find_example("weather", text)
        if example is not None:
            raise InputError(f"'{text}' is an example; give its file: {example}")
        shipped = "advercity's library (`library` names another)"
        where = " or ".join(map(str, folders)) or shipped
        raise InputError(
            f"unknown weather '{text}': neither a file, nor a name in {where};"
            f" {suggest_name(text, weathers)}"
        )
    return library.find_entry(weathers[text])


def list_weathers(*folders: Path) -> list[LibraryEntry[Weather]]:
    """Return the weathers named by `all` in a library, by default in advercity's own."""
    library = load_library(*folders or [find_shipped_library()])
    return [library.find_entry(item) for item in library.list_weathers().values()]


def _list_declaration_files(folder: Path, diagnostics: list[Diagnostic]) -> list[Path]:
    if not folder.exists():
        hint = suggest_path(folder) or "is the path right?"
        raise InputError(f"{folder}: no such file or folder; {hint}")
    if not folder.is_dir():
        return [folder]
    inside = sorted(
        path for path in _walk_folder(folder, diagnostics) if path.suffix in (".yaml", ".yml")
    )
    # A message about such a file would show lines of the link's target.
    outside = {path for path in inside if not path.resolve().is_relative_to(folder.resolve())}
    diagnostics += [Diagnostic(path, 0, 0, "", LINK_OUT, LINK_OUT_HINT) for path in outside]
    # Reported rather than skipped: a silently missing declaration is hard to find.
    for path in inside:
        if path.suffix == ".yml":
            hint = f"rename it to {path.with_suffix('.yaml').name}"
            diagnostics.append(Diagnostic(path, 0, 0, "", "declarations end in .yaml", hint))
    paths = [path for path in inside if path.suffix == ".yaml" and path not in outside]
    if not paths and not diagnostics:
        raise InputError(f"{folder}: no declarations (*.yaml) here; is it a library folder?")
    return paths


def _walk_folder(folder: Path, diagnostics: list[Diagnostic]) -> Iterator[Path]:
    """Yield the files of a library; raise for a folder far too large for one."""

    def add_error(error: OSError) -> None:
        message = f"cannot be read: {describe_cause(error)}"
        diagnostics.append(Diagnostic(Path(error.filename), 0, 0, "", message))

    count = 0
    for inside, folders, names in os.walk(folder, onerror=add_error):
        # os.walk descends into the folders left in this list.
        folders[:] = sorted(
            name for name in folders if name not in NO_DECLARATIONS and name[0] != "."
        )
        count += len(folders) + len(names)
        if count > MAX_FILES:
            message = f"holds more than {MAX_FILES} files and folders; is it a library folder?"
            raise InputError(f"{folder}: {message}")
        yield from (Path(inside, name) for name in names if name[0] != ".")


def _read_documents(
    paths: Iterable[Path], diagnostics: list[Diagnostic]
) -> Iterator[SourceDocument]:
    for path in paths:
        try:
            yield read_document(path)
        except DiagnosticsError as error:
            diagnostics += error.diagnostics


def _index_documents(
    documents: Iterable[SourceDocument], diagnostics: list[Diagnostic]
) -> dict[DeclarationKey, SourceDocument]:
    index: dict[DeclarationKey, SourceDocument] = {}
    for document in documents:
        error = _check_head(document)
        if error:
            diagnostics += [*document.diagnostics, error]
            continue
        kind, name = document.data["kind"], document.data["id"]
        if (kind, name) in index:
            message = f"{kind} '{name}' is already declared in {index[kind, name].path}"
            diagnostics.append(document.build_diagnostic(("id",), message, hint="change one id"))
        else:
            index[kind, name] = document
    return index


def _check_head(document: SourceDocument) -> Diagnostic | None:
    """Check `kind`, `id` and `version`, without which a document cannot be validated."""
    if not isinstance(document.data, dict):
        message = "is not a declaration, which is a mapping with `kind` and `id`"
        hint = "begin with `kind: weather`, or another kind"
        return document.build_diagnostic((), message, hint=hint)
    kind, name = document.data.get("kind"), document.data.get("id")
    if kind is None:
        hint = f"add it, one of: {', '.join(DECLARATIONS)}"
        return document.build_diagnostic((), "the field 'kind' is missing", hint=hint)
    if not isinstance(kind, str) or kind not in DECLARATIONS:
        message = f"{format_value(kind)} is not a kind of declaration"
        hint = suggest_name(str(kind), DECLARATIONS)
        return document.build_diagnostic(("kind",), message, hint=hint)
    if "id" not in document.data:
        message, hint = "the field 'id' is missing", "add it, `id: my_name`"
        return document.build_diagnostic((), message, hint=hint)
    if not isinstance(name, str):
        message = f"{format_value(name)} is not an id"
        return document.build_diagnostic(("id",), message, hint=ID_HINT)
    return _check_language_version(document)


def _check_language_version(document: SourceDocument) -> Diagnostic | None:
    """Check the version first, since another version explains all other errors."""
    version = document.data.get("version", LANGUAGE_VERSION)
    is_number = isinstance(version, int) and not isinstance(version, bool)
    if is_number and version == LANGUAGE_VERSION:
        return None
    if is_number and version > LANGUAGE_VERSION:
        message = f"is written in version {version}; this advercity reads {LANGUAGE_VERSION}"
        return document.build_diagnostic(("version",), message, hint="upgrade advercity")
    message = f"unknown version {format_value(version)}"
    hint = f"write {LANGUAGE_VERSION}, or remove it"
    return document.build_diagnostic(("version",), message, hint=hint)


def _build_entries(name: DeclarationKey, documents: Documents) -> list[LibraryEntry[Declaration]]:
    """Build the entry of a document; a road with agents at several junctions has one for each."""
    source = resolve_extends(name, documents)
    model = DECLARATIONS[name[0]]
    if model is Weather:
        return [_build_weather_entry(source)]
    if model is Rig:
        source = apply_calibrations(apply_lidar_models(source, documents))
    declaration = validate_model(model, source, previous=source.document.diagnostics)
    if isinstance(declaration, Road):
        roads, left_out = _complete_road(declaration, source)
        return [
            replace(_build_plain_entry(road, source), left_out=left_out, elsewhere=tuple(elsewhere))
            for road, *elsewhere in roads
        ]
    if isinstance(declaration, Catalogue):
        declaration = _add_model_checksums(declaration, source)
    return [_build_plain_entry(declaration, source)]


def _build_plain_entry(
    declaration: Declaration, source: ResolvedDeclaration
) -> LibraryEntry[Declaration]:
    digest = compute_json_digest(declaration.model_dump(mode="json"))
    return LibraryEntry(declaration, source, digest)


def _complete_road(
    road: Road, source: ResolvedDeclaration
) -> tuple[list[list[Road]], dict[str, str]]:
    """Import the map of a road, place its agents and find their routes."""
    mapped: tuple[Surrounding, ...] = ()
    if isinstance(road.imported, MapFile):
        road, mapped = _import_map(road, road.imported, source)
    if isinstance(road.trajectories, TrajectoryFile):
        road = _load_trajectories(road, road.trajectories, source)
    try:
        grown = grow_surroundings(road, mapped)
        placed, left_out = place_agents(grown)
        return [[complete_routes(item) for item in places] for places in placed], left_out
    except MisplacedPartError as error:
        raise DiagnosticsError(source.build_diagnostic(error.value_path, str(error))) from None


def _build_weather_entry(source: ResolvedDeclaration) -> LibraryEntry[Declaration]:
    weather, distributions = build_typical_weather(source)
    data: Any = weather.model_dump(mode="json")
    if distributions:
        # Different distributions may have the same typical values.
        data = [data, [[path, item.model_dump()] for path, item in distributions.items()]]
    return LibraryEntry(weather, source, compute_json_digest(data), distributions)


def _import_map(
    road: Road, declared: MapFile, source: ResolvedDeclaration
) -> tuple[Road, tuple[Surrounding, ...]]:
    value_path = ("imported", "file")
    folder = source.find_document(value_path).path.parent
    try:
        imported = place_imported_road(road, import_map(declared, road, folder))
        return imported, read_surroundings(declared, imported, folder)
    except InputError as error:
        raise DiagnosticsError(source.build_diagnostic(value_path, str(error))) from error


def _load_trajectories(road: Road, declared: TrajectoryFile, source: ResolvedDeclaration) -> Road:
    """Load the table of a road, and check that its vehicles follow tracks all the time."""
    value_path = ("trajectories", "file")
    folder = source.find_document(value_path).path.parent
    try:
        imported = road.imported
        origin_m = imported.offset_m if isinstance(imported, MapNetwork) else (0.0, 0.0)
        recorded, tracks = load_trajectories(declared, folder, origin_m)
    except DiagnosticsError:
        raise
    except InputError as error:
        raise DiagnosticsError(source.build_diagnostic(value_path, str(error))) from error
    problems: list[Diagnostic] = []
    followed: dict[str, str] = {}
    for name, agent in road.agents.items():
        if not isinstance(agent, Vehicle) or agent.track is None:
            continue
        at, track = ("agents", name, "track"), tracks.get(agent.track)
        if track is None:
            message, hint = f"unknown track '{agent.track}'", suggest_name(agent.track, tracks)
            problems.append(source.build_diagnostic(at, message, hint=hint))
        elif agent.track in followed:
            message = f"'{followed[agent.track]}' follows track '{agent.track}', too"
            problems.append(source.build_diagnostic(at, message, hint="give each its own"))
        elif not track.covers(declared.from_s, declared.to_s):
            message = (
                f"track '{agent.track}' was recorded from {track.times_s[0]:g} to"
                f" {track.times_s[-1]:g} s, not from {declared.from_s:g} to {declared.to_s:g} s"
            )
            hint = "narrow from_s and to_s, or choose another track"
            problems.append(source.build_diagnostic(at, message, hint=hint))
        followed.setdefault(agent.track, name)
    if problems:
        raise DiagnosticsError(*problems)
    return road.model_copy(update={"trajectories": recorded})


def _add_model_checksums(catalogue: Catalogue, source: ResolvedDeclaration) -> Catalogue:
    """Add the SHA-256 of each GLB file, by which a spec knows it."""
    blueprints = {
        name: _add_model_checksum(name, blueprint, source)
        for name, blueprint in catalogue.blueprints.items()
    }
    return catalogue.model_copy(update={"blueprints": blueprints})


def find_model_file(name: str, file: str, source: ResolvedDeclaration) -> Path:
    """Return the GLB `file` of a blueprint, next to the declaration of the model."""
    return source.find_document(("blueprints", name, "model", "file")).path.parent / file


def _add_model_checksum(name: str, blueprint: Blueprint, source: ResolvedDeclaration) -> Blueprint:
    model = blueprint.model
    if model is None or model.file is None:
        return blueprint
    value_path = ("blueprints", name, "model", "file")
    path = find_model_file(name, model.file, source)
    try:
        content = read_bytes(path, max_bytes=MAX_MODEL_BYTES)
    except DiagnosticsError as error:
        message = f"'{model.file}' {error.diagnostics[0].message}"
        raise DiagnosticsError(source.build_diagnostic(value_path, message)) from error
    except OSError as error:
        message = f"'{model.file}' cannot be read: {describe_cause(error)}"
        hint = "put the model's file next to the declaration"
        raise DiagnosticsError(source.build_diagnostic(value_path, message, hint=hint)) from error
    # Checked here, since a wrong file would otherwise fail only when its body is built.
    if not content.startswith(GLB_MAGIC):
        message, hint = f"'{model.file}' is not a GLB file", "export the model as binary glTF"
        raise DiagnosticsError(source.build_diagnostic(value_path, message, hint=hint))
    digest = hashlib.sha256(content).hexdigest()
    return blueprint.model_copy(update={"model": model.model_copy(update={"sha256": digest})})
