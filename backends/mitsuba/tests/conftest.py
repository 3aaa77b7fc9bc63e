"""Skips the tests of pictures without Mitsuba, or without a device for its kernels."""

import pytest
from advercity_mitsuba import MitsubaBackend

from advercity.errors import BackendError


@pytest.fixture(scope="session")
def backend() -> MitsubaBackend:
    """The backend of this machine."""
    pytest.importorskip(
        "mitsuba", reason="Mitsuba renders nothing; `make setup MITSUBA=1` installs it"
    )
    found = MitsubaBackend()
    try:
        found.capabilities()
    except BackendError as error:
        pytest.skip(str(error))
    return found
