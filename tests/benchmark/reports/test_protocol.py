"""Protocols: what an experiment declares, what follows if it declares none, and what is refused."""

from pathlib import Path

import pytest

from benchmark.experiments import Experiment, load_experiment
from benchmark.reports import load_report
from benchmark.reports.comparison.protocol import Learner, Protocol, protocol_of
from envs import InputError

ARMS = """
description = "Tables and nets."
report = "comparison"
scenarios = ["S1"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200 }
algorithms.other = { algorithm = "q_learning", observations = ["index"], seeds = 2 }
algorithms.table = { algorithm = "q_learning", observations = ["index"], seeds = 2 }
algorithms.net = { algorithm = "compiled_dqn", observations = ["one_hot", "coordinates"], seeds = 2 }
algorithms.net_sb3 = { check_of = "net", algorithm = "dqn", seeds = 2 }
"""
TABLE, NET = Learner("table", "index"), Learner("net", "one_hot")


def experiment_of(tmp_path: Path, more: str = "") -> Experiment:
    path = tmp_path / "mine.toml"
    path.write_text(ARMS + more, encoding="utf-8")
    return load_experiment(path)


def test_without_a_protocol_every_deep_learner_is_compared_with_the_first_table(tmp_path: Path) -> None:
    found = protocol_of(experiment_of(tmp_path))
    assert found is not None
    assert found.reference == Learner("other", "index")
    assert found.contrasts == [(NET, found.reference), (Learner("net", "coordinates"), found.reference)]
    assert found.decisive == [NET, Learner("net", "coordinates")]  # a check is no learner of its own
    assert not found.is_declared
    assert (found.success_margin, found.score_margin, found.fewest_runs) == (0.1, 0.05, 10)


def test_declared_protocol_is_taken_and_survives_the_manifest(tmp_path: Path) -> None:
    more = """
    [protocol]
    reference = "table, index"
    contrasts = [["net, one_hot", "table, index"], ["table, index", "other, index"]]
    success_margin = 0.2
    fewest_runs = 30
    """
    found = protocol_of(experiment_of(tmp_path, more))
    assert found is not None
    assert found.contrasts == [(NET, TABLE), (TABLE, Learner("other", "index"))]
    assert (found.reference, found.decisive, found.success_margin) == (TABLE, [NET], 0.2)
    assert found.fewest_runs == 30
    assert Protocol.from_json(found.as_json()) == found


def test_tables_alone_decide_nothing() -> None:
    experiment = load_experiment("compare_deep_smoke")
    tables = {name: arm for name, arm in experiment.algorithms.items() if arm.algorithm == "q_learning"}
    assert protocol_of(experiment.model_copy(update={"algorithms": tables, "protocol": None})) is None


CONTRAST = '["net, one_hot", "table, index"]'
CONTRASTS = f"contrasts = [{CONTRAST}]"


@pytest.mark.parametrize(
    ("protocol", "expected"),
    [
        (f'reference = "tables, index"\n{CONTRASTS}', "protocol.reference: unknown table tables, index (did"),
        (f'reference = "net, one_hot"\n{CONTRASTS}', "protocol.reference: unknown table net, one_hot"),
        (CONTRASTS.replace("one_hot", "one-hot"), "protocol.contrasts.0: unknown learner net, one-hot (did"),
        (CONTRASTS.replace("net,", "net_sb3,"), "protocol.contrasts.0: unknown learner net_sb3"),
        ('contrasts = [["net, one_hot", "net, one_hot"]]', "accepted: two different learners"),
        (
            'reference = "table, index"\ncontrasts = [["table, index", "net, one_hot"]]',
            'accepted: the reference second, ["net, one_hot", "table, index"]',
        ),
        (f"contrasts = [{CONTRAST}, {CONTRAST}]", "it is declared twice; remove one"),
        (f'reference = "other, index"\n{CONTRASTS}', "none compares a deep learner with other, index"),
    ],
)
def test_protocols_that_name_what_is_not_there_are_refused(
    tmp_path: Path, protocol: str, expected: str
) -> None:
    experiment = experiment_of(tmp_path, f"[protocol]\n{protocol}\n")
    with pytest.raises(InputError) as caught:
        load_report("comparison").check(experiment)
    assert expected in str(caught.value)
    assert "mine.toml: " in str(caught.value)


@pytest.mark.parametrize(
    ("protocol", "expected"),
    [
        ("contrasts = []", "protocol.contrasts = []"),
        (f"contrasts = [{', '.join([CONTRAST] * 9)}]", "accepted: at most 8 items"),
        (f"contrasts = [{CONTRAST}]\nfewest_runs = 9", "protocol.fewest_runs = 9: input should be greater"),
        (f"contrasts = [{CONTRAST}]\nsuccess_margin = 0.0", "protocol.success_margin = 0.0"),
        (f"contrasts = [{CONTRAST}]\nmargin = 0.1", "[protocol]: unknown key margin"),
    ],
)
def test_protocols_of_another_form_are_refused(tmp_path: Path, protocol: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        experiment_of(tmp_path, f"[protocol]\n{protocol}\n")
    assert expected in str(caught.value)


def test_many_deep_learners_call_for_a_protocol() -> None:
    experiment = load_experiment("compare_deep").model_copy(update={"protocol": None})
    with pytest.raises(
        InputError, match=r"there are 9 deep learners; accepted: a table \[protocol\] that names"
    ):
        protocol_of(experiment)
