"""Files to start from: one commented declaration of each kind, which compiles as it is."""

import re
from importlib.resources import files
from pathlib import Path

from advercity_dsl import DECLARATIONS

from advercity.compiler.problems import nearest
from advercity.compiler.schema import write_schema
from advercity.compiler.validation import ID_HINT
from advercity.errors import InputError

SCHEMAS = ".advercity"
"""Folder beside a new declaration with the schema that its first line names."""


def starter(kind: str, name: str) -> str:
    """Text of a declaration of `kind` called `name`; its first line tells editors its schema.

    Raises:
        InputError: There is no such kind, or the name is no id.
    """
    if kind not in DECLARATIONS:
        raise InputError(f"there is no kind '{kind}'; {nearest(kind, DECLARATIONS)}")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,63}", name):
        raise InputError(f"'{name}' is not an id; {ID_HINT}")
    text = (files("advercity") / "compiler" / "starters" / f"{kind}.yaml").read_text("utf-8")
    modeline = f"# yaml-language-server: $schema={SCHEMAS}/{kind}.schema.json\n"
    return modeline + text.replace("{id}", name)


def write_starter(kind: str, name: str, folder: Path) -> Path:
    """Write a new declaration and, in a folder beside it, its schema; nothing is overwritten.

    Raises:
        InputError: The kind or name is wrong, or the file is there already.
    """
    text = starter(kind, name)
    path = folder / f"{name}.yaml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    write_schema(kind, folder / SCHEMAS)
    return path
