"""The folder of a user's own data, apart from datasets: models, and the record of written files."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import platformdirs

from advercity.errors import InputError


@contextmanager
def report_missing_home() -> Generator[None]:
    """Raise InputError in place of the error for a user without a home, as in some containers."""
    try:
        yield
    except RuntimeError:
        message = "the user has no home folder; set HOME, or ADVERCITY_CACHE and ADVERCITY_DATA"
        raise InputError(message) from None


def find_data_folder() -> Path:
    """Find the user's data: `$ADVERCITY_DATA`, else the system's folder for user data.

    Raises:
        InputError: The user has no home folder.
    """
    chosen = os.environ.get("ADVERCITY_DATA")
    if chosen:
        return Path(chosen)
    with report_missing_home():
        return platformdirs.user_data_path("advercity", appauthor=False)
