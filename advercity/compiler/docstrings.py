"""What models say about their fields: the texts below them in the source."""

import ast
import inspect
import textwrap
from itertools import pairwise
from typing import Any, get_args

from advercity_dsl import Model


def described(model: type[Model]) -> dict[str, dict[str, str]]:
    """Texts of the fields, by written name, of a model and of all that it holds, by class name."""
    found: dict[str, dict[str, str]] = {}
    _collect(model, found)
    return found


def _collect(model: type[Model], found: dict[str, dict[str, str]]) -> None:
    if model.__name__ in found:
        return
    texts: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Model) and base is not Model:
            texts |= _texts(base)
    fields = model.model_fields.items()
    found[model.__name__] = {
        field.alias or name: texts[name] for name, field in fields if name in texts
    }
    for _, field in fields:
        for inner in models_in(field.annotation):
            _collect(inner, found)


def _texts(model: type[Model]) -> dict[str, str]:
    """Texts below the fields of one class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    texts: dict[str, str] = {}
    for line, below in pairwise(body):
        match line, below:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                texts[name] = inspect.cleandoc(text)
            case _:
                pass
    return texts


def models_in(annotation: Any) -> list[type[Model]]:
    """Every model in an annotation, those of lists and mappings too."""
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    return [found for part in get_args(annotation) for found in models_in(part)]
