import os
from pathlib import Path

from advercity.assets.model_store import open_model_store
from advercity.pipeline.cache import find_cache_folder


def test_tests_see_nothing_of_the_users_caches_and_models() -> None:
    home = Path(os.environ["ADVERCITY_TEST_HOME"])
    assert Path.home() == home
    assert find_cache_folder().is_relative_to(home)
    assert not open_model_store().has_package
