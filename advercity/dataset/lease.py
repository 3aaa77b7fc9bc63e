"""Keeps two runs from making one dataset in a store at a time.

Stores have no locks that end with their holder, and machines have clocks of their own. So whoever
holds a dataset keeps rewriting a file in it; who finds such a file watches it for a while, and
takes over if it stays as it is.
"""

import os
import platform
import time
import uuid
from threading import Event, Thread
from types import TracebackType
from typing import Self

from advercity.dataset.store import Store
from advercity.errors import RunError

LEASE = ".staging/lease"
PATIENCE_S = 20.0
"""How long a lease that nobody renews is respected."""


class Lease:
    """A dataset that is ours until the end; a context manager.

    Args:
        store: The dataset.
        patience_s: For one who has died to show no sign of life; it is renewed four times as often.
    """

    def __init__(self, store: Store, patience_s: float = PATIENCE_S) -> None:
        self._store, self._patience_s = store, patience_s
        self._holder = f"{platform.node()} process {os.getpid()} {uuid.uuid4().hex}"
        self._renewals = 0
        self._over = Event()
        self._lost = False
        self._keeper = Thread(target=self._keep, daemon=True)

    def __enter__(self) -> Self:
        """Take it; RunError if somebody else has it."""
        if not self._store.create(LEASE, self._text()):
            self._outlast()
        self._keeper.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._keeper.join()
        if not self._lost:
            self._store.remove(LEASE)

    def check(self) -> None:
        """RunError if the dataset may be somebody else's: run or store stood still for too long."""
        if self._lost:
            raise RunError(
                "the lease on the output ran out, and another run may have taken it over; run again"
                " when that is done"
            )

    def _outlast(self) -> None:
        """Take over from one who shows no sign of life."""
        found = self._store.read(LEASE)
        until_s = time.monotonic() + self._patience_s
        while time.monotonic() < until_s:
            time.sleep(self._patience_s / 20)
            if self._store.read(LEASE) != found:
                who = (found or b"somebody").decode().partition("\n")[0].rpartition(" ")[0]
                raise RunError(
                    f"another run is making this dataset ({who or 'somebody'}); wait for it or"
                    " choose another --output"
                )
        self._store.write(LEASE, self._text())
        time.sleep(self._patience_s / 20)
        if not self._is_ours():
            raise RunError("another run took the output at the same moment; wait for it")

    def _keep(self) -> None:
        """Renew it until the end; a store that is silent for too long has lost it for us."""
        renewed_s = time.monotonic()
        while not self._over.wait(self._patience_s / 4):
            try:
                if not self._is_ours():
                    break
                self._renewals += 1
                self._store.write(LEASE, self._text())
                renewed_s = time.monotonic()
            except RunError:
                if time.monotonic() - renewed_s > self._patience_s:
                    break
        else:
            return
        self._lost = True

    def _is_ours(self) -> bool:
        return (self._store.read(LEASE) or b"").startswith(self._holder.encode())

    def _text(self) -> bytes:
        return f"{self._holder}\n{self._renewals}\n".encode()
