"""Templates of Jinja, of which texts, documents and the page are made."""

from pathlib import Path
from textwrap import fill

import jinja2

from benchmark.drawing import tables


def templates_in(folder: Path, *, is_html: bool = False) -> jinja2.Environment:
    """Returns the templates in a folder: of HTML, or of Markdown, with filters for texts and numbers."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=is_html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"text": tables.paragraph, "number": tables.show, "plain": tables.plain}
    environment.filters["wrapped"] = _wrapped
    return environment


def _wrapped(text: str, indent: str = "") -> str:
    """Returns a paragraph in lines, all but the first of which are indented."""
    filled = fill(text, 118, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return f"{filled}\n"
