"""The command that shows how an agent learns: the run it shows, and how it is played."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.backend_bases import FigureCanvasBase, KeyEvent, TimerBase
from rich.console import Console

from benchmark.__main__ import main
from benchmark.commands import watch
from benchmark.drawing.film import Film, Moment, Screen
from benchmark.execution.store import Store
from benchmark.experiments import all_specifications, load_experiment
from envs import InputError
from envs.scenario import SCENARIO_DIRECTORY

COMPARED = load_experiment("compare_deep")


def test_the_run_is_that_of_the_experiment_and_is_stored(film: Film, watched: Path) -> None:
    with Store(watched / "runs.db", read_only=True) as store:
        (record,) = store.get(list(store.ended()))
        again = watch.load_film(watch.specification(COMPARED, "S1", "q_learning", "index", 0), store)
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
    assert not {"Walls", "Hallway"} & {*COMPARED.scenarios}
    for scenario, name, n_rows in (("Walls", "Walls", 10), ("Hallway.toml", "Hallway", 20)):
        assert main(["watch", "--terminal", "--scenario", scenario]) == 0
        shown = capsys.readouterr()
        assert shown.err == f"training {name}: paper's Q-learning table, seed 0 ...\n"
        assert shown.out.count("@ agent") == 26
        run = watch.specification(COMPARED, scenario, "q_learning", None, 0)
        assert run.scenario.grid.rows == n_rows
        with Store(Path("results") / "runs.db", read_only=True) as store:
            assert run.digest in store.ended()


def test_moments_walk_cell_by_cell_at_every_map(film: Film) -> None:
    shown = list(watch.moments(film))
    assert [moment.index for moment in shown] == sorted(moment.index for moment in shown)
    assert {moment.index for moment in shown} == set(range(26))
    last = [moment for moment in shown if moment.index == 25]
    assert [len(moment.cells) for moment in last[:11]] == list(range(1, 12))
    assert all(last[i].cells == last[-1].cells[: i + 1] for i in range(11))
    assert {moment.ending for moment in last[:11]} == {""}
    assert last[-1].ending == "target_ping"


def test_terminal_plays_every_moment(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    short = replace(film, steps=film.steps[:2])
    watch.in_terminal(short, Console(file=StringIO(), force_terminal=True, width=80))
    assert len(slept) == len(list(watch.moments(short)))


def test_window_plays_pauses_and_goes_through_training(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[int, int]] = []
    timers: list[TimerBase] = []

    def note(_: Screen, moments: Sequence[Moment]) -> None:
        shown.extend((moment.index, len(moment.cells)) for moment in moments)

    def new_timer(_: FigureCanvasBase, *arguments: Any) -> TimerBase:
        timers.append(TimerBase(*arguments))
        return timers[-1]

    def use() -> None:
        (timer,), canvas = timers, plt.gcf().canvas
        ((play, _, _),) = timer.callbacks
        for key in ("", "", " ", "", "right", "", "right", "right", "left", " ", ""):
            if key:
                canvas.callbacks.process("key_press_event", KeyEvent("key_press_event", canvas, key))
            else:
                play()

    monkeypatch.setattr(Screen, "show", note)
    monkeypatch.setattr(FigureCanvasBase, "new_timer", new_timer)
    monkeypatch.setattr(plt, "show", use)
    watch.in_window(film)
    plt.close("all")
    assert shown[1:] == [(0, 1), (0, 2), (0, 3), (1, 1), (2, 1), (3, 1), (2, 1), (2, 2)]


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


def test_no_terminal_gets_the_end_of_every_walk(watched: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--scenario", "S1", "--algorithm", "q_learning", "--results", str(watched)]
    assert main(["watch", "--terminal", *arguments]) == 0
    text = capsys.readouterr().out
    assert "step 10,000, score 1.00  success" in text
    assert text.count("@ agent") == 26
    assert "\x1b" not in text


@pytest.mark.parametrize("experiment", ["when_smoke", "tuning_smoke"])
def test_curves_alone_cannot_be_watched(experiment: str) -> None:
    with pytest.raises(InputError, match="its runs cannot be watched"):
        watch.specification(load_experiment(experiment), "Anywhere", "dqn", None, 0)
