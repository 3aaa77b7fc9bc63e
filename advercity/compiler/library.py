"""Models that a catalogue names by their files: the spec knows them by checksum.

A library: a folder of declarations, loaded, with `extends` resolved, found by kind and id.

Finds declarations that people name: in a file of theirs, or in the library that ships.
"""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from advercity_dsl import (
    DECLARATIONS,
    LANGUAGE_VERSION,
    Blueprint,
    Catalogue,
    Declaration,
    MapFile,
    Road,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.base import suggest_name

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.distributions import (
    Distributions,
    find_distributions,
    validate_distribution_bounds,
)
from advercity.compiler.extends import DeclarationKey, ResolvedDeclaration, resolve_extends
from advercity.compiler.source import SourceDocument, read_document
from advercity.compiler.validation import ID_HINT, format_value, validate_model
from advercity.digests import compute_json_digest
from advercity.errors import InputError
from advercity.roads.map_import import import_map

GLB_MAGIC = b"glTF"


def add_model_checksums(catalogue: Catalogue, source: ResolvedDeclaration) -> Catalogue:
    """The catalogue, each model file of its blueprints with its SHA-256.

    Raises:
        ProblemsError: A file is missing, or is no GLB.
    """
    blueprints = {
        name: _add_model_checksum(name, blueprint, source)
        for name, blueprint in catalogue.blueprints.items()
    }
    return catalogue.model_copy(update={"blueprints": blueprints})


def _add_model_checksum(name: str, blueprint: Blueprint, source: ResolvedDeclaration) -> Blueprint:
    model = blueprint.model
    if model is None or model.file is None:
        return blueprint
    where = ("blueprints", name, "model", "file")
    path: Path = source.find_document(where).path.parent / model.file
    try:
        content = path.read_bytes()
    except OSError as error:
        message = f"'{model.file}' cannot be read: {error.strerror}"
        hint = "a model's file lies beside the declaration"
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(where, message, hint=hint)
        ) from error
    if not content.startswith(GLB_MAGIC):
        message = f"'{model.file}' is not a GLB file"
        hint = "export the model as binary glTF"
        raise DiagnosticsError.from_diagnostic(source.build_diagnostic(where, message, hint=hint))
    digest = hashlib.sha256(content).hexdigest()
    known = model.model_copy(update={"sha256": digest})
    return blueprint.model_copy(update={"model": known})


DeclarationT = TypeVar("DeclarationT", bound=Declaration)
EXAMPLES_FOLDER = "examples"
"""Folder of declarations to copy from; no part of the library around it."""
MAX_FILES = 10_000


@dataclass(frozen=True)
class LibraryEntry(Generic[DeclarationT]):
    """A declaration and where it is written."""

    declaration: DeclarationT
    """Of a weather with distributions: with typical values in their place."""
    source: ResolvedDeclaration
    digest: str
    """SHA-256 of its data, `extends` merged in."""
    distributions: Distributions = field(default_factory=dict)


@dataclass(frozen=True)
class Library:
    """All declarations of a folder or several, by (kind, id)."""

    entries: Mapping[DeclarationKey, LibraryEntry[Declaration]]

    def get_declarations(self, kind: type[DeclarationT]) -> dict[str, DeclarationT]:
        """Every declaration of a kind by id, in the order of ids."""
        return {
            name: entry.declaration
            for (_, name), entry in sorted(self.entries.items())
            if isinstance(entry.declaration, kind)
        }

    def find_entry(self, declaration: DeclarationT) -> LibraryEntry[DeclarationT]:
        """Of one of its declarations."""
        found = self.entries[get_declaration_kind(declaration), declaration.id]
        return cast(LibraryEntry[DeclarationT], found)

    def build_diagnostic(
        self, declaration: Declaration, *where: str | int, message: str, hint: str = ""
    ) -> Diagnostic:
        """A problem with a value of one of its declarations."""
        return self.find_entry(declaration).source.build_diagnostic(where, message, hint=hint)


def load_library(*folders: Path) -> Library:
    """Read every `*.yaml` below the folders; one of them may be a file itself.

    Folders called `examples`, and those whose names begin with a dot, are left out.

    Raises:
        ProblemsError: With the problems of all files.
    """
    problems: list[Diagnostic] = []
    files = [path for folder in folders for path in _list_files(folder, problems)]
    documents = list(_read_documents(files, problems))
    return Library(_build_entries(documents, problems))


