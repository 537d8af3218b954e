"""Moving pictures and what is shown while it runs, against the records and exact evaluation."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.commands import watch
from benchmark.drawing import film as animation
from benchmark.drawing.film import Film
from benchmark.execution.driver import plan
from benchmark.execution.progress import Display
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from envs import InputError
from envs.model import PING
from envs.render import Window

ROOT = Path(__file__).parents[2]
COMPARED = load_experiment("compare_deep")
SMOKE = load_experiment("compare_deep_smoke")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("watched")


@pytest.fixture(scope="module")
def film(folder: Path) -> Film:
    """A table in S1, trained by being watched."""
    with Store(folder / "runs.db") as store:
        return watch.load_film(watch.specification(COMPARED, "S1", "q_learning", None, 0), store)


def test_watched_run_is_the_run_of_the_experiment_and_is_kept(film: Film, folder: Path) -> None:
    with Store(folder / "runs.db") as store:
        record = store.get(list(store.ended()))[0]
        assert len(store.ended()) == 1
        again = watch.load_film(watch.specification(COMPARED, "S1", "q_learning", "index", 0), store)
    assert record.digest == all_specifications(COMPARED)[0].digest
    assert (again.values == film.values).all()
    assert (film.values[-1].astype(np.float32) == record.arrays["q"].astype(np.float32)).all()
    assert film.steps == list(range(0, 10_001, 400))
    assert film.scores[-1] == pytest.approx(1)


def test_walk_is_as_long_as_exact_evaluation_says(film: Film) -> None:
    way, event = animation.walk(film.model, film.greedy[-1])
    exact = evaluate(film.model, mask_policy(film.greedy[-1]), 200)
    assert exact.success == pytest.approx(1)
    assert event == "target_ping"
    assert way[0] == film.model.start
    assert len(way) - 1 == pytest.approx(float(exact.steps))
    assert way[-1] == way[-2]  # a PING does not move
    at_first, _ = animation.walk(film.model, film.greedy[0])
    assert len(at_first) <= 41


def test_moments_walk_cell_by_cell_at_every_map(film: Film) -> None:
    shown = list(watch.moments(film))
    assert {moment.place for moment in shown} == set(range(26))
    last = [moment for moment in shown if moment.place == 25]
    assert [len(moment.way) for moment in last[:11]] == list(range(1, 12))
    assert last[-1].event == "target_ping"


def pixel(image: Image.Image, row: int, column: int, down: float, right: float, cell: int = 30) -> Any:
    """Returns the colour beside a cell's centre; offsets are in cells."""
    y = int(1.5 * cell + (row + 0.5 + down) * cell)
    return image.getpixel((int((column + 0.5 + right) * cell), y))


@pytest.mark.parametrize(
    ("action", "down", "right"), [(0, -0.3, 0.1), (1, 0.3, 0.1), (2, 0.1, -0.3), (3, 0.1, 0.3)]
)
def test_picture_shows_the_values_where_the_moves_point(
    film: Film, action: int, down: float, right: float
) -> None:
    image = animation.picture(film, 25, [film.model.start], marks=False)
    low, high = film.limits
    for row, column in ((2, 3), (3, 8), (7, 2), (9, 6)):
        value = film.values[25, row * 12 + column, action]
        expected = np.array(mpl.colormaps["cividis"](np.clip((value - low) / (high - low), 0, 1))[:3]) * 255
        assert pixel(image, row, column, down, right) == pytest.approx(expected, abs=3)


