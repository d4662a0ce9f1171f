"""Fixtures that several test files share."""

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real captures and exemplars, kept beside the checkout; tests that need them skip without."""
    if not DATA.is_dir():
        pytest.skip("no real data beside the checkout (../shared/data)")
    return DATA


@pytest.fixture(scope="session")
def shared_weights(shared_data: Path) -> Path:
    """Folder with pretrained weights."""
    folder = shared_data / "weights"
    if not folder.is_dir():
        pytest.skip("no pretrained weights beside the checkout (../shared/data/weights)")
    return folder
