"""Terms in the text of the page: each is explained where it first appears."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from markupsafe import Markup

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
        Word(f"{prefix}-{i}", term, Markup(_EMPHASIS.sub(r"<em>\1</em>", str(text))))
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
        """Marks terms in a text without tags; of those that start at one place, the longest."""
        matches = [
            (match, word)
            for word in self.words
            if word.key not in self._marked and (match := word.pattern.search(text))
        ]
        shown, end = "", 0
        for match, word in sorted(matches, key=lambda each: (each[0].start(), -each[0].end())):
            if match.start() < end:
                continue  # within another term; the next text that has it gets the mark
            self._marked.add(word.key)
            shown += (
                f'{text[end : match.start()]}<button type="button" class="term" popovertarget="{word.key}">'
                f"{match[0]}</button>"
            )
            end = match.end()
        return shown + text[end:]