def test_picture_shows_agent_issuer_and_the_dots_of_ping(film: Film) -> None:
    issuer = film.model.scenario.issuer.position
    image = animation.picture(film, 25, [0, 12, 3 * 12 + 4], marks=False)
    assert pixel(image, 3, 4, 0, 0) == (213, 94, 0)
    assert pixel(image, *issuer, 0, 0) == (255, 255, 255)
    only_ping = np.flatnonzero(film.greedy[25] == 1 << PING)
    others = np.flatnonzero(film.greedy[25] != 1 << PING)
    assert len(only_ping) > 2
    for o in only_ping:
        assert min(pixel(image, *divmod(int(o), 12), 0, 0)) > 230
    plain = [o for o in others if o not in (0, 12, 40, film.model.start) and divmod(int(o), 12) != issuer]
    assert not any(min(pixel(image, *divmod(int(o), 12), 0, 0)) > 230 for o in plain)


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_film_is_written_with_a_frame_a_map(film: Film, tmp_path: Path, name: str) -> None:
    watch.to_file(film, tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 26
        assert image.size == (421, 366)
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350


def test_text_shows_the_greedy_actions_and_the_agent(film: Film) -> None:
    text = watch.to_text(film, list(watch.moments(film))[-1]).plain.splitlines()
    assert text[1] == "step 10,000, score 1.00  success"
    rows = text[2:12]
    assert {len(row) for row in rows} == {36}
    agent = film_end(film)
    assert rows[agent // 12][agent % 12 * 3 + 1] == "@"
    assert rows[6][8 * 3 + 1] == "*"
    assert rows[4][6 * 3] == "["
    signs = {1 << a: sign for a, sign in enumerate("↑↓←→P")}
    for o in (13, 40, 50, 111):
        assert rows[o // 12][o % 12 * 3 + 1] == (signs | {31: "."}).get(int(film.greedy[-1, o]), "+")


def film_end(film: Film) -> int:
    return animation.walk(film.model, film.greedy[-1])[0][-1]


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
    """What is pressed, one list before each frame; then the window is closed."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    script: list[list[str]] = []
    monkeypatch.setattr(Window, "pressed", lambda _: script.pop(0) if script else ["q"])
    yield script
    assert script == []


def test_window_plays_pauses_and_goes_through_training(
    film: Film, keys: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, int]] = []
    picture = animation.picture

    def noting(film: Film, place: int, way: list[int], event: str = "", **options: Any) -> Image.Image:
        shown.append((place, len(way)))
        return picture(film, place, way, event, **options)

    monkeypatch.setattr(animation, "picture", noting)
    keys += [[], [], ["space"], [], ["right"], [], ["right", "right", "left"], ["space"], []]
    watch.in_window(film)
    assert shown[1:] == [(0, 1), (0, 2), (0, 3), (0, 3), (1, 1), (1, 1), (2, 1), (2, 1), (2, 2)]


def test_window_tells_what_was_pressed(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_watch_command(folder: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", "watch", "--scenario", "S1", "--algorithm", "q_learning",
         "--results", str(folder)],
        cwd=ROOT, capture_output=True, text=True, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "step 10,000, score 1.00  success" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--scenario", "S9"], "compare_deep: unknown scenario S9; accepted: S1, S2, S3."),
        (["--algorithm", "dqm"], "unknown algorithm dqm (did you mean dqn?)"),
        (["--algorithm", "dqn", "--observation", "index"], "unknown observation index"),
        (["--seed", "-1"], "--seed -1: accepted: a whole number from 0 to 999,999."),
        (["--save", "film.mp4"], "--save film.mp4: accepted: a name that ends in .webp or .gif."),
    ],
)
def test_mistakes_get_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(["watch", "--results", str(tmp_path), *arguments]) == 2
    told = capsys.readouterr().err
    assert expected in told
    assert told.count("\n") == 1


def test_film_that_cannot_be_written(film: Film, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--save .*film\.gif: cannot be written: "):
        watch.to_file(film, tmp_path / "nowhere" / "film.gif")


# While it runs


def ended(digest: str, status: str, steps: int = 400) -> Record:
    arrays = {"steps_taken": np.array(steps)} if status != "failed" else {}
    return Record(digest, "{}", status, {}, arrays)


def display(console: Console) -> tuple[Display, list[Any]]:
    runs = all_specifications(SMOKE)
    jobs = plan(runs[1:])
    return Display(SMOKE, None, {runs[0].digest}, jobs, console), [runs, jobs]


def test_grid_shows_done_running_and_failed(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w+", encoding="utf-8") as file:
        console = Console(file=file, force_terminal=True, width=110)
        shown, (_, jobs) = display(console)
        cell = "dqn", "one_hot", "S2"
        dqn = [job for job in jobs if (job[0].arm, job[0].observation, job[0].scenario.name) == cell]
        with shown:
            shown.start(dqn[0])
            shown.start(dqn[1])
            shown.advance([ended(dqn[0][0].digest, "failed")])
            console.print(shown._render())
            shown.advance([ended(dqn[1][0].digest, "diverged")])
    text = Console(width=110, color_system=None)
    with text.capture() as capture:
        text.print(shown._render())
    lines = capture.get().splitlines()
    assert lines[1].split() == ["S1", "S2", "S3"]
    rows = {" ".join(line.split()[:2]): line.split()[2:] for line in lines[2:]}
    assert rows["q_learning, index"] == ["1/4", "0/4", "0/4"]
    assert rows["dqn, one_hot"] == ["0/2", "1/2", "!1", "0/2"]
    assert "2 of 78 runs" in lines[-1]
    assert ">1" in (tmp_path / "out").read_text(encoding="utf-8")


def test_no_terminal_gets_a_line(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w", encoding="utf-8") as file:
        shown, (_, jobs) = display(Console(file=file, width=200))
        with shown:
            shown.start(jobs[0])
            shown.advance([ended(run.digest, "done") for run in jobs[0]])
    told = (tmp_path / "out").read_text(encoding="utf-8")
    assert told.startswith(f"compare_deep_smoke: {1 + len(jobs[0])} of 78 runs, ")
    assert "steps/s" in told
    assert told.count("\n") == 1


def test_readings_are_the_rows_of_a_replication() -> None:
    replication = load_experiment("reproduce_smoke")
    runs = all_specifications(replication)
    text = Console(width=110, color_system=None)
    with text.capture() as capture:
        text.print(Display(replication, None, set(), plan(runs), text)._render())
    rows = [line.split() for line in capture.get().splitlines()[2:-2]]
    # The reading max_q measures the runs of the default one, and has none of its own.
    assert [row[0] for row in rows] == [name for name in replication.readings if name != "max_q"]
    own = {row[0]: row[1:] for row in rows}
    assert own["default"] == ["0/6"] * 3
    assert own["equal_pay"] == ["0/6", "0/6", "-"]  # S3 pays as by default
    assert sum(int(cell.split("/")[1]) for row in own.values() for cell in row if cell != "-") == len(runs)


def test_logs_are_refused_where_nobody_writes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["run", "reproduce", "--results", str(tmp_path), "--tensorboard", str(tmp_path / "logs")])
    assert code == 2
    assert "--tensorboard: reproduce trains tables alone, which write no logs" in capsys.readouterr().err
    assert not (tmp_path / "runs.db").exists()


def test_logs_come_from_worker_processes_and_change_nothing(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    for results, more in (("a", ["--tensorboard", str(logs)]), ("b", [])):
        arguments = ["run", "compare_deep_smoke", "--seeds", "0", "--results", str(tmp_path / results)]
        done = subprocess.run(
            [sys.executable, "-m", "benchmark", *arguments, *more], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    written = {str(path.parent.relative_to(logs)) for path in logs.rglob("events*")}
    assert len(written) == 27
    assert "compare_deep_smoke/S2/ppo_coordinates/seed_0" in written
    with Store(tmp_path / "a" / "runs.db") as one, Store(tmp_path / "b" / "runs.db") as other:
        digests = sorted(one.ended())
        for x, y in zip(one.get(digests), other.get(digests), strict=True):
            assert all(x.arrays[name].tobytes() == y.arrays[name].tobytes() for name in x.arrays)
