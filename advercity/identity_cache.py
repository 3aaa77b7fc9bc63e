"""A cache for functions of frozen records, which have no hash where they hold dictionaries."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import Generic, TypeVar

RecordT = TypeVar("RecordT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, eq=False)
class _Identity(Generic[RecordT]):
    """Equal to that of the same object only; it keeps the object, so that its id is its own."""

    record: RecordT

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Identity) and self.record is other.record

    def __hash__(self) -> int:
        return id(self.record)


def cache_by_identity(
    maxsize: int,
) -> Callable[[Callable[[RecordT], ResultT]], Callable[[RecordT], ResultT]]:
    """Return a decorator that keeps a function's results of the `maxsize` last used records."""

    def decorate(function: Callable[[RecordT], ResultT]) -> Callable[[RecordT], ResultT]:
        @lru_cache(maxsize)
        def compute(identity: _Identity[RecordT]) -> ResultT:
            return function(identity.record)

        @wraps(function)
        def call(record: RecordT) -> ResultT:
            return compute(_Identity(record))

        return call

    return decorate
