"""The command that shows how an agent learns: the run it shows, and how it is played."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.backend_bases import FigureCanvasBase, TimerBase

from benchmark.__main__ import main
from benchmark.commands import find_run, watch
from benchmark.drawing.film import Film, Screen
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


def test_any_scenario_can_be_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A shipped one that the experiment does not declare, and a file in the current folder."""
    text = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    (tmp_path / "Hallway.toml").write_text(text.replace("rows = 10", "rows = 20"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(watch, "write", lambda *_: None)  # it takes seconds, and is tested with films
    assert not {"Walls", "Hallway"} & {*COMPARED.scenarios}
    for scenario, name, n_rows in (("Walls", "Walls", 10), ("Hallway.toml", "Hallway", 20)):
        assert main(["watch", "--scenario", scenario, "--save", "film.webp"]) == 0
        shown = capsys.readouterr()
        assert shown.err == f"training {name}: paper's Q-learning table, seed 0 ...\n"
        assert shown.out == f"{name}: paper's Q-learning table, seed 0: film.webp\n"
        run = find_run(COMPARED, "q_learning, index", "0", scenario, None)
        assert run.scenario.grid.rows == n_rows
        with Store(Path("results") / "runs.db", read_only=True) as store:
            assert run.digest in store.ended()


def test_window_plays_every_map_once(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[int] = []
    timers: list[TimerBase] = []

    def new_timer(_: FigureCanvasBase, **given: Any) -> TimerBase:
        timers.append(TimerBase(**given))
        return timers[-1]

    def watch_to_the_end() -> None:
        plt.gcf().canvas.draw()
        shown.clear()  # the first map is shown before the animation starts, too
        (timer,) = timers
        for _ in range(2 * len(film.steps)):
            for play, arguments, named in timer.callbacks[:]:
                if play(*arguments, **named) is False:  # as a timer does then
                    timer.callbacks.clear()

    monkeypatch.setattr(Screen, "show", lambda _, step: shown.append(step))
    monkeypatch.setattr(FigureCanvasBase, "new_timer", new_timer)
    monkeypatch.setattr(plt, "show", watch_to_the_end)
    watch.in_window(film)
    plt.close("all")
    assert shown == film.steps


def test_a_window_needs_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform == "linux":
        assert not watch.has_window()
        assert plt.get_backend().lower() == "agg"
    tried: list[str] = []

    def switch(backend: str) -> None:
        tried.append(backend)
        if backend != "tkagg":
            raise ImportError(backend)

    monkeypatch.setattr(plt, "switch_backend", switch)
    assert watch.has_window()
    assert tried[-1] == "tkagg"


def test_without_a_window_the_film_is_to_be_saved(
    monkeypatch: pytest.MonkeyPatch, watched: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(watch, "has_window", lambda: False)
    assert main(["watch", "--results", str(watched)]) == 2
    assert capsys.readouterr().err == "error: watch: no window can be opened here; accepted: --save FILE.\n"


@pytest.mark.parametrize("experiment", ["when_smoke", "tuning_smoke"])
def test_curves_alone_cannot_be_watched(experiment: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", "--experiment", experiment, "--save", "a.gif"]) == 2
    assert "its runs cannot be watched" in capsys.readouterr().err
