"""Shows what an agent does and where it walks as coloured text, for the terminal."""

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize
from rich.text import Text

from agents.policy import contains
from benchmark.drawing.film import ENDINGS, Film, Moment
from benchmark.drawing.maps import RGB, colour_map
from envs.scene import ARROWS

# Before and after a cell
_BRACKETS: Final = {"outside": "  ", "target": "[]", "uncomfortable": "{}", "issuer": "  "}
_LEGEND: Final = f"""\
{ARROWS} greedy move   P greedy PING   + several   . all alike
[ ] target region   {{ }} uncomfortable region
* issuer            @ agent"""


def to_text(film: Film, moment: Moment) -> Text:
    """Returns a moment as text: the greedy action of each cell, on the colour of its best value."""
    film = film.seen(moment)
    scene, index, agent = film.scene, moment.index, moment.cells[-1]
    greedy, values = contains(film.greedy[index]), film.values[index]
    best = np.where(film.is_unknown(index), np.nan, values.max(axis=1))
    norm = Normalize(*film.scale)
    colours = mpl.colormaps[colour_map(norm)].with_extremes(bad=RGB["no value"])
    text = Text(f"{film.title}\n")
    text.append(f"step {film.steps[index]:,}, score {film.scores[index]:.2f}  ")
    text.append(f"{ENDINGS.get(moment.ending, '')}\n")
    for cell, (red, green, blue, _) in enumerate(colours(norm(best), bytes=True).tolist()):
        if cell == agent:
            sign = "@"
        elif scene.is_over[cell]:
            sign = "#" if scene.is_wall[cell] else "*"
        else:
            (first, *more) = np.flatnonzero(greedy[cell]).tolist()
            sign = "." if greedy[cell].all() else "+" if more else f"{ARROWS}P"[first]
        brackets = _BRACKETS[scene.zone[cell]]
        ink = "rgb(0,0,0)" if red + green + blue > 330 else "rgb(255,255,255)"
        style = f"{'bold ' if cell == agent else ''}{ink} on rgb({red},{green},{blue})"
        text.append(f"{brackets[0]}{sign}{brackets[1]}", style=style)
        if (cell + 1) % scene.columns == 0:
            text.append("\n")
    text.append(_LEGEND + ("          # wall" if scene.is_wall.any() else ""), style="dim")
    return text
