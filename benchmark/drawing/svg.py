"""Makes matplotlib's SVG small, the same on every machine, and readable in dark mode.

Styles become classes. In dark mode, their greys are inverted, and dark colours lighter.
"""

import re
from collections.abc import Mapping
from typing import Final

FONTS: Final = "'DejaVu Sans', Verdana, sans-serif"  # Verdana is as wide
_DARK_INK: Final = (230, 233, 236)  # what black becomes
_DARK_PAPER: Final = (20, 23, 26)  # what white becomes
_LEFT_OUT: Final = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<!--.*?-->|<metadata>.*?</metadata>", re.DOTALL)
_TAG: Final = re.compile(r"<[a-z][^>]*>")
_LENGTHS: Final = re.compile(r' (?:d|x|y|width|height|transform|stroke-miterlimit)="[^"]*"')
_NUMBER: Final = re.compile(r"-?\d*\.\d+(?:e-?\d+)?")
_ID: Final = re.compile(r' id="([^"]*)"')
_STYLE: Final = re.compile(r' style="([^"]*)"')
_COLOUR: Final = re.compile("#[0-9a-f]{6}")
_ALONE: Final = re.compile(r"<g>\s*(<[^<>]*/>|<text[^<]*</text>)\s*</g>")  # a group of one
_EMPTY: Final = re.compile(r"<(g|defs)>\s*</\1>|<(g|defs) ?/>")


def compact(text: str, in_dark: Mapping[str, str]) -> str:
    """Returns matplotlib's SVG, which has texts as texts, smaller and with colours for dark mode.

    `in_dark` has these by the colours of light mode, "#rrggbb"; others stay, except greys.
    """
    text = _TAG.sub(_rounded, _LEFT_OUT.sub("", text))
    text = re.sub(r' transform="rotate\(-?0 [^"]*"', "", text)
    # Ids are digests of unrounded numbers, which may differ in the last digit.
    used = {*re.findall(r'(?:href="|url\()#([^")]*)', text)}
    numbers = {name: f"i{i}" for i, name in enumerate(name for name in _ID.findall(text) if name in used)}
    text = _ID.sub(lambda match: f' id="{numbers[match[1]]}"' if match[1] in used else "", text)
    text = re.sub(r'((?:href="|url\()#)([^")]*)', lambda match: match[1] + numbers[match[2]], text)
    text, classes = _classes(text)
    while (shorter := _EMPTY.sub("", _ALONE.sub(r"\1", text))) != text:
        text = shorter
    plain = "".join(f".{name}{{{style}}}" for style, name in classes.items())
    darker = [(name, _in_dark(style, in_dark)) for style, name in classes.items()]
    dark = "".join(f".{name}{{{style}}}" for name, style in darker if style)
    dark = f"@media (prefers-color-scheme:dark){{svg{{fill:{_hex(_DARK_INK)}}}{dark}}}"
    text = re.sub("<style.*?</style>", "", text, flags=re.DOTALL)
    style = f"<style>*{{stroke-linejoin:round;stroke-linecap:butt}}{plain}{dark}</style>"
    text = re.sub("(<svg[^>]*>)", lambda match: match[1] + style, text, count=1)
    return re.sub(r"\s*\n\s*", "\n", text).strip() + "\n"


def _rounded(tag: "re.Match[str]") -> str:
    """Returns a tag with rounded lengths. Markers, which have an id, are small and keep two decimals."""
    decimals = 2 if _ID.search(tag[0]) or " transform=" in tag[0] else 1

    def shorten(attribute: "re.Match[str]") -> str:
        numbers = _NUMBER.sub(lambda match: f"{round(float(match[0]), decimals) + 0.0:g}", attribute[0])
        return re.sub(r"\s*\n\s*", " ", numbers)

    return _LENGTHS.sub(shorten, tag[0])


def _classes(text: str) -> tuple[str, dict[str, str]]:
    """Returns the SVG with classes in place of styles, and the class of each style."""
    classes: dict[str, str] = {}

    def name(match: "re.Match[str]") -> str:
        style = re.sub(r"'DejaVu Sans'[^;]*", FONTS, match[1].replace("&quot;", "'"))
        style = re.sub(r"\s*([:;])\s*", r"\1", style).strip("; ")
        style = _NUMBER.sub(lambda number: f"{float(number[0]):.4g}", style)
        return f' class="{classes.setdefault(style, f"c{len(classes)}")}"'

    return _STYLE.sub(name, text), classes


def _in_dark(style: str, in_dark: Mapping[str, str]) -> str:
    """Returns those parts of a style that are different in dark mode."""

    def darker(match: "re.Match[str]") -> str:
        red, green, blue = bytes.fromhex(match[0][1:])
        if not red == green == blue:
            return in_dark.get(match[0], match[0])
        ends = zip(_DARK_INK, _DARK_PAPER, strict=True)
        return _hex(tuple(round(ink + red / 255 * (paper - ink)) for ink, paper in ends))

    return ";".join(other for part in style.split(";") if (other := _COLOUR.sub(darker, part)) != part)


def _hex(colour: tuple[int, ...]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
