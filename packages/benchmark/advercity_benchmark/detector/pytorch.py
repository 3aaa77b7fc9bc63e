"""PyTorch, of the extra `benchmark`; the other modules of this package take it from here.

It has no types here: it is not installed where the types are checked.
"""

from importlib import import_module
from typing import Any

from advercity.errors import InputError

Tensor = Any
"""`torch.Tensor`."""


def _import_torch() -> Any:
    try:
        return import_module("torch")
    except ImportError as error:
        raise InputError(
            f"{error.name} is not installed; try: pip install 'advercity[benchmark]'"
        ) from error


torch: Any = _import_torch()
nn: Any = torch.nn
functional: Any = torch.nn.functional


def select_device(name: str) -> Any:
    """Select a device by name, as `cpu` and `cuda`; InputError if there is none."""
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (AssertionError, NotImplementedError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {name}: cannot be used: {reason}") from error
    return device
