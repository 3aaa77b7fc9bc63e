"""Hints that name what somebody may have meant."""

import difflib
from collections.abc import Iterable

SHOWN = 20


def nearest(name: str, valid: Iterable[str]) -> str:
    """A hint that names the nearest valid name, else all of them."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = ", ..." if len(names) > SHOWN else ""
    return f"there are: {', '.join(names[:SHOWN])}{more}" if names else "there are none"
