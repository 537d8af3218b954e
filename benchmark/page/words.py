"""Terms in the text of the page: each is explained where it first appears."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from markupsafe import Markup, escape

_TAG: Final = re.compile(r"(<[^>]+>)")
_OPAQUE: Final = ("a", "code", "button")  # elements in which no term is looked for
_EMPHASIS: Final = re.compile(r"(?<!\w)\*(\w[^*]*)\*(?!\w)")  # `*x*` in an explanation


@dataclass(frozen=True)
class Word:
    """A term of a report, with its explanation."""

    key: str  # the id of its explanation on the page
    term: str
    text: Markup

    @property
    def pattern(self) -> "re.Pattern[str]":
        """Matches the term's names in the singular and the plural.

        A term such as `interquartile mean (iqm)` or `greedy, stochastic` has several names.

        >>> Word("", "intervals", Markup("")).pattern.findall("Interval, intervals, intervallic")
        ['Interval', 'intervals']
        """
        outside, _, inside = self.term.partition("(")
        names = [name.strip() for name in outside.split(",")]
        names += [inside.rstrip(")")] if inside and " " not in inside else []
        stems = [re.sub(r"(?<=[^s]{2})s$", "", name) for name in names]
        either = "|".join(_of_either_case(stem) for stem in stems)
        return re.compile(rf"(?<![\w-])(?:{either})(?:e?s)?(?![\w-])")


def _of_either_case(name: str) -> str:
    """Returns a pattern for a name, which may start a sentence; a symbol such as P keeps its case."""
    if len(name) < 3 or not name[0].islower():
        return re.escape(name)
    return f"[{name[0].upper()}{name[0]}]{re.escape(name[1:])}"


def words_of(prefix: str, words: Iterable[tuple[str, Markup]]) -> list[Word]:
    """Returns the terms of a report, each with an id that starts with a prefix."""
    return [
        Word(f"{prefix}-{i}", term, Markup(_EMPHASIS.sub(r"<em>\1</em>", text)))
        for i, (term, text) in enumerate(words)
    ]


@dataclass
class Marker:
    """Marks the first occurrence of each term in the texts that it is given, in their order."""

    words: Sequence[Word]
    _marked: set[str] = field(default_factory=set)

    def __call__(self, text: Markup) -> Markup:
        """Returns HTML in which terms that have not been met before are buttons that show what they mean."""
        parts = _TAG.split(text)
        depth = 0
        for i, part in enumerate(parts):
            if i % 2:
                name = part.strip("</>").split(" ")[0]
                depth += (-1 if part.startswith("</") else 1) if name in _OPAQUE else 0
            elif not depth:
                parts[i] = self._mark(part)
        return Markup("".join(parts))

    def _mark(self, text: str) -> str:
        """Marks terms in a text without tags: at each place the longest name, each term once."""
        found: list[tuple[int, int, Word]] = []
        for word in self.words:
            if word.key not in self._marked and (match := word.pattern.search(text)):
                found.append((match.start(), -match.end(), word))
        shown, end = "", 0
        for start, negative_end, word in sorted(found, key=lambda each: each[:2]):
            if start < end:
                continue  # within another term; its next occurrence is marked
            self._marked.add(word.key)
            name = text[start:-negative_end]
            shown += (
                f'{text[end:start]}<button type="button" class="term" popovertarget="{escape(word.key)}">'
            )
            shown += f"{name}</button>"
            end = -negative_end
        return shown + text[end:]
