"""The page in Firefox, which is spoken to by its own protocol, Marionette: lengths and JSON over a socket."""

import json
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
PATIENCE_S = 120  # on a loaded machine
Command = Callable[..., object]  # of a name and arguments; returns its value
pytestmark = pytest.mark.skipif(FIREFOX is None, reason="Firefox is not installed")


def wait_for(attempt: Callable[[], object], what: str) -> None:
    """Waits until an attempt returns something true."""
    deadline = time.monotonic() + PATIENCE_S
    while not attempt():
        assert time.monotonic() < deadline, what
        time.sleep(0.2)


@pytest.fixture
def firefox(tmp_path: Path) -> Iterator[Command]:
    """A Firefox without a window, with a profile of its own; yields what sends it a command."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = free.getsockname()
    (tmp_path / "user.js").write_text(f'user_pref("marionette.port", {address[1]});\n', encoding="utf-8")
    command = [str(FIREFOX), "--headless", "--marionette", "--profile", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    connection = socket.socket()
    try:
        wait_for(lambda: connection.connect_ex(address) == 0, "Firefox does not answer")
        connection.settimeout(PATIENCE_S)
        stream = connection.makefile("rb")

        def receive() -> list[dict[str, object]]:
            length = b""
            while (byte := stream.read(1)) != b":":
                length += byte
            received: list[dict[str, object]] = json.loads(stream.read(int(length)))
            return received

        def send(name: str, **arguments: object) -> object:
            text = json.dumps([0, 1, name, arguments]).encode()
            connection.sendall(f"{len(text)}:".encode() + text)
            _, _, error, result = receive()
            assert not error, error
            return result.get("value")

        receive()  # its greeting
        send("WebDriver:NewSession")
        yield send
    finally:
        connection.close()
        process.kill()
        process.wait()


def test_explorer_walks_in_firefox(firefox: Command, results: Path) -> None:
    def evaluate(script: str) -> object:
        return firefox("WebDriver:ExecuteScript", script=f"return {script}", args=[])

    firefox("WebDriver:Navigate", url=(results / "index.html").as_uri())
    wait_for(lambda: evaluate('!document.getElementById("explore").hidden'), "the explorer does not start")
    assert evaluate('document.querySelectorAll(".map svg polygon").length > 100')
    evaluate('document.getElementById("walk-one").click()')
    walked = evaluate(
        '[...document.querySelectorAll(".walked")].map((each) => each.textContent.slice(0, 11))'
    )
    assert walked == ["1 step from"] * 2
    assert evaluate("document.documentElement.scrollWidth <= innerWidth")
