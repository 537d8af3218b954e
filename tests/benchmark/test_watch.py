"""Films: walks against exact evaluation and by hand, and frames, by their artists."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from agents.dynamic_programming import evaluate, solve
from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.watch import CIRCLE, HORIZON, draw, walk, write
from envs import ACTIONS, Model, compile_scenario, load_scenario
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.populations import population

UP, DOWN, LEFT, RIGHT, PING = (1 << action for action in range(len(ACTIONS)))
S1 = compile_scenario(load_scenario("S1"))
SUCCESS, TOO_MANY = "success", "too many wrong PINGs"


def walked(mask: int, n: int, model: Model = S1) -> tuple[list[int], str]:
    """Walks by the policy that has the same greedy actions in all cells."""
    return walk(model, np.full(model.n_observations, mask, dtype=np.uint8), n)


def test_walks_of_deterministic_policies_are_as_long_as_exact_evaluation_says() -> None:
    rng, endings = np.random.default_rng(0), set()
    best = solve(S1, 0.9).q[S1.fresh_state].argmax(axis=1)
    for share in np.repeat([0.0, 0.05, 0.2, 1.0], 25):
        random = rng.integers(5, size=len(best))
        greedy = (1 << np.where(rng.random(len(best)) < share, random, best)).astype(np.uint8)
        states, ending = walk(S1, greedy, 200)
        exact = evaluate(S1, mask_policy(greedy), 200)
        assert (ending == SUCCESS) == bool(exact.success == 1)
        # A policy that goes in circles never ends its episode.
        assert (200 if ending == CIRCLE else len(states) - 1) == exact.steps
        endings.add(ending)
    assert endings == {SUCCESS, TOO_MANY, CIRCLE}


def test_walks_end_as_the_episode_ends_by_hand() -> None:
    assert walked(PING, S1.scenario.ping_limit)[1] == TOO_MANY
    assert walked(UP | LEFT, 9) == ([0, 0], CIRCLE)
    assert walked(RIGHT, 1) == ([0, 1], HORIZON)
    model = compile_scenario(load_scenario("S1", {"grid.start": [6, 5]}))  # the issuer's row
    assert walked(RIGHT, 3, model) == ([77, 78, 79, 80], "ran into the person")


def test_a_frame_shows_values_greedy_actions_the_walk_and_its_end() -> None:
    values, greedy = np.zeros((1, 4, 120, 5)), np.full((1, 4, 120), UP | PING, dtype=np.uint8)
    values[0, 2, :, 1] = np.arange(120)
    greedy[0, 2, :24] = DOWN  # two rows, then up again: from row 2 to row 1
    greedy[0, 2, 60:] = 31  # nothing has been learned
    axis = Figure().subplots()
    records = population(n=1, values=values, greedy=greedy)
    draw(axis, "mine", records, Normalize(0, 1), 2)
    lines = [np.asarray(line.get_xydata()).astype(int) for line in axis.lines]
    issuer, start, pings, path, agent = [(points @ [1, 12]).tolist() for points in lines]
    assert (issuer, start) == ([6 * 12 + 8], [0])
    assert (path, agent) == ([0, 12, 24, 12], [12])
    assert pings == [*range(24, 60)]
    mesh, heads = axis.collections
    assert len(heads.get_paths()) == 24 - 1 + 36  # but not in the agent's cell
    assert np.ravel(np.asarray(mesh.get_array()))[:80].tolist() == [*range(80)]
    assert axis.get_title("left").splitlines()[1].startswith("step 400, score ")
    assert axis.get_title("left").endswith(CIRCLE)


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_have_a_frame_per_map(name: str, tmp_path: Path) -> None:
    values = np.zeros((1, 4, 120, 5))
    values[0] = np.arange(4)[:, None, None]
    write("mine", population(n=1, values=values), tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) >= 4


def test_the_command_watches_a_scenario_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("benchmark.watch.write", lambda *_: None)  # it takes seconds
    text = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    Path("Hallway.toml").write_text(text.replace("rows = 10", "rows = 20"), encoding="utf-8")
    for said in ("training", ""):
        assert main(["watch", "--scenario", "Hallway.toml", "--save", "film.webp"]) == 0
        printed = capsys.readouterr()
        assert printed.out == "Hallway: paper's Q-learning table, seed 0: film.webp\n"
        assert printed.err.partition(" ")[0] == said  # then the run is stored
    assert main(["watch", "--experiment", "tuning", "--save", "a.gif"]) == 2
    assert "its runs cannot be watched" in capsys.readouterr().err
