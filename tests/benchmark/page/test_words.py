"""Terms are explained where they first appear."""

import pytest
from markupsafe import Markup

from benchmark.page.words import Marker, Word, words_of

WORDS = words_of(
    "word",
    [("learner", Markup("an *arm* with `a form`; not Q*, nor Q* twice")), ("P", Markup("a probability")),
     ("greedy, stochastic", Markup("policies")), ("interquartile mean (iqm)", Markup("a mean")),
     ("deep learner", Markup("a net"))],
)  # fmt: skip


def marked(key: int, text: str) -> str:
    """Returns a term as the page has it."""
    return f'<button type="button" class="term" popovertarget="word-{key}">{text}</button>'


def test_first_occurrence_of_each_term_is_marked() -> None:
    mark = Marker(WORDS)
    assert mark(Markup("Learners learn, a learner too.")) == f"{marked(0, 'Learners')} learn, a learner too."
    assert mark(Markup("P, the IQM and the iqm of a learner")) == (
        f"{marked(1, 'P')}, the IQM and the {marked(3, 'iqm')} of a learner"
    )
    assert mark(Markup("greedy or stochastic")) == f"{marked(2, 'greedy')} or stochastic"


def test_longest_name_is_marked_and_the_other_one_later() -> None:
    mark = Marker(WORDS)
    assert mark(Markup("A deep learner.")) == f"A {marked(4, 'deep learner')}."
    assert mark(Markup("A learner.")) == f"A {marked(0, 'learner')}."


@pytest.mark.parametrize(
    "text",
    ['<a class="n" href="x">learner</a>', "<code>learner</code>", "p = 1", "nonlearner", "learner-like"],
)
def test_links_code_and_other_words_are_left_alone(text: str) -> None:
    assert Marker(WORDS)(Markup(text)) == text


def test_text_after_a_link_is_marked() -> None:
    text = Marker(WORDS)(Markup("<code>x</code> is a <em>learner</em>"))
    assert text == f"<code>x</code> is a <em>{marked(0, 'learner')}</em>"


def test_explanations_keep_their_emphasis() -> None:
    assert WORDS[0] == Word(
        "word-0", "learner", Markup("an <em>arm</em> with `a form`; not Q*, nor Q* twice")
    )
