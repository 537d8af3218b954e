"""Writes the page: one HTML file with the README of every folder, and the explorer.

Nothing is computed here. The page needs no network; links lead to files beside it.
"""

import base64
import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from string import Template
from urllib.parse import quote

from markdown_it import MarkdownIt

from benchmark.folder import README, Folder, damaged, unpacked, write_text
from benchmark.tables import AGENTS

_HERE = Path(__file__).parent
# The page's script: these share one scope, in this order.
_SCRIPTS = ("elements", "room", "agent", "scene", "walk", "panel", "main")
_MENUS = {
    "experiment": "Experiment",
    "scenario": "Scenario",
    "learner": "Learner",
    "seed": "Seed",
    "place": "Person at",
    "tick": "Phase",
    "pings": "Wrong PINGs",
}
_INTRODUCTION = (
    "An agent walks up to a person and must learn, from rewards alone, how close is close enough to"
    " stop and ask (PING). This benchmark replicates a paper's Q-learning table, and compares"
    " tables and tile coding with neural nets (DQN and PPO)."
)
_QUESTION = "When does deep RL earn its keep over a table?"
_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")
_FIGURE = re.compile(r'<img src="([\w.-]+\.svg)"')
_LINK = re.compile(r'<a href="(?![a-z]+:|#|/)')
_ESCAPED = {ord(each): quote(each) for each in "%#&'\n"}  # in an address in single quotes


def write(where: Path, folders: Sequence[Folder]) -> Path:
    """Writes `index.html` into a folder of results, or into that of all; returns its path."""
    write_text(path := where / "index.html", page(where, folders))
    return path


def page(where: Path, folders: Sequence[Folder]) -> str:
    """Returns the page of folders, in the folder `where`."""
    chapters = [_Chapter(where, folder) for folder in folders]
    is_own = folders[0].path == where
    agents = [_agents(folder) for folder in folders if AGENTS in folder.files]
    css, js = _file("page.css"), "\n".join(_file(f"{name}.js") for name in _SCRIPTS)
    listed = "\n".join(f'<li><a href="#{each.name}">{each.question}</a></li>' for each in chapters)
    opening = f"<p>{_INTRODUCTION}</p>\n<ul>\n{listed}\n</ul>"
    return _filled(
        "page.html",
        title=where.name if is_own else _QUESTION,
        opening="" if is_own else opening,
        chapters="\n".join(each.html(is_open=is_own) for each in chapters),
        explorer=_explorer() if agents else "",
        agents="\n".join(agents),
        css=css,
        js=js,
        css_digest=_digest(css),
        js_digest=_digest(js),
    )


def _agents(folder: Folder) -> str:
    """Returns the explorer's file as the page has it."""
    packed = folder.content(AGENTS)
    with damaged(folder.path / AGENTS):
        unpacked(packed)
    encoded = base64.b64encode(packed).decode("ascii")
    return f'<script type="application/gzip" class="agents">{encoded}</script>'


class _Chapter:
    """README of a folder, as HTML: its question, its answer with a figure, and the rest."""

    def __init__(self, where: Path, folder: Folder) -> None:
        self._folder, self.name = folder, f"report-{folder.path.name}"
        self._prefix = "" if folder.path == where else f"{quote(folder.path.name)}/"
        text = (folder.path / README).read_text(encoding="utf-8")
        title, answer, rest = text.split("\n\n", 2)
        self.question = _MARKDOWN.renderInline(title.removeprefix("# "))
        lead = "".join(re.findall(r"\A!\[.*\n\n.*\n\n", rest))
        self._answer, self._rest = f"{answer}\n\n{lead}", rest.removeprefix(lead)

    def html(self, *, is_open: bool) -> str:
        """Returns the chapter."""
        return (
            f'<section id="{self.name}">\n<h2>{self.question}</h2>\n{self._html(self._answer)}'
            f"<details{' open' * is_open}><summary>Details, figures and tables</summary>\n"
            f"{self._html(self._rest)}</details>\n</section>"
        )

    def _html(self, text: str) -> str:
        """Returns Markdown as HTML, with figures, and links that lead to the folder."""
        html = _MARKDOWN.render(text).replace("<h2>", "<h3>").replace("</h2>", "</h3>")
        html = _LINK.sub(lambda match: f"{match[0]}{self._prefix}", html)
        html = re.sub(
            "<table>.*?</table>", r'<div class="scroll" tabindex="0">\g<0></div>', html, flags=re.S
        )
        html = _FIGURE.sub(self._figure, html)
        return html.replace('<img src="', '<img data-src="')  # of somebody else

    def _figure(self, image: re.Match[str]) -> str:
        drawn = self._folder.content(image[1]).decode()
        return f"<img src='data:image/svg+xml,{drawn.translate(_ESCAPED)}'"


def _explorer() -> str:
    menus = "\n".join(
        f'<label>{text} <select name="{name}"></select></label>' for name, text in _MENUS.items()
    )
    sides = {"left": "Left map", "right": "Right map"}
    panels = [
        _filled("panel.html", side=side, label=text, menus=menus) for side, text in sides.items()
    ]
    return _filled("explorer.html", panels="".join(panels))


def _filled(template: str, **values: str) -> str:
    return Template(_file(template)).substitute(values)


def _file(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
