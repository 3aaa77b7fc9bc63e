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
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from advercity.frames import Frame
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import (
    CameraCapture,
    CameraView,
    Capabilities,
    Renderer,
    RenderProfile,
)
from advercity.world import World

LONGEST_S = 120.0
"""Longest wait for other workers."""


class GreyRenderer:
    """Everything is grey and 10 m away."""

    def place(self, frame: Frame) -> None:
        """Wait for other workers, if asked."""
        until_s = time.monotonic() + LONGEST_S
        claims, _, number = os.environ.get("MEET", "").rpartition(":")
        while claims and sum(1 for _ in Path(claims).iterdir()) < int(number):
            assert time.monotonic() < until_s, "no other worker came"
            time.sleep(0.01)

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Return a grey image."""
        shape = (view.height_px, view.width_px)
        return CameraCapture(
            radiance=np.full((*shape, 3), 100.0, np.float32),
            depth=np.full(shape, 10.0, np.float32),
            normal=np.zeros((*shape, 3), np.float32),
            semantic=np.zeros(shape, np.uint8),
            instance=np.zeros(shape, np.int32),
        )

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Return grey images."""
        return map(self.render_camera, views)


class StuntBackend:
    """Does a stunt when its capabilities are requested."""

    name = "stunts"

    def capabilities(self) -> Capabilities:
        """Do a stunt; return the capabilities."""
        _do_stunt()
        return Capabilities(
            participating_medium=True,
            lamps=True,
            wet_surfaces=True,
            deterministic=True,
            ray_traced=False,
            hardware=False,
            device="grey",
        )

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> Generator[Renderer]:
        """Open the grey renderer."""
        if "SEEN" in os.environ:
            cards = os.environ.get("CUDA_VISIBLE_DEVICES", "none")
            Path(os.environ["SEEN"], str(os.getpid())).write_text(cards)
        yield GreyRenderer()


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
