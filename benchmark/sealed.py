"""JSON files that carry a digest of their content, by which a change of any value is noticed."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Final

SEAL: Final = "sha256"  # the last key: the digest of all others, as JSON with sorted keys


def sealed(content: Mapping[str, Any], indent: int) -> str:
    """Returns a file's text with its digest, which replaces an earlier one."""
    unsealed = {key: value for key, value in content.items() if key != SEAL}
    return json.dumps(unsealed | {SEAL: _digest(unsealed)}, indent=indent) + "\n"


def unsealed(text: bytes) -> dict[str, Any]:
    """Returns the content of such a file, digest included; raises a ValueError if it does not match."""
    content = dict(json.loads(text))
    if content.get(SEAL) != _digest({key: value for key, value in content.items() if key != SEAL}):
        raise ValueError(f"{SEAL} is not the digest of the content")
    return content


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
