"""advercity: adverse-weather V2X driving data, compiled from YAML.

The names below are the Python interface. Each is imported at its first use: `import advercity`
itself costs nothing. `advercity.testing` has helpers for your own tests.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from advercity_dsl import Spec

    from advercity.api import RunResult, load_spec, run, run_batch, simulate
    from advercity.compiler import compile_library, write_specs
    from advercity.dataset.reader import open_dataset
    from advercity.run_options import RunOptions
    from advercity.sensors.camera import develop_raw

__version__ = "0.2.0"
__all__ = [
    "RunOptions",
    "RunResult",
    "Spec",
    "__version__",
    "compile_library",
    "develop_raw",
    "load_spec",
    "open_dataset",
    "run",
    "run_batch",
    "simulate",
    "write_specs",
]

_HOMES = {
    "RunOptions": "advercity.run_options",
    "RunResult": "advercity.api",
    "Spec": "advercity_dsl",
    "compile_library": "advercity.compiler",
    "develop_raw": "advercity.sensors.camera",
    "load_spec": "advercity.api",
    "open_dataset": "advercity.dataset.reader",
    "run": "advercity.api",
    "run_batch": "advercity.api",
    "simulate": "advercity.api",
    "write_specs": "advercity.compiler",
}


def __getattr__(name: str) -> object:
    """Import a public name from its module (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'advercity' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """List the public names, for completion in editors and notebooks."""
    return sorted(__all__)
