"""A comparison with real runs, which tests of the reports share: tables, nets and a check."""

from pathlib import Path
from typing import Final, NamedTuple

import pytest

from benchmark.execution.driver import run
from benchmark.execution.executors import Threads
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, all_specifications, load_experiment
from benchmark.publish import draw
from benchmark.studies import report_of

EXPERIMENT: Final = """
description = "Tables and nets in miniature."
scenarios = ["S1", "S3"]
horizon = 100
evaluation_every = 100
map_every = 200
evaluated_from = ["start", "every_cell"]
settings = { budget = 400, time_limit = 100 }

[report]
kind = "comparison"
baseline = ["table, index"]
contrasts = [["net, one_hot", "table, index"], ["sarsa, index", "table, index"]]

[algorithms]
table = { algorithm = "q_learning", observations = ["index"], seeds = 12, settings = { epsilon = 0.3 } }
sarsa = { algorithm = "sarsa", observations = ["index"], seeds = 12 }
check = { reference_for = "table", algorithm = "tests.agents.plain:Q_LEARNING", seeds = 2 }

[algorithms.ppo]
algorithm = "compiled_ppo"
observations = ["one_hot"]
seeds = 2
policy = "stochastic"
settings = { n_steps = 100, batch_size = 50, n_epochs = 1 }

[algorithms.net]
algorithm = "compiled_dqn"
observations = ["one_hot"]
seeds = 12
settings = { learning_starts = 50, batch_size = 8, policy_kwargs = { net_arch = [8] } }
"""


class Drawn(NamedTuple):
    """An experiment, the folder where its store is, and its folder of results."""

    experiment: Experiment
    results: Path
    folder: Path


def experiment_of(path: Path, text: str = EXPERIMENT) -> Experiment:
    """Loads an experiment from a text, which is written to a file."""
    path.write_text(text, encoding="utf-8")
    return load_experiment(path)


def trained(experiment: Experiment, store: Store) -> None:
    """Executes all runs in this process, which starts none."""
    assert run(all_specifications(experiment), store, 1, executor=Threads(1)) == []


def results_of(path: Path, text: str) -> Path:
    """Runs and draws an experiment of this text in a folder; returns its folder of results."""
    experiment = experiment_of(path / "mine.toml", text)
    with Store(path / "runs.db") as store:
        trained(experiment, store)
        draw.draw(report_of(experiment).check(), store, path / "mine")
    return path / "mine"


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """The comparison, with its runs and its folder of results."""
    results = tmp_path_factory.mktemp("drawn")
    experiment = experiment_of(results / "small.toml")
    with Store(results / "runs.db") as store:
        trained(experiment, store)
        draw.draw(report_of(experiment).check(), store, results / "small")
    return Drawn(experiment, results, results / "small")
