"""The page in Firefox, which is spoken to by its own protocol, Marionette: lengths and JSON over a socket."""

import json
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
pytestmark = pytest.mark.skipif(FIREFOX is None, reason="Firefox is not installed")
Command = Callable[..., Any]  # of a name and arguments; returns its value
_PATIENCE_S = 120  # on a loaded machine


@pytest.fixture
def firefox(tmp_path: Path) -> Iterator[Command]:
    """A Firefox without a window, with a profile of its own; yields what sends it a command."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (tmp_path / "user.js").write_text(f'user_pref("marionette.port", {port});\n', encoding="utf-8")
    command = [str(FIREFOX), "--headless", "--marionette", "--profile", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        connection = _connect(port)
        with connection, connection.makefile("rb") as stream:

            def receive() -> Any:
                length = b""
                while (byte := stream.read(1)) != b":":
                    length += byte
                return json.loads(stream.read(int(length)))

            def send(name: str, **arguments: object) -> Any:
                text = json.dumps([0, 1, name, arguments]).encode()
                connection.sendall(f"{len(text)}:".encode() + text)
                _, _, error, result = receive()
                assert error is None, error
                return result["value"] if set(result) == {"value"} else result

            receive()  # its greeting
            send("WebDriver:NewSession")
            yield send
    finally:
        process.kill()
        process.wait()


def _connect(port: int) -> socket.socket:
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=_PATIENCE_S)
        except OSError:
            assert time.monotonic() < deadline, "Firefox does not answer"
            time.sleep(0.2)


def test_explorer_walks_in_firefox(firefox: Command, results: Path) -> None:
    def evaluate(script: str) -> Any:
        return firefox("WebDriver:ExecuteScript", script=f"return {script}", args=[])

    firefox("WebDriver:Navigate", url=(results / "index.html").as_uri())
    deadline = time.monotonic() + _PATIENCE_S
    while evaluate('document.getElementById("explore").hidden'):
        assert time.monotonic() < deadline, "the explorer does not start"
        time.sleep(0.2)
    assert evaluate('document.querySelectorAll(".map svg polygon").length') > 100
    evaluate('document.getElementById("walk-one").click()')
    walked = evaluate('[...document.querySelectorAll(".walked")].map((each) => each.textContent)')
    assert len(walked) == 2
    assert all(text.startswith("1 step from") for text in walked)
    assert evaluate("document.documentElement.scrollWidth <= innerWidth")
