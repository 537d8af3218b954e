"""The kernel against a slow, obviously correct learner that gets the same draws."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule
from agents.dynamic_programming import solve
from agents.policy import contains, greedy_masks
from agents.process import draw_word
from agents.tabular.kernel import choose_action
from agents.tabular.learner import Settings, TabularTraining, train
from envs import ACTIONS, InputError, ProxemicEnv, compile_scenario, load_scenario
from envs.inputs import parse
from tests.agents.words import choose, uniform, words, xoshiro


def test_generator_gives_the_published_numbers() -> None:
    # First outputs from the state 1, 2, 3, 4, as in the test vectors of the rand_xoshiro crate.
    published = [
        41943041,
        58720359,
        3588806011781223,
        3591011842654386,
        9228616714210784205,
        9973669472204895162,
        14011001112246962877,
        12406186145184390807,
        15849039046786891736,
        10450023813501588000,
    ]
    stream = xoshiro([1, 2, 3, 4])
    assert [next(stream) for _ in published] == published
    state = tuple(map(np.uint64, (1, 2, 3, 4)))
    for expected in published:
        word, following = draw_word(state)
        state = tuple(map(np.uint64, following))
        assert word == expected


class Draws:
    """Replaces the env's generator: draws noise, outcomes and starts from the agent's stream.

    The env draws noise at every action, the kernel only where there is some.
    """

    def __init__(self, stream: Iterator[int]) -> None:
        self.stream = stream
        self.n_unwanted = 0

    def random(self) -> float:
        """Returns the next draw from [0, 1)."""
        if self.n_unwanted:
            self.n_unwanted -= 1
            return 0.5
        return uniform(next(self.stream))


def decayed(first: float, last: float | None, fraction: float, settings: Settings, unit: int) -> float:
    """Returns a setting that decays linearly over a fraction of the budget."""
    share = unit / round(fraction * settings.budget)
    return first if last is None else last if share >= 1 else first + (last - first) * share


def slow_learner(
    name: str,
    overrides: dict[str, Any],
    settings: Settings,
    seed: SeedSequence,
    evaluation_steps: list[int],
) -> dict[str, Any]:
    """Q-learning as in the textbook, over the Gymnasium env; nothing is updated incrementally."""
    stream = words(seed)
    env = gymnasium.make(
        f"envs:Proxemic/{name}-v0", overrides=overrides, max_episode_steps=settings.time_limit or -1
    )
    model = env.unwrapped.model  # type: ignore[attr-defined]
    q = np.full((model.n_observations, 5), settings.initial_value)
    visits = np.zeros(q.shape, dtype=int)
    result: dict[str, Any] = {
        "greedy": [],
        "max_q": [],
        "table_max_q": [],
        "steps_taken": 0,
        "episodes_ended": 0,
    }
    draws = Draws(stream)
    env.unwrapped.np_random = draws  # type: ignore[assignment]
    observation, _ = env.reset()

    def best_actions(row: NDArray[np.float64]) -> list[int]:
        best = [action for action in range(5) if row[action] == row.max()]
        return best[:1] if settings.ties == "lowest" else best

    unit = 0
    visited: list[float] = []
    table: list[float] = []
    fresh = True
    while unit < settings.budget:
        if fresh:
            if unit in evaluation_steps:
                result["greedy"].append([sum(2**a for a in best_actions(row)) for row in q])
            visited, table = [], []
            fresh = False
        visited.append(q[observation].max())
        table.append(q.max())

        epsilon = decayed(settings.epsilon, settings.final_epsilon, settings.epsilon_fraction, settings, unit)
        action = choose(next(stream), epsilon, best_actions(q[observation]))
        draws.n_unwanted = int(model.is_noisy and ACTIONS[action] != "PING")
        following, reward, terminated, truncated, _ = env.step(action)
        value_after = 0.0 if terminated else q[following].max()
        target = float(reward) + settings.discount * value_after
        first, last = settings.learning_rate, settings.final_learning_rate
        rate = decayed(first, last, settings.learning_rate_fraction, settings, unit)
        if settings.visit_exponent is not None:
            visits[observation, action] += 1
            rate /= float(visits[observation, action]) ** settings.visit_exponent
        q[observation, action] += rate * (target - q[observation, action])
        observation = following
        result["steps_taken"] += 1
        if terminated or truncated:
            observation, _ = env.reset()
            result["episodes_ended"] += 1
        if settings.budget_unit == "steps" or terminated or truncated:
            if unit % settings.record_every == 0:
                result["max_q"].append(max(visited))
                result["table_max_q"].append(max(table))
            unit += 1
            fresh = True
    if settings.budget in evaluation_steps:
        result["greedy"].append([sum(2**a for a in best_actions(row)) for row in q])
    result["q"] = q
    return result


def check_same(training: TabularTraining, i: int, expected: dict[str, Any]) -> None:
    for key, values in expected.items():
        assert np.array_equal(getattr(training, key)[i], np.asarray(values)), key


# Two phases that follow each other at random, and an issuer that moves with them; several starts.
MOVES = {
    "grid.start": [[0, 0], [9, 11], [0, 11]],
    "phases": [
        {"name": "near", "next": {"far": 0.2}},
        {"name": "far", "position": [3, 4], "next": {"near": 0.1, "gone": 0.05}},
        {"name": "gone", "position": [2, 8], "next": {"near": 0.3}},
    ],
    "observe": ["agent", "phase"],
}
READINGS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "default": ({}, {}),
    "epsilon": ({}, {"epsilon": 0.4}),
    "ping_discomfort": ({"rewards.wrong_ping_uncomfortable": -0.8}, {}),
    "budget": ({}, {"budget": 150, "budget_unit": "episodes"}),
    "ties": ({}, {"ties": "lowest"}),
    "origin": ({"issuer.position": [8, 6]}, {}),
    "time_limit": ({}, {"time_limit": 15}),
    "initial_value": ({}, {"initial_value": -0.7}),
    "decays": (
        {},
        {
            "final_learning_rate": 0.1,
            "learning_rate_fraction": 0.7,
            "final_epsilon": 0.2,
            "epsilon_fraction": 0.5,
        },
    ),
    "decays by episode": (
        {},
        {
            "budget": 150,
            "budget_unit": "episodes",
            "final_learning_rate": 0.0,
            "final_epsilon": 0.3,
            "epsilon_fraction": 0.4,
        },
    ),
    "visits": ({}, {"visit_exponent": 0.7, "learning_rate": 1.0}),
    "starts": ({"grid.start": [[0, 0], [9, 0], [0, 11]]}, {"time_limit": 40}),
    "people move": (MOVES, {"time_limit": 50}),
    "all at once": (
        {"issuer.position": [8, 6], "rewards.wrong_ping_uncomfortable": -0.8},
        {
            "epsilon": 0.15,
            "ties": "lowest",
            "budget": 120,
            "budget_unit": "episodes",
            "time_limit": 25,
            "record_every": 7,
            "learning_rate": 0.3,
            "discount": 1.0,
        },
    ),
}


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", ["S1", "S2", "S3"])
def test_kernel_equals_slow_learner(name: str, reading: str) -> None:
    overrides, changes = READINGS[reading]
    settings = Settings(**({"budget": 3000, "record_every": 3} | changes))
    points = [0, 1, settings.budget // 3, settings.budget]
    seeds = [SeedSequence([11, i]) for i in range(2)]
    model = compile_scenario(load_scenario(name, overrides))
    training = train(model, settings, seeds, Schedule(settings.budget, tuple(points)), record_table=True)
    for i, seed in enumerate(seeds):
        check_same(training, i, slow_learner(name, overrides, settings, seed, points))
    assert (training.q[0] != training.q[1]).any()
    assert training.episodes_ended.min() > 5


def check_same_agent(together: TabularTraining, i: int, alone: TabularTraining) -> None:
    for key, values in vars(together).items():
        if key != "cpu_time_s":  # measured
            assert values[i].tobytes() == getattr(alone, key)[0].tobytes(), key


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_together_equals_one_at_a_time_on_any_number_of_threads(threads: int) -> None:
    model = compile_scenario(load_scenario("S2"))
    settings = Settings(budget=500)
    seeds = [SeedSequence([5, i]) for i in range(100)]
    schedule = Schedule(500, (0, 250, 500))
    together = train(model, settings, seeds, schedule, record_table=True, threads=threads)
    for i in range(0, 100, 9):
        check_same_agent(together, i, train(model, settings, [seeds[i]], schedule, record_table=True))
    backwards = train(model, settings, seeds[::-1], schedule, record_table=True, threads=threads)
    assert together.q.tobytes() == backwards.q[::-1].tobytes()


def test_snapshots_and_records_do_not_disturb_learning() -> None:
    model = compile_scenario(load_scenario("S3"))
    seeds = [SeedSequence(3)]
    plain = train(model, Settings(budget=2000, record_every=500), seeds, Schedule(2000))
    often = Schedule(2000, tuple(range(0, 2001, 10)))
    watched = train(model, Settings(budget=2000), seeds, often, record_table=True)
    assert plain.q.tobytes() == watched.q.tobytes()
    assert plain.table_max_q.shape == (1, 0)
    assert watched.greedy.shape == (1, 201, 120)
    assert (watched.max_q[:, ::500] == plain.max_q).all()


def test_maps_are_the_table_at_their_steps() -> None:
    model = compile_scenario(load_scenario("S2"))
    seeds = [SeedSequence(i) for i in range(3)]
    schedule = Schedule(2000, (0, 500, 1000, 2000), (0, 1000, 2000))
    training = train(model, Settings(budget=2000), seeds, schedule)
    assert (training.values[:, 0] == 0).all()
    # The table at a step is the table at the end of a shorter training.
    shorter = train(model, Settings(budget=1000), seeds, Schedule(1000))
    assert (training.values[:, 1] == shorter.q.astype(np.float32)).all()
    assert (training.values[:, 2] == training.q.astype(np.float32)).all()


def test_last_snapshot_is_greedy_in_the_final_values() -> None:
    model = compile_scenario(load_scenario("S1"))
    training = train(
        model, Settings(budget=4000), [SeedSequence(i) for i in range(4)], Schedule(4000, (4000,))
    )
    assert (training.greedy[:, 0] == greedy_masks(training.q)).all()


def test_every_candidate_is_drawn_equally_often() -> None:
    masks = np.arange(1, 32, dtype=np.uint8)
    places = [np.uint64(-(-(place << 32) // 60)) for place in range(60)]  # the lowest word of each sixtieth
    never = np.uint64(0)
    for mask, members in zip(masks, contains(masks), strict=True):
        actions = [int(choose_action(word, never, int(mask))) for word in places]
        assert (np.bincount(actions, minlength=5) == members * 60 // members.sum()).all()


def test_share_of_random_actions_is_epsilon() -> None:
    # All rewards are 0, so Q stays 0. With ties "lowest" the greedy action is then UP, and every PING is a
    # random action.
    rewards = dict.fromkeys(
        (f"rewards.{key}" for key in ("issuer_reached", "target_ping", "last_wrong_ping", "wrong_ping",
                                      "wrong_ping_uncomfortable", "uncomfortable", "other")), 0.0
    )  # fmt: skip
    model = compile_scenario(load_scenario("S1", rewards | {"ping_limit": 1}))
    settings = Settings(epsilon=0.3, ties="lowest", budget=400_000)
    training = train(model, settings, [SeedSequence(1)], Schedule(400_000))
    assert not training.q.any()
    # An episode ends by its first PING or, rarely, at the issuer: at a rate of 0.3 / 5 per step.
    rate = training.episodes_ended[0] / training.steps_taken[0]
    assert rate == pytest.approx(0.06, abs=4.5 * np.sqrt(0.06 * 0.94 / 400_000) + 0.0005)


def test_learns_the_optimal_values_of_a_task_it_observes_fully() -> None:
    # If the first wrong PING ends the episode, the cell is the state. If rewards are not random, a learning
    # rate of 1 is exact. Q-learning then converges to Q* itself.
    model = compile_scenario(
        load_scenario("S3", {"ping_limit": 1, "grid.rows": 6, "grid.columns": 6, "issuer.position": [3, 3]})
    )
    settings = Settings(learning_rate=1.0, epsilon=0.9, budget=3_000_000)
    training = train(model, settings, [SeedSequence(0)], Schedule(3_000_000))
    assert training.q[0] == pytest.approx(solve(model, 0.9).q, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"epsilon": 1.5}, "epsilon = 1.5: input should be less than or equal to 1"),
        ({"epsilon": -0.1}, "epsilon = -0.1: input should be greater than or equal to 0"),
        ({"learning_rate": 0}, "learning_rate = 0"),
        ({"ties": "highest"}, "ties = \"highest\": input should be 'uniform' or 'lowest'"),
        ({"budget": 0}, "budget = 0"),
        ({"time_limit": 10**30}, "time_limit = "),
        ({"epsilon": 0, "budget_unit": "episodes"}, "with epsilon = 0 may never end; set time_limit"),
        (
            {"final_epsilon": 0, "budget_unit": "episodes"},
            "with final_epsilon = 0 may never end; set time_limit",
        ),
        ({"final_epsilon": 0.7}, "final_epsilon = 0.7 is above epsilon = 0.6; accepted: at most 0.6"),
        ({"final_learning_rate": 0.9}, "final_learning_rate = 0.9 is above learning_rate = 0.6"),
        ({"epsilon_fraction": 0.5}, "epsilon_fraction = 0.5 needs final_epsilon"),
        ({"learning_rate_fraction": 0.5}, "learning_rate_fraction = 0.5 needs final_learning_rate"),
        (
            {"final_epsilon": 0.1, "epsilon_fraction": 0},
            "epsilon_fraction = 0: input should be greater than 0",
        ),
        (
            {"final_learning_rate": 0.1, "visit_exponent": 0.7},
            "final_learning_rate and visit_exponent exclude each other; set at most one of them",
        ),
        ({"visit_exponent": 0}, "visit_exponent = 0: input should be greater than 0"),
        ({"initial_value": "high"}, 'initial_value = "high": input should be a valid number'),
        ({"trace_decay": 0.5}, "unknown key trace_decay"),
        ({"alpha": 0.6}, "unknown key alpha; accepted: "),
        ({"epsilom": 0.6}, "unknown key epsilom (did you mean epsilon?)"),
    ],
)
def test_wrong_settings_get_one_sentence(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(Settings, change, "mine.toml")
    assert expected in str(caught.value)
    assert str(caught.value).startswith("mine.toml: ")


def test_calls_without_agents_or_threads_are_refused() -> None:
    model = ProxemicEnv().model
    with pytest.raises(ValueError, match="0 agents"):
        train(model, Settings(budget=10), [], Schedule(10))
    with pytest.raises(ValueError, match="for a budget of 20; the settings say 10"):
        train(model, Settings(budget=10), [SeedSequence(0)], Schedule(20))
    with pytest.raises(ValueError, match="threads = 0"):
        train(model, Settings(budget=10), [SeedSequence(0)], Schedule(10), threads=0)


def test_keys_that_settings_got_later_are_written_only_if_set() -> None:
    # The digests of runs depend on what is written.
    assert set(Settings().model_dump()) == {
        "budget", "time_limit", "learning_rate", "discount", "epsilon", "ties", "budget_unit", "record_every"
    }  # fmt: skip
    written = Settings(final_epsilon=0.1, epsilon_fraction=0.5, initial_value=1.0).model_dump()
    assert written | {"final_epsilon": 0.1, "epsilon_fraction": 0.5, "initial_value": 1.0} == written
