"""A library: a folder of declarations, loaded, with `extends` resolved, found by kind and id."""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from advercity_dsl import (
    DECLARATIONS,
    LANGUAGE_VERSION,
    Catalogue,
    Declaration,
    MapFile,
    Road,
    Weather,
    kind_of,
)

from advercity.compiler.distributions import Distributions, check_ends, distributions_in
from advercity.compiler.extension import Name, Resolved, resolve
from advercity.compiler.maps import network_of
from advercity.compiler.models import with_checksums
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Document, read
from advercity.compiler.validation import validate
from advercity.compiler.wording import ID_HINT, quoted
from advercity.errors import InputError

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
EXAMPLES = "examples"
"""Folder of declarations to copy from; no part of the library around it."""
MAX_FILES = 10_000


@dataclass(frozen=True)
class Entry(Generic[DeclarationT]):
    """A declaration and where it is written."""

    declaration: DeclarationT
    """Of a weather with distributions: with typical values in their place."""
    source: Resolved
    digest: str
    """SHA-256 of its data, `extends` merged in."""
    distributions: Distributions = field(default_factory=dict)


@dataclass(frozen=True)
class Library:
    """All declarations of a folder or several, by (kind, id)."""

    entries: Mapping[Name, Entry[Declaration]]

    def of(self, kind: type[DeclarationT]) -> dict[str, DeclarationT]:
        """Every declaration of a kind by id, in the order of ids."""
        return {
            name: entry.declaration
            for (_, name), entry in sorted(self.entries.items())
            if isinstance(entry.declaration, kind)
        }

    def entry(self, declaration: DeclarationT) -> Entry[DeclarationT]:
        """Of one of its declarations."""
        found = self.entries[kind_of(declaration), declaration.id]
        return cast(Entry[DeclarationT], found)

    def problem(
        self, declaration: Declaration, *where: str | int, message: str, hint: str = ""
    ) -> Problem:
        """A problem with a value of one of its declarations."""
        return self.entry(declaration).source.problem(where, message, hint=hint)


def load_library(*folders: Path) -> Library:
    """Read every `*.yaml` below the folders; one of them may be a file itself.

    Folders called `examples`, and those whose names begin with a dot, are left out.

    Raises:
        ProblemsError: With the problems of all files.
    """
    problems: list[Problem] = []
    files = [path for folder in folders for path in _files(folder, problems)]
    documents = list(_read_all(files, problems))
    return Library(_entries(documents, problems))


def load_beside(path: Path, library: Path) -> Entry[Declaration]:
    """The declaration in a file of its own; it may extend those beside it and those of a library.

    Raises:
        ProblemsError: With the problems of the file.
    """
    own = read(path)
    problems: list[Problem] = []
    heads = _by_kind_and_id([own], problems)
    if problems:
        raise ProblemsError(problems)
    (name,) = heads
    if isinstance(own.data, dict) and "extends" in own.data:
        beside = (other for other in sorted(path.parent.glob("*.yaml")) if other != path)
        for files in (beside, _files(library, problems)):
            documents = list(_read_all(files, problems))
            heads = _by_kind_and_id(documents, problems) | heads
    return _entry(name, heads)


def _files(folder: Path, problems: list[Problem]) -> list[Path]:
    if not folder.exists():
        raise InputError(f"{folder}: there is no such file or folder; is the path right?")
    if not folder.is_dir():
        return [folder]
    inside = sorted(path for path in _walk(folder, problems) if path.suffix in (".yaml", ".yml"))
    for path in inside:
        if path.suffix == ".yml":
            hint = f"call it {path.with_suffix('.yaml').name}"
            problems.append(Problem(path, 0, 0, "", "declarations end in .yaml", hint))
    files = [path for path in inside if path.suffix == ".yaml"]
    if not files and not problems:
        raise InputError(f"{folder}: no declarations (*.yaml) here; is it a library folder?")
    return files


def _walk(folder: Path, problems: list[Problem]) -> Iterator[Path]:
    """Files of a library; a folder that is far too large for one is refused, not read through."""

    def complain(error: OSError) -> None:
        message = f"cannot be read: {error.strerror}"
        problems.append(Problem(Path(error.filename), 0, 0, "", message))

    seen = 0
    for inside, folders, names in os.walk(folder, onerror=complain):
        folders[:] = sorted(name for name in folders if name != EXAMPLES and name[0] != ".")
        seen += len(folders) + len(names)
        if seen > MAX_FILES:
            message = f"holds more than {MAX_FILES} files and folders; is it a library folder?"
            raise InputError(f"{folder}: {message}")
        yield from (Path(inside, name) for name in names if name[0] != ".")


