"""What tests of several rooms share."""

from pathlib import Path

import pytest

from benchmark.commands import find_run, watch
from benchmark.drawing.film import Film
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment

RUN = find_run(load_experiment("compare_deep"), "q_learning", "0", "S1", None)


@pytest.fixture(scope="session")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with one run, which was trained to be watched: a table in S1."""
    folder = tmp_path_factory.mktemp("watched")
    with Store(folder / "runs.db") as store:
        watch.load_film(RUN, store, "table")
    return folder


@pytest.fixture(scope="session")
def film(watched: Path) -> Film:
    """The film of that run."""
    with Store(watched / "runs.db", read_only=True) as store:
        return watch.load_film(RUN, store, "table")
