"""Files to start from: one commented declaration of each kind, which compiles as it is."""

import os
import re
from importlib.resources import files
from pathlib import Path

from advercity_dsl import DECLARATIONS

from advercity.compiler.problems import nearest
from advercity.compiler.schema import write_schema
from advercity.compiler.wording import ID_HINT
from advercity.errors import InputError

SCHEMAS = ".advercity"
"""Folder of a library with the schemas that the first lines of its files name."""


def starter(kind: str, name: str, *, schemas: str = SCHEMAS) -> str:
    """Text of a declaration of `kind` called `name`; its first line tells editors its schema.

    Args:
        kind: Of the declaration.
        name: Its id.
        schemas: Folder of schemas, relative to the file.

    Raises:
        InputError: There is no such kind, or the name is no id.
    """
    if kind not in DECLARATIONS:
        raise InputError(f"there is no kind '{kind}'; {nearest(kind, DECLARATIONS)}")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,63}", name):
        raise InputError(f"'{name}' is not an id; {ID_HINT}")
    text = (files("advercity") / "compiler" / "starters" / f"{kind}.yaml").read_text("utf-8")
    modeline = f"# yaml-language-server: $schema={schemas}/{kind}.schema.json\n"
    return modeline + text.replace("{id}", name)


def write_starter(kind: str, name: str, folder: Path) -> Path:
    """Write a new declaration, and its schema for editors; no declaration is overwritten.

    The schema goes into the library's folder of schemas, or into a new one beside the file.

    Raises:
        InputError: The kind or name is wrong, or the file is there already.
    """
    schemas = _schemas_of(folder)
    text = starter(kind, name, schemas=Path(os.path.relpath(schemas, folder.resolve())).as_posix())
    path = folder / f"{name}.yaml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    write_schema(kind, schemas)
    return path


def _schemas_of(folder: Path) -> Path:
    """The nearest folder of schemas in or above a folder; in it if there is none."""
    inside = folder.resolve()
    around = (inside, *inside.parents)
    found = (parent / SCHEMAS for parent in around if (parent / SCHEMAS).is_dir())
    return next(found, inside / SCHEMAS)
