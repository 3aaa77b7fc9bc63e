"""Arguments and options shared by several commands, and parsers of their values."""

from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_origin

import typer

from advercity.errors import InputError
from advercity.run_options import OPTIONS, Option, RunOptions, parse_frames

if TYPE_CHECKING:
    from advercity_dsl import Spec

LibraryArgument = Annotated[
    list[Path] | None,
    typer.Argument(help="Folders of declarations (default: ./library, else the shipped one)."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
SpecArgument = Annotated[list[Path], typer.Argument(help="Compiled specs (*.json).")]
DatasetArgument = Annotated[Path, typer.Argument(help="A dataset, or one scenario of it.")]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        help="Layout of a foreign folder, without manifests: opv2v (also V2XSet and V2V4Real) or"
        " adver_city."
    ),
]
BackendOption = Annotated[str, typer.Option(help="Rendering backend.")]
WeatherLibraryOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--library", help="Folders of the library with the weather (default: the shipped one)."
    ),
]


def name_option(field: str, option: Option) -> str:
    """Return the flag of an option: `--max-time` for `max_time_s`."""
    return f"--{option.flag or field.replace('_', '-')}"


def describe_option(field: str) -> Any:
    """Describe a parameter of a command like the field of `RunOptions` of the same name."""
    _, option = OPTIONS[field]
    return typer.Option(name_option(field, option), metavar=option.metavar, help=option.text)


AllowMissedOption = Annotated[bool, describe_option("allow_missed")]
AllowMissingModelsOption = Annotated[bool, describe_option("allow_missing_models")]


def _find_typed_kind(kind: Any, option: Option) -> Any:
    """Find the type for typer; `RunOptions` checks choices, with its own messages."""
    if option.parse is not None:
        return str | None
    return str if get_origin(kind) is Literal else kind


def take_options(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command options of a run in place of its parameter `options`.

    Args:
        names: Fields of `RunOptions` (default: all).
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def call(**given: Any) -> None:
            values = {name: given.pop(name) for name in chosen}
            for name, (_, option) in chosen.items():
                if option.parse is not None:
                    text = values.pop(name)
                    values |= {} if text is None else {name: option.parse(text)}
            command(options=RunOptions(**values), **given)

        chosen = {name: OPTIONS[name] for name in names or OPTIONS}
        defaults = {item.name: item.default for item in fields(RunOptions)}
        parameters: list[Parameter] = []
        for own in signature(command).parameters.values():
            if own.name != "options":
                parameters.append(own.replace(kind=Parameter.KEYWORD_ONLY))
                continue
            parameters += [
                Parameter(
                    name,
                    Parameter.KEYWORD_ONLY,
                    default=None if defaults[name] is MISSING else defaults[name],
                    annotation=Annotated[_find_typed_kind(kind, option), describe_option(name)],
                )
                for name, (kind, option) in chosen.items()
            ]
        call.__signature__ = Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
        call.__annotations__ = {item.name: item.annotation for item in parameters}
        return call

    return decorate


def find_libraries(folders: list[Path] | None) -> list[Path]:
    """Return the given folders; else `library` in this folder, or the shipped one."""
    from advercity.compiler import find_shipped_library

    here = Path("library")
    return folders or [here if here.is_dir() else find_shipped_library()]


def load_specs(paths: list[Path], **changes: Any) -> "list[Spec]":
    """Load specs, with the changes of `api.load_spec`; InputError for folders, which are none."""
    from advercity.api import load_spec
    from advercity.output_files import is_dataset_or_scenario

    for path in paths:
        if path.is_dir() and is_dataset_or_scenario(path):
            raise InputError(
                f"{path}: is a dataset, not a spec; `advercity view`, `stats` and `export` read it"
            )
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name specs in it: {path / '*.json'}")
    return [load_spec(path, **changes) for path in paths]


def parse_frame_slice(text: str | None) -> slice:
    """Parse `A:B[:STEP]`, where A and B may be left out; None is every frame."""
    return slice(None) if text is None else parse_frames(text)