def _read_all(files: Iterable[Path], problems: list[Problem]) -> Iterator[Document]:
    for path in files:
        try:
            yield read(path)
        except ProblemsError as error:
            problems += error.problems


def _entries(documents: list[Document], problems: list[Problem]) -> dict[Name, Entry[Declaration]]:
    heads = _by_kind_and_id(documents, problems)
    entries: dict[Name, Entry[Declaration]] = {}
    for name in heads:
        try:
            entries[name] = _entry(name, heads)
        except ProblemsError as error:
            problems += error.problems
    if problems:
        raise ProblemsError(problems)
    return entries


def _by_kind_and_id(documents: list[Document], problems: list[Problem]) -> dict[Name, Document]:
    heads: dict[Name, Document] = {}
    for document in documents:
        problem = _head_problem(document)
        if problem:
            problems += [*document.problems, problem]
            continue
        name = (document.data["kind"], document.data["id"])
        if name in heads:
            message = f"{name[0]} '{name[1]}' is declared in {heads[name].path} already"
            problems.append(document.problem(("id",), message, hint="give one another id"))
        else:
            heads[name] = document
    return heads


def _head_problem(document: Document) -> Problem | None:
    if not isinstance(document.data, dict):
        message = "is no declaration, which is a mapping with `kind` and `id`"
        return document.problem((), message, hint="begin with `kind: weather`, or another kind")
    kind, name = document.data.get("kind"), document.data.get("id")
    if kind is None:
        hint = f"add it, one of: {', '.join(DECLARATIONS)}"
        return document.problem((), "the field 'kind' is missing", hint=hint)
    if not isinstance(kind, str) or kind not in DECLARATIONS:
        message, hint = (
            f"{quoted(kind)} is no kind of declaration",
            nearest(str(kind), DECLARATIONS),
        )
        return document.problem(("kind",), message, hint=hint)
    if "id" not in document.data:
        return document.problem((), "the field 'id' is missing", hint="add it, `id: my_name`")
    if not isinstance(name, str):
        return document.problem(("id",), f"{quoted(name)} is not an id", hint=ID_HINT)
    return _version_problem(document)


def _version_problem(document: Document) -> Problem | None:
    """Say what to do with a file in another version of the language, before what is strange."""
    version = document.data.get("version", LANGUAGE_VERSION)
    is_number = isinstance(version, int) and not isinstance(version, bool)
    if is_number and version == LANGUAGE_VERSION:
        return None
    if is_number and version > LANGUAGE_VERSION:
        message = f"is written in version {version}; this advercity reads {LANGUAGE_VERSION}"
        return document.problem(("version",), message, hint="upgrade advercity")
    hint = f"write {LANGUAGE_VERSION}, or leave it out"
    return document.problem(("version",), f"there was no version {quoted(version)}", hint=hint)


def _entry(name: Name, heads: Mapping[Name, Document]) -> Entry[Declaration]:
    source = resolve(name, heads)
    model = DECLARATIONS[name[0]]
    if model is not Weather:
        declaration = validate(model, source, known=source.document.problems)
        if isinstance(declaration, Road) and isinstance(declaration.imported, MapFile):
            declaration = _with_network(declaration, declaration.imported, source)
        if isinstance(declaration, Catalogue):
            declaration = with_checksums(declaration, source)
        return Entry(declaration, source, digest_of(declaration.model_dump(mode="json")))
    distributions = distributions_in(source)
    weather = check_ends(source, distributions)
    data: Any = weather.model_dump(mode="json")
    if distributions:
        data = [data, [[where, item.model_dump()] for where, item in distributions.items()]]
    return Entry(weather, source, digest_of(data), distributions)


def _with_network(road: Road, declared: MapFile, source: Resolved) -> Road:
    where = ("imported", "file")
    try:
        network = network_of(declared, road, source.document_of(where).path.parent)
    except InputError as error:
        raise ProblemsError.of(source.problem(where, str(error))) from error
    return road.model_copy(update={"imported": network})


def digest_of(data: Any) -> str:
    """SHA-256 of plain data in canonical JSON."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
