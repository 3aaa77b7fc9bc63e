"""The folder with what belongs to a user rather than to a dataset: models, and what was written."""

import os
from pathlib import Path

import platformdirs


def find_data_folder() -> Path:
    """Find the user's data: `$ADVERCITY_DATA`, else the system's folder for user data."""
    chosen = os.environ.get("ADVERCITY_DATA")
    return Path(chosen) if chosen else platformdirs.user_data_path("advercity", appauthor=False)
