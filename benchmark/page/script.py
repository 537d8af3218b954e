"""The page's script and its data, as the page holds them."""

import base64
import gzip
import json
from pathlib import Path
from typing import Final

_TEMPLATES: Final = Path(__file__).parent / "templates"


def read() -> str:
    """Returns the script."""
    return (_TEMPLATES / "page.js").read_text(encoding="utf-8")


def pack(data: object) -> str:
    """Returns data as JSON, compressed to less than half, in base64."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")