def load_declaration_file(path: Path, library: Path) -> LibraryEntry[Declaration]:
    """The declaration in a file of its own; it may extend those beside it and those of a library.

    Raises:
        ProblemsError: With the problems of the file.
    """
    own = read_document(path)
    problems: list[Diagnostic] = []
    heads = _index_documents([own], problems)
    if problems:
        raise DiagnosticsError(problems)
    (name,) = heads
    if isinstance(own.data, dict) and "extends" in own.data:
        beside = (other for other in sorted(path.parent.glob("*.yaml")) if other != path)
        for files in (beside, _list_files(library, problems)):
            documents = list(_read_documents(files, problems))
            heads = _index_documents(documents, problems) | heads
    return _build_entry(name, heads)


def _list_files(folder: Path, problems: list[Diagnostic]) -> list[Path]:
    if not folder.exists():
        raise InputError(f"{folder}: there is no such file or folder; is the path right?")
    if not folder.is_dir():
        return [folder]
    inside = sorted(
        path for path in _walk_folder(folder, problems) if path.suffix in (".yaml", ".yml")
    )
    for path in inside:
        if path.suffix == ".yml":
            hint = f"call it {path.with_suffix('.yaml').name}"
            problems.append(Diagnostic(path, 0, 0, "", "declarations end in .yaml", hint))
    files = [path for path in inside if path.suffix == ".yaml"]
    if not files and not problems:
        raise InputError(f"{folder}: no declarations (*.yaml) here; is it a library folder?")
    return files


def _walk_folder(folder: Path, problems: list[Diagnostic]) -> Iterator[Path]:
    """Files of a library; a folder that is far too large for one is refused, not read through."""

    def complain(error: OSError) -> None:
        message = f"cannot be read: {error.strerror}"
        problems.append(Diagnostic(Path(error.filename), 0, 0, "", message))

    seen = 0
    for inside, folders, names in os.walk(folder, onerror=complain):
        folders[:] = sorted(name for name in folders if name != EXAMPLES_FOLDER and name[0] != ".")
        seen += len(folders) + len(names)
        if seen > MAX_FILES:
            message = f"holds more than {MAX_FILES} files and folders; is it a library folder?"
            raise InputError(f"{folder}: {message}")
        yield from (Path(inside, name) for name in names if name[0] != ".")


def _read_documents(files: Iterable[Path], problems: list[Diagnostic]) -> Iterator[SourceDocument]:
    for path in files:
        try:
            yield read_document(path)
        except DiagnosticsError as error:
            problems += error.diagnostics


def _build_entries(
    documents: list[SourceDocument], problems: list[Diagnostic]
) -> dict[DeclarationKey, LibraryEntry[Declaration]]:
    heads = _index_documents(documents, problems)
    entries: dict[DeclarationKey, LibraryEntry[Declaration]] = {}
    for name in heads:
        try:
            entries[name] = _build_entry(name, heads)
        except DiagnosticsError as error:
            problems += error.diagnostics
    if problems:
        raise DiagnosticsError(problems)
    return entries


def _index_documents(
    documents: list[SourceDocument], problems: list[Diagnostic]
) -> dict[DeclarationKey, SourceDocument]:
    heads: dict[DeclarationKey, SourceDocument] = {}
    for document in documents:
        problem = _check_head(document)
        if problem:
            problems += [*document.diagnostics, problem]
            continue
        name = (document.data["kind"], document.data["id"])
        if name in heads:
            message = f"{name[0]} '{name[1]}' is declared in {heads[name].path} already"
            problems.append(document.build_diagnostic(("id",), message, hint="give one another id"))
        else:
            heads[name] = document
    return heads


