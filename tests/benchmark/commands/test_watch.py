"""The command that shows how an agent learns: the run it shows, and how it is played."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from benchmark.__main__ import main
from benchmark.commands import watch
from benchmark.drawing.film import Film, Moment, picture
from benchmark.execution.store import Store
from benchmark.experiments import all_specifications, load_experiment
from envs import InputError
from envs.render import Window

ROOT = Path(__file__).parents[3]
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


def test_moments_walk_cell_by_cell_at_every_map(film: Film) -> None:
    shown = list(watch.moments(film))
    assert [moment.place for moment in shown] == sorted(moment.place for moment in shown)
    assert {moment.place for moment in shown} == set(range(26))
    last = [moment for moment in shown if moment.place == 25]
    assert [len(moment.cells) for moment in last[:11]] == list(range(1, 12))
    assert all(last[i].cells == last[-1].cells[: i + 1] for i in range(11))
    assert {moment.ending for moment in last[:11]} == {""}
    assert last[-1].ending == "target_ping"


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_file_has_a_frame_per_map(film: Film, tmp_path: Path, name: str) -> None:
    watch.to_file(film, tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 26
        assert image.size == (421, 366)


def test_no_terminal_gets_the_end_of_every_walk(film: Film, tmp_path: Path) -> None:
    with (tmp_path / "out").open("w", encoding="utf-8") as file:
        watch.in_terminal(film, Console(file=file))
    text = (tmp_path / "out").read_text(encoding="utf-8")
    assert text.count("@ agent") == 26
    assert "\x1b" not in text


def test_terminal_plays_every_moment(film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    with (tmp_path / "out").open("w", encoding="utf-8") as file:
        watch.in_terminal(film, Console(file=file, force_terminal=True, width=80))
    assert len(slept) == len(list(watch.moments(film)))


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[list[str]]]:
    """Keys to be pressed: a list before each frame. Then the window is closed."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    script: list[list[str]] = []
    monkeypatch.setattr(Window, "pressed", lambda _: script.pop(0) if script else ["q"])
    yield script
    assert script == []


def test_window_plays_pauses_and_goes_through_training(
    film: Film, keys: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, int]] = []

    def noting(film: Film, moment: Moment, **options: Any) -> Image.Image:
        shown.append((moment.place, len(moment.cells)))
        return picture(film, moment, **options)

    monkeypatch.setattr(watch, "picture", noting)
    keys += [[], [], ["space"], [], ["right"], [], ["right", "right", "left"], ["space"], []]
    watch.in_window(film)
    assert shown[1:] == [(0, 1), (0, 2), (0, 3), (0, 3), (1, 1), (1, 1), (2, 1), (2, 1), (2, 2)]


def test_window_returns_the_keys_that_were_pressed(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window(np.zeros((40, 40, 3), dtype=np.uint8), "test")
    for key in (pygame.K_SPACE, pygame.K_RIGHT, pygame.K_ESCAPE):
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert window.pressed() == ["space", "right", "q", "q"]
    assert window.pressed() == []
    window.close()


def test_without_a_screen_there_is_no_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    assert not watch.has_window()
    monkeypatch.setenv("DISPLAY", ":0")
    assert watch.has_window()
    monkeypatch.setattr(watch, "find_spec", lambda _: None)
    assert not watch.has_window()


def test_window_that_nobody_sees_is_refused(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "offscreen")  # SDL's choice where there is no screen
    with pytest.raises(InputError, match="there is no screen"):
        watch.in_window(film)


def test_watch_command(watched: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", "watch", "--scenario", "S1", "--algorithm", "q_learning",
         "--results", str(watched)],
        cwd=ROOT, capture_output=True, text=True, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "step 10,000, score 1.00  success" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--scenario", "S9"], "compare_deep: unknown scenario S9; accepted: S1, S2, S3."),
        (["--algorithm", "dqm"], "unknown arm dqm (did you mean dqn?)"),
        (["--algorithm", "dqn", "--observation", "index"], "unknown observation index"),
        (["--seed", "-1"], "--seed -1: accepted: a whole number from 0 to 999,999."),
        (["--save", "film.mp4"], "--save film.mp4: accepted: a name that ends in .webp or .gif."),
    ],
)
def test_mistakes_get_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(["watch", "--results", str(tmp_path), *arguments]) == 2
    message = capsys.readouterr().err
    assert expected in message
    assert message.count("\n") == 1


def test_a_file_that_cannot_be_written_is_reported(film: Film, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--save .*film\.gif: cannot be written: "):
        watch.to_file(film, tmp_path / "nowhere" / "film.gif")
