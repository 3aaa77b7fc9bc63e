"""A backend that renders grey images, and before that fails as the files in $STUNTS name it.

The process that deletes such a file does the stunt. Processes write the GPUs that they see into the
folder `$SEEN`. `$MEET` is the folder of claims and a number: the first image waits until so many
frames are claimed.
"""

import ctypes
import errno
import os
import signal
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from advercity.frames import Frame
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import Capabilities, Renderer, RenderProfile
from advercity.testing import FakeBackend, FakeRenderer
from advercity.world import World

LONGEST_S = 120.0
"""Longest wait for other workers."""


class StuntRenderer(FakeRenderer):
    """Everything is grey and 10 m away."""

    def place(self, frame: Frame) -> None:
        """Wait for other workers, if asked."""
        until_s = time.monotonic() + LONGEST_S
        claims, _, number = os.environ.get("MEET", "").rpartition(":")
        while claims and sum(1 for _ in Path(claims).iterdir()) < int(number):
            assert time.monotonic() < until_s, "no other worker came"
            time.sleep(0.01)


class StuntBackend(FakeBackend):
    """Does a stunt when its capabilities are requested."""

    name = "stunts"

    def capabilities(self) -> Capabilities:
        """Do a stunt; return the capabilities."""
        _do_stunt()
        return super().capabilities()

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> Generator[Renderer]:
        """Open the grey renderer."""
        if "SEEN" in os.environ:
            cards = os.environ.get("CUDA_VISIBLE_DEVICES", "none")
            Path(os.environ["SEEN"], str(os.getpid())).write_text(cards)
        yield StuntRenderer()


def _do_stunt() -> None:
    for stunt in sorted(Path(os.environ["STUNTS"]).iterdir()):
        with suppress(FileNotFoundError):
            stunt.unlink()
            if stunt.suffix == ".crash":
                os.kill(os.getpid(), signal.SIGSEGV)
            elif stunt.suffix == ".hog":
                _hog()
            elif stunt.suffix == ".hang":
                _hang()
            elif stunt.suffix == ".memory":
                raise MemoryError
            elif stunt.suffix == ".disk":
                raise OSError(errno.ENOSPC, "No space left on device", "/somewhere")
            elif stunt.suffix == ".native":
                ctypes.PyDLL(None).sleep(600)  # no other thread of this interpreter runs meanwhile


def _hog() -> None:
    held: list[bytes] = []
    for _ in range(100):
        held.append(b"x" * 100_000_000)
        time.sleep(0.05)


def _hang() -> None:
    """Sleep until killed, after writing this process id next to the stunts folder."""
    Path(os.environ["STUNTS"]).with_suffix(".hanging").write_text(str(os.getpid()))
    time.sleep(600)
