"""Films as text."""

from dataclasses import replace

import numpy as np

from benchmark.drawing.film import Film, Moment, end_of
from benchmark.drawing.text import to_text


def test_text_shows_the_greedy_actions_and_the_agent(film: Film) -> None:
    end = end_of(film, 25)
    text = to_text(film, end).plain.splitlines()
    assert text[1] == "step 10,000, score 1.00  success"
    rows = text[2:12]
    assert {len(row) for row in rows} == {36}
    agent = end.cells[-1]
    assert rows[agent // 12][agent % 12 * 3 + 1] == "@"
    assert rows[6][8 * 3 + 1] == "*"
    assert rows[4][6 * 3] == "["
    assert rows[5][7 * 3] == "{"
    signs = {1 << action: sign for action, sign in enumerate("↑↓←→P")}
    for cell in (13, 40, 50, 111):
        assert rows[cell // 12][cell % 12 * 3 + 1] == (signs | {31: "."}).get(int(film.greedy[-1, cell]), "+")


def test_text_has_the_colours_of_the_largest_values(film: Film) -> None:
    values = np.zeros_like(film.values)
    values[25, :, 2] = np.repeat([0.0, 1.0], 60)
    values[25, :60, 3] = -1e-9
    values[25, 7] = 0.5
    values[25, 5] = np.nan
    greedy = film.greedy.copy()
    greedy[25, 7] = 31  # all alike: the agent has not been there
    text = to_text(replace(film, values=values, greedy=greedy), Moment(25, (0,)))
    styles = [str(span.style) for span in text.spans][:120]
    assert styles[1].endswith("rgb(255,255,255) on rgb(0,34,77)")  # the ends of cividis
    assert styles[119].endswith("rgb(0,0,0) on rgb(253,231,55)") or styles[119].endswith("on rgb(254,232,56)")
    assert styles[7].endswith("rgb(0,0,0) on rgb(250,250,250)")
    assert styles[5].endswith("rgb(0,0,0) on rgb(250,250,250)")
