"""Writes the reference of declarations, commands and the Python interface from the code itself.

The pages are made whenever the site is built, so they cannot be out of date.
"""

import inspect
from collections.abc import Iterator
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer
from advercity_dsl import Model
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

import advercity
import advercity.testing
from advercity.cli import app
from advercity.compiler.fields import (
    collect_field_docs,
    find_nested_models,
    find_number_constraints,
)
from advercity.compiler.schema import SCHEMA_MODELS

HEAD = "| field | meaning | unit and range | default |\n|---|---|---|---|"


PYTHON_HEAD = """\
# Python

You get the names of the first section with `import advercity`. The other sections have their
arguments and results.
[From Python](../guides/from_python.md) shows them at work.
"""
ERRORS = ("AdvercityError", "InputError", "RunError", "BackendError")
PYTHON_SECTIONS = {
    "advercity": [f"advercity.{name}" for name in advercity.__all__ if name != "__version__"],
    "Inputs and results of a run": [
        "advercity.pipeline.ScenarioResult",
        "advercity.pipeline.Progress",
        "advercity.pipeline.RunListener",
        "advercity.pipeline.ResourceLimits",
        "advercity.pipeline.ViewerTarget",
        "advercity.pipeline.preparation.TrafficResult",
        "advercity.frames.Trace",
        "advercity.frames.Frame",
        "advercity.frames.ActorState",
        "advercity.frames.Actor",
    ],
    "Reading a dataset": [
        "advercity.dataset.reader.Dataset",
        "advercity.dataset.reader.Scenario",
        "advercity.dataset.reader.FrameView",
        "advercity.dataset.agent_view.AgentView",
        "advercity.dataset.received_messages.ReceivedMessage",
        "advercity.sensors.messages.StationData",
    ],
    "Writing a backend": [
        "advercity.rendering.backend.Backend",
        "advercity.rendering.backend.Renderer",
        "advercity.rendering.backend.CameraView",
        "advercity.rendering.backend.CameraCapture",
        "advercity.rendering.backend.Capabilities",
    ],
    "advercity.testing": [f"advercity.testing.{name}" for name in advercity.testing.__all__],
    "advercity.errors": [f"advercity.errors.{name}" for name in ERRORS],
}


def write_reference(folder: Path) -> None:
    """Write `<kind>.md` for every kind of declaration, `commands.md` and `python.md`."""
    folder.mkdir(exist_ok=True)
    (folder / "python.md").write_text("\n".join([PYTHON_HEAD, *_python_sections()]) + "\n")
    for kind, model in SCHEMA_MODELS.items():
        (folder / f"{kind}.md").write_text(page_of(kind, model))
    (folder / "commands.md").write_text("\n\n".join(["# Commands", *_commands()]) + "\n")


def page_of(kind: str, model: type[Model]) -> str:
    """Return the page of a kind, with a table for each of its models."""
    parts = [f"# `{kind}`", _section(model)]
    parts += [f"## {inner.__name__}\n\n{_section(inner)}" for inner in _within(model)]
    return "\n\n".join(parts) + "\n"


def _section(model: type[Model]) -> str:
    texts = collect_field_docs(model)[model.__name__]
    rows = [_row(model, name, field, texts) for name, field in model.model_fields.items()]
    return "\n".join([inspect.cleandoc(model.__doc__ or ""), "", HEAD, *rows])


def _row(model: type[Model], name: str, field: FieldInfo, texts: dict[str, str]) -> str:
    written = field.alias or name
    inner = [
        f"[{item.__name__}](#{item.__name__.lower()})"
        for item in find_nested_models(field.annotation)
    ]
    text = " ".join(texts.get(written, "Kind of declaration." if name == "kind" else "").split())
    holds = f" {', '.join(dict.fromkeys(inner))}." if inner else ""
    cells = (f"`{written}`", f"{text}{holds}".strip(), _range(model, name), _default(field))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _range(model: type[Model], name: str) -> str:
    facts = find_number_constraints(model, (name,))
    if facts is None:
        return ", ".join(f"`{value}`" for value in _values(model.model_fields[name].annotation))
    unit = facts.unit.name if facts.unit and facts.unit.name != "1" else ""
    return facts.range_text or unit


def _values(annotation: Any) -> list[str]:
    """Return the allowed words, if a field has a few."""
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return [item.value for item in annotation]
    return list(get_args(annotation)) if get_origin(annotation) is Literal else []


def _default(field: FieldInfo) -> str:
    default: Any = field.get_default(call_default_factory=True)
    if field.is_required() or default is PydanticUndefined:
        return "required"
    if isinstance(default, Model) or default in ((), {}, ""):
        return ""
    return f"`{'null' if default is None else str(default).lower()}`"


def _within(model: type[Model]) -> Iterator[type[Model]]:
    """Every model below one, each once."""
    seen = {model: None}
    todo = [model]
    while todo:
        for field in todo.pop(0).model_fields.values():
            for inner in find_nested_models(field.annotation):
                if inner not in seen:
                    seen[inner] = None
                    todo.append(inner)
    yield from list(seen)[1:]


def _python_sections() -> Iterator[str]:
    for title, names in PYTHON_SECTIONS.items():
        directives = "\n".join(map(_directive, names))
        yield f"## {title}\n\n```{{eval-rst}}\n{directives}\n```\n"


def _directive(name: str) -> str:
    module, _, attribute = name.rpartition(".")
    kind = getattr(import_module(module), attribute)
    if not inspect.isclass(kind):
        return f".. autofunction:: {name}" if callable(kind) else f".. autodata:: {name}"
    # The fields of a spec are on pages of their own; pydantic's methods are not ours to list.
    members = "" if issubclass(kind, Model) else "\n   :members:"
    return f".. autoclass:: {name}{members}"


def _list_commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """List all commands by name, those of groups too: `import trajectories`."""
    for name, item in sorted(group.commands.items()):
        yield f"{before}{name}", item
        if hasattr(item, "commands"):
            yield from _list_commands(item, f"{before}{name} ")


def _commands() -> Iterator[str]:
    for name, item in _list_commands(typer.main.get_command(app)):
        context = typer.Context(item, info_name=f"advercity {name}")
        usage = item.get_usage(context).removeprefix("Usage: ")
        rows = [
            f"| `{' '.join(parameter.opts)}` | {getattr(parameter, 'help', None) or ''} |"
            for parameter in item.params
        ]
        table = ["| | |", "|---|---|", *rows] if rows else []
        yield "\n".join([f"## {name}", "", item.help or "", "", f"    {usage}", "", *table])
