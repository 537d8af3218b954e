"""The page's script and its data, as the page holds them."""

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Final

_MODULES: Final = Path(__file__).parent / "templates" / "script"
_IMPORT: Final = re.compile(r'^import (?:\{[^}]*\} from )?"\./(\w+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export ", re.MULTILINE)


def read() -> str:
    """Returns `main.js` and all modules that it needs as one script, each module after those that it imports.

    The page is one file, which cannot import others. All modules share one scope, so their top-level names
    must differ.
    """
    texts: dict[str, str] = {}

    def add(name: str) -> None:
        text = (_MODULES / name).read_text(encoding="utf-8")
        for needed in _IMPORT.findall(text):
            if needed not in texts:
                add(needed)
        texts[name] = _EXPORT.sub("", _IMPORT.sub("", text))

    add("main.js")
    return "\n".join(texts.values())


def pack(data: object) -> str:
    """Returns data as JSON, compressed to less than half, in base64."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")
