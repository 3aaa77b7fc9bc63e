"""Gives the tests an empty home, so that they pass or fail whatever the user's holds.

Mesa's software driver compiles shaders without optimisation there: pictures are the same to the
bit, and most tests take too few of them to make up for what it costs.
"""

import os
import shutil
import signal
import tempfile

from advercity.assets.model_store import open_model_store
from advercity.data_folder import find_data_folder

TEST_HOME = "ADVERCITY_TEST_HOME"
TEST_MODELS = "ADVERCITY_TEST_MODELS"
"""The user's models, which only the test of the asset package looks at."""
USER_VARIABLES = (
    *("ADVERCITY_ASSETS", "ADVERCITY_CACHE", "ADVERCITY_DATA"),
    *("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"),
)


def move_home() -> bool:
    """Move to an empty home: without the user's models, records, traces and settings.

    Processes that this one starts, such as workers of pytest-xdist, inherit it and share its cache.

    Returns:
        Whether this process made it.
    """
    if TEST_HOME in os.environ:
        return False
    os.environ[TEST_MODELS] = str(open_model_store().folder)
    for library in sorted((find_data_folder() / "llvm").glob("libLLVM*")):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))
    os.environ[TEST_HOME] = os.environ["HOME"] = tempfile.mkdtemp(prefix="advercity_tests_")
    for name in USER_VARIABLES:
        os.environ.pop(name, None)
    os.environ["GALLIVM_PERF"] = "nopt"
    return True


HAS_MADE_HOME = move_home()
# What a shell starts in the background ignores interrupts, and so would all runs of the tests.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    """Delete the home; processes that have inherited it leave that to the one that made it."""
    if HAS_MADE_HOME:
        shutil.rmtree(os.environ.pop(TEST_HOME), ignore_errors=True)
