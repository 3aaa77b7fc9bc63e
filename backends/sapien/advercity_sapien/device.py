"""Which Vulkan device there is, asked in a child process.

Without a usable Vulkan driver SAPIEN may end the process instead of raising, hence the child.
"""

import re
import subprocess
import sys
from dataclasses import dataclass
from functools import cache

from advercity.errors import BackendError

PROBE = "import sapien; print(sapien.render.get_device_summary())"
DEVICE = re.compile(
    r"GPU: (?P<name>.+)\n\s*Supported: (?P<supported>\d+)\n.*\n"
    r"\s*cudaId:\s*(?P<cuda>-?\d+)\n\s*rayTrace:\s*(?P<ray_trace>\d+)"
)
WAY_OUT = (
    "run `make setup`, or install mesa-vulkan-drivers 25 or newer (Debian 12: from "
    "bookworm-backports), which renders on the CPU with ray tracing"
)


@dataclass(frozen=True)
class Device:
    """A Vulkan device that SAPIEN can render on."""

    name: str
    cuda: bool
    """Whether it is a CUDA GPU, else SAPIEN's device is `cpu`."""
    ray_traced: bool

    @property
    def is_software(self) -> bool:
        """Whether it is Mesa's CPU driver, whose pictures are the same bytes every time."""
        return "llvmpipe" in self.name


@cache
def probe() -> Device:
    """The best device; BackendError with the way out if there is none."""
    try:
        child = subprocess.run(  # noqa: S603
            [sys.executable, "-c", PROBE], capture_output=True, text=True, timeout=120, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise BackendError(f"SAPIEN found no answer from Vulkan in 120 s; {WAY_OUT}") from error
    devices = [
        Device(found["name"], cuda=int(found["cuda"]) >= 0, ray_traced=found["ray_trace"] == "1")
        for found in DEVICE.finditer(child.stdout)
        if found["supported"] == "1"
    ]
    if not devices:
        said = (child.stderr.strip() or child.stdout.strip()).splitlines()
        raise BackendError(
            f"SAPIEN finds no Vulkan device{f' ({said[-1]})' if said else ''}; {WAY_OUT}"
        )
    return max(devices, key=lambda device: (device.cuda, device.ray_traced))
