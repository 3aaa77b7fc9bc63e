"""The package's collections of models (`.sh3f` archives): what is in them, whose, on what terms."""

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl.catalogue import BodyModel, FreeLicence

from advercity.errors import RunError

LICENCES: dict[str, FreeLicence] = {
    "CC0": "CC0-1.0",
    "CC-BY-3.0": "CC-BY-3.0",
    "CC-BY-3.0-USA": "CC-BY-3.0-US",
}
"""Free ones, by their names in the package's copyright file."""
CATALOGUE = "PluginFurnitureCatalog.properties"


@dataclass(frozen=True)
class Source:
    """A model as the package has it.

    Attributes:
        obj: Its Wavefront text.
        files: What the text may refer to, by name: materials and textures.
        author: As the collection's catalogue names them.
        licence: Of the collection.
    """

    obj: bytes
    files: dict[str, bytes]
    author: str
    licence: FreeLicence


def source_of(package: Path, model: str) -> Source:
    """A model, `collection/model`, of the unpacked package.

    Raises:
        RunError: There is none, or its collection is not free.
    """
    for archive in sorted(package.glob("*.sh3f")):
        with zipfile.ZipFile(archive) as files:
            folder = f"{model}/"
            inside = [name for name in files.namelist() if name.startswith(folder)]
            wanted = next((name for name in inside if name.endswith(".obj")), None)
            if wanted is not None:
                return Source(
                    obj=files.read(wanted),
                    files={
                        name.removeprefix(folder): files.read(name)
                        for name in inside
                        if name.lower().endswith((".mtl", ".jpg", ".jpeg", ".png"))
                    },
                    author=_creator(files.read(CATALOGUE).decode("latin-1"), wanted),
                    licence=_licence(package / "copyright", archive.stem),
                )
    raise RunError(f"the asset pack has no model '{model}'")


def check_terms(model: BodyModel, source: Source) -> None:
    """RunError if a declaration gives another author or licence than the package does."""
    said, true = (model.author, model.licence), (source.author, source.licence)
    if said != true:
        raise RunError(
            f"model '{model.pack}' is by {true[0]} under {true[1]}; the catalogue says"
            f" {said[0]} under {said[1]}"
        )


def _creator(catalogue: str, path: str) -> str:
    """Who made the model at a path, from the collection's own list."""
    number = re.search(rf"^model#(\d+)\s*=\s*/?{re.escape(path)}\s*$", catalogue, re.MULTILINE)
    if number is None:
        return "unknown"
    creator = re.search(rf"^creator#{number[1]}\s*=\s*(.+?)\s*$", catalogue, re.MULTILINE)
    return creator[1] if creator else "unknown"


def _licence(copyright_file: Path, collection: str) -> FreeLicence:
    text = copyright_file.read_text(encoding="utf-8", errors="replace")
    stanza = re.search(
        rf"^Files: {re.escape(collection)}/\*\n(?:.+\n)*?License: (\S+)", text, re.MULTILINE
    )
    named = stanza[1] if stanza else "no licence"
    if named not in LICENCES:
        raise RunError(f"the asset pack's collection {collection} is under {named}, not a free one")
    return LICENCES[named]
