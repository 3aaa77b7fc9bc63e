"""A library: a folder of declarations, loaded, with `extends` resolved, found by kind and id."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

from advercity_dsl import DECLARATIONS, Declaration, MapFile, Road, kind_of

from advercity.compiler.maps import network_of
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Document, read
from advercity.compiler.validation import validate
from advercity.errors import InputError

DeclarationT = TypeVar("DeclarationT", bound=Declaration)


@dataclass(frozen=True)
class Entry:
    """A declaration and the file it stands in."""

    declaration: Declaration
    document: Document
    digest: str
    """SHA-256 of its data, `extends` merged in."""


@dataclass(frozen=True)
class Library:
    """All declarations of a folder or several, by (kind, id)."""

    entries: Mapping[tuple[str, str], Entry]

    def of(self, kind: type[DeclarationT]) -> dict[str, DeclarationT]:
        """Every declaration of a kind by id, in the order of ids."""
        return {
            name: entry.declaration
            for (_, name), entry in sorted(self.entries.items())
            if isinstance(entry.declaration, kind)
        }

    def digest(self, declaration: Declaration) -> str:
        """Of one of its declarations."""
        return self.entries[kind_of(declaration), declaration.id].digest

    def problem(
        self, declaration: Declaration, *where: str | int, message: str, hint: str = ""
    ) -> Problem:
        """A problem with a value of one of its declarations."""
        document = self.entries[kind_of(declaration), declaration.id].document
        return document.problem(where, message, hint=hint)


def load_library(*folders: Path) -> Library:
    """Read every `*.yaml` below the folders; one of them may be a file itself.

    Raises:
        ProblemsError: With the problems of all files.
    """
    files: list[Path] = []
    for folder in folders:
        found = [folder] if folder.is_file() else sorted(folder.rglob("*.yaml"))
        if not found:
            raise InputError(f"{folder}: no declarations (*.yaml) here; is it a library folder?")
        files += found
    problems: list[Problem] = []
    documents = list(_read_all(files, problems))
    heads = _by_kind_and_id(documents, problems)
    entries: dict[tuple[str, str], Entry] = {}
    for name, document in heads.items():
        try:
            entries[name] = _entry(name, document, heads)
        except ProblemsError as error:
            problems += error.problems
    if problems:
        raise ProblemsError(problems)
    return Library(entries)


def load_declaration(path: Path, kind: type[DeclarationT]) -> DeclarationT:
    """One declaration of a known kind from a file of its own; `extends` has nothing to extend."""
    document = read(path)
    return validate(kind, document)


def _read_all(files: list[Path], problems: list[Problem]) -> Iterator[Document]:
    for path in files:
        try:
            yield read(path)
        except ProblemsError as error:
            problems += error.problems


def _by_kind_and_id(
    documents: list[Document], problems: list[Problem]
) -> dict[tuple[str, str], Document]:
    heads: dict[tuple[str, str], Document] = {}
    for document in documents:
        problem = _head_problem(document)
        if problem:
            problems.append(problem)
            continue
        name = (document.data["kind"], document.data["id"])
        if name in heads:
            other = heads[name].path
            problems.append(
                document.problem(("id",), f"{name[0]} '{name[1]}' is declared in {other} already")
            )
        else:
            heads[name] = document
    return heads


def _head_problem(document: Document) -> Problem | None:
    if not isinstance(document.data, dict):
        return document.problem((), "is not a declaration: a mapping with `kind` and `id`")
    kind, name = document.data.get("kind"), document.data.get("id")
    if kind not in DECLARATIONS:
        found = f"'{kind}' is no kind of declaration" if kind else "the field 'kind' is missing"
        return document.problem(("kind",), found, hint=nearest(str(kind), DECLARATIONS))
    if not isinstance(name, str):
        return document.problem(("id",), "the field 'id' is missing")
    return None


def _entry(
    name: tuple[str, str], document: Document, heads: Mapping[tuple[str, str], Document]
) -> Entry:
    data = _extended(name, document, heads, ())
    declaration = validate(DECLARATIONS[name[0]], document, data)
    if isinstance(declaration, Road) and isinstance(declaration.imported, MapFile):
        declaration = _with_network(declaration, declaration.imported, document)
    return Entry(declaration, document, digest_of(declaration.model_dump(mode="json")))


def _with_network(road: Road, declared: MapFile, document: Document) -> Road:
    try:
        network = network_of(declared, road, document.path.parent)
    except InputError as error:
        raise ProblemsError.of(document.problem(("imported", "file"), str(error))) from error
    return road.model_copy(update={"imported": network})


def _extended(
    name: tuple[str, str],
    document: Document,
    heads: Mapping[tuple[str, str], Document],
    below: tuple[str, ...],
) -> dict[str, Any]:
    """The document's data over that of what it extends: mappings merge, all else replaces."""
    own = dict(document.data)
    parent = own.pop("extends", None)
    if parent is None:
        return own
    chain = (*below, name[1])
    if parent in chain:
        cycle = " > ".join((*chain, parent))
        raise ProblemsError.of(document.problem(("extends",), f"goes in a circle: {cycle}"))
    key = (name[0], parent)
    if key not in heads:
        valid = [other for kind, other in heads if kind == name[0]]
        problem = document.problem(
            ("extends",), f"there is no {name[0]} '{parent}'", hint=nearest(str(parent), valid)
        )
        raise ProblemsError.of(problem)
    return _merged(_extended(key, heads[key], heads, chain), own)


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            result[key] = _merged(cast(dict[str, Any], old), cast(dict[str, Any], value))
        else:
            result[key] = value
    return result


def digest_of(data: Any) -> str:
    """SHA-256 of plain data in canonical JSON."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
