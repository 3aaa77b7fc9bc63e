"""A cache for functions of frozen records, which have no hash where they hold dictionaries."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import Concatenate, Generic, ParamSpec, TypeVar

ArgumentsT = ParamSpec("ArgumentsT")
RecordT = TypeVar("RecordT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, eq=False)
class _Identity(Generic[RecordT]):
    """Equal only for the same object; it keeps the object, so its id stays unique."""

    record: RecordT

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Identity) and self.record is other.record

    def __hash__(self) -> int:
        return id(self.record)


def cache_by_identity(
    maxsize: int,
) -> Callable[
    [Callable[Concatenate[RecordT, ArgumentsT], ResultT]],
    Callable[Concatenate[RecordT, ArgumentsT], ResultT],
]:
    """Return a decorator to keep the `maxsize` last used results of a function of a record.

    Its other arguments must have a hash.
    """

    def decorate(
        function: Callable[Concatenate[RecordT, ArgumentsT], ResultT],
    ) -> Callable[Concatenate[RecordT, ArgumentsT], ResultT]:
        @lru_cache(maxsize)
        def compute(
            identity: _Identity[RecordT], *args: ArgumentsT.args, **kwargs: ArgumentsT.kwargs
        ) -> ResultT:
            return function(identity.record, *args, **kwargs)

        @wraps(function)
        def call(record: RecordT, *args: ArgumentsT.args, **kwargs: ArgumentsT.kwargs) -> ResultT:
            return compute(_Identity(record), *args, **kwargs)

        return call

    return decorate
