"""Tables that are written, and read again."""

from envs.inputs import override


def test_overrides_change_no_table_of_the_caller() -> None:
    data, feedback = {"grid": {"rows": 3}}, {"kind": "noisy"}
    changed = override(data, {"grid.rows": 4, "feedback": feedback, "feedback.noise": 1.0}, "test")
    assert changed == {"grid": {"rows": 4}, "feedback": {"kind": "noisy", "noise": 1.0}}
    assert (data, feedback) == ({"grid": {"rows": 3}}, {"kind": "noisy"})