def _check_head(document: SourceDocument) -> Diagnostic | None:
    if not isinstance(document.data, dict):
        message = "is no declaration, which is a mapping with `kind` and `id`"
        return document.build_diagnostic(
            (), message, hint="begin with `kind: weather`, or another kind"
        )
    kind, name = document.data.get("kind"), document.data.get("id")
    if kind is None:
        hint = f"add it, one of: {', '.join(DECLARATIONS)}"
        return document.build_diagnostic((), "the field 'kind' is missing", hint=hint)
    if not isinstance(kind, str) or kind not in DECLARATIONS:
        message, hint = (
            f"{format_value(kind)} is no kind of declaration",
            suggest_name(str(kind), DECLARATIONS),
        )
        return document.build_diagnostic(("kind",), message, hint=hint)
    if "id" not in document.data:
        return document.build_diagnostic(
            (), "the field 'id' is missing", hint="add it, `id: my_name`"
        )
    if not isinstance(name, str):
        return document.build_diagnostic(
            ("id",), f"{format_value(name)} is not an id", hint=ID_HINT
        )
    return _check_language_version(document)


def _check_language_version(document: SourceDocument) -> Diagnostic | None:
    """Say what to do with a file in another version of the language, before what is strange."""
    version = document.data.get("version", LANGUAGE_VERSION)
    is_number = isinstance(version, int) and not isinstance(version, bool)
    if is_number and version == LANGUAGE_VERSION:
        return None
    if is_number and version > LANGUAGE_VERSION:
        message = f"is written in version {version}; this advercity reads {LANGUAGE_VERSION}"
        return document.build_diagnostic(("version",), message, hint="upgrade advercity")
    hint = f"write {LANGUAGE_VERSION}, or leave it out"
    return document.build_diagnostic(
        ("version",), f"there was no version {format_value(version)}", hint=hint
    )


def _build_entry(
    name: DeclarationKey, heads: Mapping[DeclarationKey, SourceDocument]
) -> LibraryEntry[Declaration]:
    source = resolve_extends(name, heads)
    model = DECLARATIONS[name[0]]
    if model is not Weather:
        declaration = validate_model(model, source, known=source.document.diagnostics)
        if isinstance(declaration, Road) and isinstance(declaration.imported, MapFile):
            declaration = _import_network(declaration, declaration.imported, source)
        if isinstance(declaration, Catalogue):
            declaration = add_model_checksums(declaration, source)
        return LibraryEntry(
            declaration, source, compute_json_digest(declaration.model_dump(mode="json"))
        )
    distributions = find_distributions(source)
    weather = validate_distribution_bounds(source, distributions)
    data: Any = weather.model_dump(mode="json")
    if distributions:
        data = [data, [[where, item.model_dump()] for where, item in distributions.items()]]
    return LibraryEntry(weather, source, compute_json_digest(data), distributions)


def _import_network(road: Road, declared: MapFile, source: ResolvedDeclaration) -> Road:
    where = ("imported", "file")
    try:
        network = import_map(declared, road, source.find_document(where).path.parent)
    except InputError as error:
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(where, str(error))
        ) from error
    return road.model_copy(update={"imported": network})


def find_shipped_library() -> Path:
    """The library inside the installed package, or beside the source in a checkout."""
    source = Path(__file__).parents[2] / "library"
    return source if source.is_dir() else Path(str(files("advercity") / "_library"))


def load_declaration(path: Path) -> LibraryEntry[Declaration]:
    """The declaration in a file; it may extend those that ship."""
    return load_declaration_file(path, find_shipped_library())


def find_weather(text: str) -> LibraryEntry[Weather]:
    """The weather in the file `text`, or the shipped one with that name.

    A weather in a file of its own may extend those that ship.
    """
    path = Path(text)
    if path.suffix in (".yaml", ".yml") or path.exists():
        entry = load_declaration(path)
        if not isinstance(entry.declaration, Weather):
            problem = entry.source.build_diagnostic(
                ("kind",), "is no weather", hint="give a weather's file"
            )
            raise DiagnosticsError.from_diagnostic(problem)
        return cast(LibraryEntry[Weather], entry)
    library = load_library(find_shipped_library())
    weathers = library.get_declarations(Weather)
    if text not in weathers:
        hint = suggest_name(text, weathers)
        raise InputError(f"there is no weather '{text}', and no such file; {hint}")
    return library.find_entry(weathers[text])


def list_shipped_weathers() -> list[str]:
    """Names of the weathers that ship."""
    return list(load_library(find_shipped_library()).get_declarations(Weather))
