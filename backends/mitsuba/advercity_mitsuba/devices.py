"""Finds a device for Mitsuba's kernels: a CUDA device, or a usable LLVM library.

Versions of LLVM before 16 lack an instruction of the kernels, and abort the process. So a child
process asks for the version of a library before this process loads it.
"""

import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from advercity.data_folder import find_data_folder
from advercity.errors import BackendError

LIBRARY_VARIABLE = "DRJIT_LIBLLVM_PATH"
"""Environment variable by which Mitsuba's compiler takes a library."""
LEAST_LLVM = 16
LIBRARY_PATTERNS = ("libLLVM*.so*", "libLLVM*.dylib", "LLVM-C*.dll")
SYSTEM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/lib/llvm-*/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
)
# LLVMGetVersion exists from version 16 on.
VERSION_SCRIPT = """
import ctypes, sys
numbers = [ctypes.c_uint() for _ in range(3)]
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(*map(ctypes.byref, numbers))
print(*(number.value for number in numbers), sep=".")
"""
VERSION_TIMEOUT_S = 60
INSTALL_HINT = (
    "run `make setup MITSUBA=1`, or install LLVM 16 or newer (Debian: libllvm19) or name its"
    f" library in {LIBRARY_VARIABLE}"
)


@dataclass(frozen=True)
class JitDevice:
    """A device for Mitsuba's kernels.

    Attributes:
        variant: Mitsuba's name of it.
        name: Name for users, part of a dataset's device class.
        is_hardware: Whether it is a graphics card.
    """

    variant: str
    name: str
    is_hardware: bool


@cache
def find_device() -> JitDevice:
    """Find the best device, and prepare this process to use it.

    Raises:
        BackendError: There is none; the text names packages to install.
    """
    missing: BackendError | None = None
    version = ""
    # Before CUDA is asked for: Dr.Jit loads any LLVM it finds as soon as it is imported.
    try:
        library, version = find_llvm()
        os.environ[LIBRARY_VARIABLE] = str(library)
    except BackendError as error:
        missing = error
    if _has_cuda():
        return JitDevice("cuda_ad_rgb", "Mitsuba cuda_ad_rgb", is_hardware=True)
    if missing is not None:
        raise missing
    return JitDevice("llvm_ad_rgb", f"Mitsuba llvm_ad_rgb, LLVM {version}", is_hardware=False)


def find_llvm() -> tuple[Path, str]:
    """Find a usable LLVM library and its version; BackendError if there is none."""
    chosen = os.environ.get(LIBRARY_VARIABLE)
    unusable: list[str] = []
    for library in [Path(chosen)] if chosen else _list_libraries(find_library_folders()):
        version = read_llvm_version(library)
        if version is not None:
            return library, version
        unusable.append(str(library))
    found = f"{', '.join(unusable)}: older than {LEAST_LLVM}" if unusable else "no LLVM library"
    raise BackendError(f"Mitsuba cannot compile its kernels ({found}); {INSTALL_HINT}")


def find_library_folders() -> list[Path]:
    """List folders of LLVM, ours first: the library fetched by the set-up is known to work."""
    own = find_data_folder() / "llvm"
    folders = [path for folder in SYSTEM_FOLDERS for path in sorted(Path("/").glob(folder[1:]))]
    return [own, *folders]


def _list_libraries(folders: Iterable[Path]) -> Iterator[Path]:
    """List libraries, each once, of each folder the newest first."""
    seen: set[Path] = set()
    for folder in folders:
        found = {path.resolve() for pattern in LIBRARY_PATTERNS for path in folder.glob(pattern)}
        for library in sorted(found - seen, key=_guess_version, reverse=True):
            seen.add(library)
            if _guess_version(library) >= LEAST_LLVM:
                yield library


def _guess_version(library: Path) -> int:
    """Read the major version in a library's name; of one without, it has to be asked."""
    numbers = re.findall(r"\d+", library.name)
    return int(numbers[0]) if numbers else LEAST_LLVM


def read_llvm_version(library: Path) -> str | None:
    """Ask a library for its version; None if it does not load or is older than 16."""
    try:
        child = subprocess.run(  # noqa: S603
            [sys.executable, "-c", VERSION_SCRIPT, str(library)],
            capture_output=True,
            text=True,
            timeout=VERSION_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    return child.stdout.strip() if child.returncode == 0 else None


def _has_cuda() -> bool:
    try:
        drjit: Any = import_module("drjit")
    except ImportError as error:
        hint = "try: pip install advercity[mitsuba]"
        raise BackendError(f"Mitsuba does not import ({error}); {hint}") from error
    return bool(drjit.has_backend(drjit.JitBackend.CUDA))
