"""Tables that are written, and read again."""

from collections.abc import Set
from typing import ClassVar

from envs.inputs import Table, override, parse


class Inner(Table):
    """A table with a key that it got later."""

    omitted_at_default: ClassVar[Set[str]] = {"added"}
    old: int = 1
    added: int = 2


class Outer(Table):
    """A table that holds it."""

    inner: Inner = Inner()


def test_keys_added_later_are_written_only_if_they_differ_from_their_defaults() -> None:
    for table, written in ((Outer(), {"old": 1}), (Outer(inner=Inner(added=3)), {"old": 1, "added": 3})):
        assert table.model_dump(mode="json") == {"inner": written}
        assert parse(Outer, {"inner": written}, "test") == table


def test_overrides_change_no_table_of_the_caller() -> None:
    data, feedback = {"grid": {"rows": 3}}, {"kind": "noisy"}
    changed = override(data, {"grid.rows": 4, "feedback": feedback, "feedback.noise": 1.0}, "test")
    assert changed == {"grid": {"rows": 4}, "feedback": {"kind": "noisy", "noise": 1.0}}
    assert (data, feedback) == ({"grid": {"rows": 3}}, {"kind": "noisy"})
