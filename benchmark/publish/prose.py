"""Texts written by hand, whose numbers are looked up in published tables and whose claims are checked.

The finding of an experiment is a template beside its file: of `when.toml`, it is `when.md.jinja`. If there is
a function `finding` in `when.py`, it checks the claims and returns what the template can name, see
`benchmark.experiments.finding`. The first paragraph is the answer. A paragraph may start with a title in
bold, by which the README of this repository includes it, and those without a title after it. Results of other
seeds have no such text.
"""

import re
import runpy
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from benchmark.experiments import EXPERIMENT_DIRECTORY, experiment_names
from benchmark.experiments.finding import Names, Tables
from benchmark.folder import Folder
from benchmark.publish.templates import mistakes_in, rendered
from envs import InputError

_TITLE: Final = re.compile(r"^\*\*(.+?)\.\*\* ", re.MULTILINE)


class ClaimError(InputError):
    """The tables do not show what a text claims."""


def written(folder: Folder, template: Path | None = None) -> str | None:
    """Returns the text written for a folder of results, in Markdown; None if there is none for these runs.

    The template is by default that of a shipped experiment. A mistake in it, or citing what the tables
    lack, raises an InputError; a claim that they do not show, a ClaimError. On another type of
    processor nets learn differently, so there a claim can fail without any error.
    """
    manifest = folder.manifest
    if template is None and manifest.get("argument") in experiment_names():
        template = EXPERIMENT_DIRECTORY / f"{manifest['argument']}.md.jinja"
    if template is None or not template.is_file() or " --seeds " in manifest.get("command", ""):
        return None
    tables = Tables(folder)
    known = {"rows": tables.rows, "row": tables.row, "values": tables.values, "number": tables.number}
    known |= {"numbers": tables.numbers, "count": tables.count, "claim": tables.claim}
    named = _named(template.with_name(f"{template.name.partition('.')[0]}.py"), tables)
    text = rendered(template, {**known, **named})
    if tables.failed:
        where = f"{folder.path}: its tables do not show, as {template.name} claims,"
        raise ClaimError(*(f"{where} that {claim}." for claim in tables.failed))
    paragraphs = [" ".join(paragraph.split()) for paragraph in text.split("\n\n")]
    return "\n\n".join(filter(None, paragraphs))


def _named(path: Path, tables: Tables) -> Names:
    """Returns a Python file's texts, by their names in lower case, and what `finding` returns."""
    if not path.is_file():
        return {}
    with mistakes_in(path):
        module = runpy.run_path(str(path))
        texts = {key.lower(): text for key, text in module.items() if key.isupper() and isinstance(text, str)}
        names = module["finding"](tables) if "finding" in module else {}
    if not isinstance(names, Mapping):
        raise InputError(f"{path}: finding returns {names!r}; accepted: names, each with what it stands for.")
    return {**texts, **names}


def paragraphs(folder: Folder, title: str = "") -> str:
    """Returns a folder's text under a title, by default before the first, as one paragraph."""
    first, *others = _TITLE.split(written(folder) or "")
    titled = {name: f"**{name}.** {text}" for name, text in zip(others[::2], others[1::2], strict=True)}
    return " ".join(({"": first} | titled)[title].split())
