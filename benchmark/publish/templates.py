"""Templates of Jinja, of which texts, documents and the page are made."""

import re
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import Final

import jinja2
from jinja2.sandbox import SandboxedEnvironment

from benchmark.drawing import tables
from envs import InputError

# Methods of data frames and arrays that compute. Others run code or write files: `query`, `apply`, `to_csv`.
_COMPUTING: Final = re.compile(
    "abs|all|any|between|contains|count|diff|drop_duplicates|dropna|duplicated|endswith|eq|first|ge|get|groupby"
    "|gt|head|idxmax|idxmin|iloc|isin|isna|items|last|le|loc|lt|max|mean|median|min|ne|notna|nunique|pivot"
    "|quantile|rank|reset_index|round|set_index|size|sort_values|startswith|std|sum|tail|to_dict|to_list"
    "|to_numpy|tolist|unique|value_counts|values"
)


class _Sandbox(SandboxedEnvironment):
    """Templates that reach neither private attributes nor, by data frames, files and code."""

    def is_safe_attribute(self, obj: object, attr: str, value: object) -> bool:
        is_data = type(obj).__module__.partition(".")[0] in ("numpy", "pandas")
        is_computing = not (is_data and callable(value)) or _COMPUTING.fullmatch(attr)
        return bool(is_computing) and super().is_safe_attribute(obj, attr, value)


def templates_in(folder: Path, *, is_html: bool = False) -> jinja2.Environment:
    """Returns the templates in a folder: of HTML, or of Markdown, with filters for texts and numbers."""
    environment = _Sandbox(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=is_html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"number": tables.show, "wrapped": _wrapped}
    return environment


def rendered(template: Path, known: Mapping[str, object]) -> str:
    """Returns the text of a template; one with a mistake raises an InputError that names file and line."""
    with mistakes_in(template):
        return templates_in(template.parent).get_template(template.name).render(known)


@contextmanager
def mistakes_in(path: Path) -> Iterator[None]:
    """Turns whatever a file does wrong, such as dividing by zero, into an InputError with file and line."""
    try:
        yield
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        line = getattr(error, "lineno", None) or [0, *lines][-1]
        reason = f"column {error} is missing" if isinstance(error, KeyError) else str(error).rstrip(".")
        raise InputError(f"{path}, line {line}: {reason or type(error).__name__}.") from error


def _wrapped(text: str, indent: str = "") -> str:
    """Returns a paragraph in lines, all but the first of which are indented."""
    filled = fill(text, 118, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return f"{filled}\n"
