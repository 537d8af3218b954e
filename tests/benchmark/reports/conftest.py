"""What tests of the reports share."""

from pathlib import Path

import pytest

from tests.support import make


@pytest.fixture(scope="session")
def miniature(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with the comparison in miniature, as `make compare-deep` makes it."""
    folder = tmp_path_factory.mktemp("miniature")
    done = make("compare-deep", "EXPERIMENT=compare_deep_smoke", f"RESULTS={folder}")
    assert done.returncode == 0, done.stderr
    return folder
