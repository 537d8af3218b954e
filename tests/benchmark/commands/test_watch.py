"""The command that makes a film of how an agent learns: the run that it shows."""

from pathlib import Path

import numpy as np
import pytest

from benchmark.__main__ import main
from benchmark.commands import find_run, watch
from benchmark.drawing.film import Film
from benchmark.execution.store import Store
from benchmark.experiments import all_specifications, load_experiment
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.conftest import RUN

COMPARED = load_experiment("compare_deep")


def test_the_run_is_that_of_the_experiment_and_is_stored(film: Film, watched: Path) -> None:
    with Store(watched / "runs.db", read_only=True) as store:
        (record,) = store.get(list(store.ended()))
        again = watch.load_film(RUN, store, "")
    assert record.digest == all_specifications(COMPARED, [0])[0].digest
    assert (again.values == film.values).all()
    assert np.abs(film.values[-1] - record.arrays["q"]).max() <= 0.0005 + 1e-7  # three decimals
    assert film.steps == list(range(0, 10_001, 400))
    assert film.scores[-1] == pytest.approx(1)


def test_a_scenario_of_the_current_folder_can_be_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    (tmp_path / "Hallway.toml").write_text(text.replace("rows = 10", "rows = 20"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(watch, "write", lambda *_: None)  # it takes seconds, and is tested with films
    assert main(["watch", "--scenario", "Hallway.toml", "--save", "film.webp"]) == 0
    assert capsys.readouterr().out == "Hallway: paper's Q-learning table, seed 0: film.webp\n"
    run = find_run(COMPARED, "q_learning, index", "0", "Hallway.toml", None)
    with Store(Path("results") / "runs.db", read_only=True) as store:
        assert run.digest in store.ended()


@pytest.mark.parametrize("experiment", ["groups", "tuning"])
def test_curves_alone_cannot_be_watched(experiment: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", "--experiment", experiment, "--save", "a.gif"]) == 2
    assert "its runs cannot be watched" in capsys.readouterr().err
