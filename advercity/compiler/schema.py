"""JSON Schemas of what people write, for editors that complete and check YAML."""

import json
from pathlib import Path

from advercity_dsl import DECLARATIONS, Model, Spec

from advercity.compiler.problems import nearest
from advercity.errors import InputError

KINDS: dict[str, type[Model]] = {**DECLARATIONS, "spec": Spec}


def schema_of(kind: str) -> str:
    """JSON Schema of a kind of declaration, or of the spec; InputError if there is no such kind."""
    if kind not in KINDS:
        raise InputError(f"there is no kind '{kind}'; {nearest(kind, KINDS)}")
    return json.dumps(KINDS[kind].model_json_schema(), indent=2)


def write_schemas(folder: Path) -> None:
    """Write `<kind>.schema.json` for every kind."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for kind in KINDS:
            (folder / f"{kind}.schema.json").write_text(schema_of(kind) + "\n")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {error.strerror}") from error
