"""Files of a dataset that are missing, or not as they were written."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import yaml

from advercity.errors import InputError

REMEDY = "`advercity verify` tells more, `advercity repair` makes it again"


def no_frames(path: Path) -> InputError:
    """What to raise where a scenario, or a whole dataset, has no frames yet."""
    return InputError(f"{path}: no frames here yet; `advercity run` with its spec makes them")


@contextmanager
def damage_told(path: Path) -> Generator[None]:
    """Turn whatever a file leads to that is not as it was written into an InputError about it."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path}: is missing; {REMEDY}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (AttributeError, LookupError, TypeError, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: is damaged; {REMEDY}") from error
