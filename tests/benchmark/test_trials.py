"""What a search draws, and the file of what it has chosen."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.trials import (
    Choice,
    Choices,
    Chosen,
    Search,
    Space,
    Span,
    chosen_file,
    read_chosen,
    trials,
    write_choices,
)
from envs import InputError
from envs.inputs import Table, parse

SPACE: Space = {
    "learning_rate": Span(low=0.01, high=1, scale="log"),
    "epsilon": Span(low=0, high=0.5),
    "every": Span(low=10, high=1000, scale="log", whole=True),
    "policy_kwargs.net_arch": Choice(values=([8], [8, 8])),
}
PICK = {"trial": 6, "settings": {"epsilon": 0.1}, "score": 0.5}
EFFORT = {"trials": 7, "runs": 20, "steps": 4000, "cpu_time_s": 0.1}
BEST = Chosen.model_validate(PICK | EFFORT)
CHOICES = Choices(search="a" * 64, trials="b" * 64, learners={"dqn, one_hot": BEST})


def test_trials_fill_the_space_evenly() -> None:
    """Of 64 points of a Sobol sequence in each dimension, one is in every 64th of the range."""
    first, *others = trials("dqn", SPACE, 64)
    assert first == {}
    assert others != trials("ppo", SPACE, 64)[1:]
    drawn = pd.DataFrame(others)
    for shares in (np.log10(drawn["learning_rate"]) / 2 + 1, drawn["epsilon"] / 0.5):
        assert sorted(shares * 64 // 1) == pytest.approx(np.arange(64), abs=1)  # three digits
    assert [*drawn["policy_kwargs.net_arch"]].count([8]) == 32
    assert drawn["every"].dtype == int
    assert drawn["every"].between(10, 1000).all()


@pytest.mark.parametrize(
    ("cls", "keys", "reason"),
    [
        (Search, {"first_seed": 0, "trials": 3}, "finalists = 4: accepted: at most 3"),
        (Search, {"first_seed": 0, "trials": 0}, "trials = 0: input should be greater than or eq"),
        (Span, {"low": 0.0, "high": 1.0, "scale": "log"}, "low = 0.0: accepted: above 0"),
        (Span, {"low": 1.0, "high": 1.0}, "low = 1.0: accepted: less than high = 1.0"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    cls: type[Table], keys: dict[str, object], reason: str
) -> None:
    with pytest.raises(InputError, match=re.escape(reason)):
        parse(cls, keys, "mine.toml")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (".*", None, "it is missing"),
        (".*", "[]", "is not the digest of the content"),
        (r'"epsilon": 0\.1', '"epsilon": 0.2', "is not the digest of the content"),
    ],
)
def test_missing_and_changed_choices_are_refused(
    tmp_path: Path, old: str, new: str | None, reason: str
) -> None:
    path = tmp_path / "mine.toml"
    write_choices(path, CHOICES)
    file = chosen_file(path)
    text, count = re.subn(old, new or "", file.read_text(), count=1, flags=re.DOTALL)
    assert count == 1
    file.unlink() if new is None else file.write_text(text)
    with pytest.raises(InputError, match=rf"mine\.chosen\.json: .*{reason}"):
        read_chosen(path)
