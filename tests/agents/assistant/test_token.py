"""The token of the tool server, and who is let in: a file of this user alone, and requests by a client of our own."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import anyio
import pytest

from agents.assistant.http import BearerGuard, listening
from agents.assistant.token import default_token_file, read_or_make_token
from dsr import ConfigError, Memory
from dsr.clock import WALL_CLOCK
from dsr.network.rendezvous import free_port

INITIALIZE = {
    "jsonrpc": "2.0", "id": 1, "method": "initialize",
    "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "own", "version": "1"}},
}  # fmt: skip
ACCEPT = {"Accept": "application/json, text/event-stream", "Content-Type": "application/json"}


def test_a_token_is_made_once_for_this_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    file = default_token_file("kitchen")
    token = read_or_make_token(file)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600 and len(token) >= 43
    assert read_or_make_token(file) == token
    assert read_or_make_token(tmp_path / "other") != token


def test_files_that_are_not_safe_are_refused(tmp_path: Path) -> None:
    open_one, empty, link, folder = (tmp_path / name for name in ("open", "empty", "link", "folder"))
    read_or_make_token(open_one)
    open_one.chmod(0o640)
    empty.touch(0o600)
    link.symlink_to(empty)
    folder.mkdir()
    os.mkfifo(tmp_path / "pipe", 0o600)
    for file, error in ((open_one, "chmod 600"), (empty, "expected a token"), (tmp_path / "pipe", "chmod 600")):
        with pytest.raises(ConfigError, match=error):
            read_or_make_token(file)
    with pytest.raises(ConfigError, match="expected a file"):
        read_or_make_token(folder)
    with pytest.raises(OSError, match="symbolic links"):
        read_or_make_token(link)


def status_of(headers: list[tuple[bytes, bytes]]) -> int:
    """The status that a guard answers a request with these headers with."""
    sent: list[dict[str, object]] = []

    async def app(_scope: object, _receive: object, send: Callable[[dict[str, object]], object]) -> None:
        await send({"type": "http.response.start", "status": 200})  # type: ignore[misc]

    async def run() -> None:
        async def send(message: object) -> None:
            sent.append(message)  # type: ignore[arg-type]

        guard = BearerGuard(app, "a" * 40)  # type: ignore[arg-type]
        await guard({"type": "http", "headers": headers}, None, send)  # type: ignore[arg-type]

    anyio.run(run)
    status = sent[0]["status"]
    assert isinstance(status, int)
    return status


def test_only_the_right_token_is_let_through() -> None:
    right = b"Bearer " + b"a" * 40
    assert status_of([(b"authorization", right)]) == 200
    for wrong in (b"", b"Bearer", b"Bearer " + b"a" * 39, right + b"a", b"Basic " + b"a" * 40, b"\xff\x00", right[7:]):
        assert status_of([(b"authorization", wrong)]) == 401
    assert status_of([]) == 401
    assert status_of([(b"authorization", right), (b"authorization", right)]) == 401


@contextmanager
def serving(*options: str) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """A server in a process of its own, and its port."""
    port = free_port()
    command = [sys.executable, "-m", "dsr.cli", "assist", "serve", "--transport", "http", "--port", str(port)]
    server = subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True)
    try:
        assert server.stderr is not None and "assistants connect to" in server.stderr.readline()
        yield port, server
    finally:
        server.kill()
        server.wait(10.0)


def post(port: int, headers: dict[str, str], body: bytes = json.dumps(INITIALIZE).encode()) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
    try:
        connection.request("POST", "/mcp", body, {**ACCEPT, **headers})
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def bearer() -> dict[str, str]:
    return {"Authorization": f"Bearer {read_or_make_token(default_token_file('kitchen'))}"}


def test_a_client_of_our_own_needs_the_token_and_the_address(memory: Memory) -> None:
    with serving() as (port, server):
        assert post(port, {})[0] == 401 and post(port, {"Authorization": "Bearer nonsense"})[0] == 401
        status, text = post(port, bearer())
        assert status == 200 and "Working memory of a robot" in text
        assert post(port, {**bearer(), "Host": "evil.example"})[0] == 421
        assert post(port, {**bearer(), "Origin": "http://evil.example"})[0] == 403
        assert post(port, bearer(), b"\xff\x00 no json")[0] in (400, 415)
        assert post(port, bearer())[0] == 200
        second = subprocess.run(
            [sys.executable, "-m", "dsr.cli", "assist", "serve", "--transport", "http", "--port", str(port)],
            check=False, capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert second.returncode == 2 and f"port {port} cannot be used" in second.stderr
        assert server.poll() is None


def test_without_a_token_only_if_somebody_insists(memory: Memory) -> None:
    with serving("--no-token") as (port, _):
        assert post(port, {})[0] == 200
    assert not default_token_file("kitchen").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_client_that_never_reads_does_not_keep_the_server_from_ending(memory: Memory, number: int) -> None:
    with serving() as (port, server):
        session = _session(port)
        stalled = socket.create_connection(("127.0.0.1", port), 5.0)
        token = bearer()["Authorization"]
        stalled.sendall(
            f"GET /mcp HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAccept: text/event-stream\r\nAuthorization: {token}\r\n"
            f"mcp-session-id: {session}\r\n\r\n".encode()
        )
        half = socket.create_connection(("127.0.0.1", port), 5.0)
        half.sendall(b"POST /mcp HTTP/1.1\r\nContent-Length: 100\r\n")
        assert stalled.recv(4096).startswith(b"HTTP/1.1 200")
        begin = WALL_CLOCK.monotonic()
        server.send_signal(number)
        server.wait(30.0)
        assert WALL_CLOCK.monotonic() - begin < 25.0
        assert server.stderr is not None and "Traceback" not in server.stderr.read()
        stalled.close()
        half.close()


def _session(port: int) -> str:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
    connection.request("POST", "/mcp", json.dumps(INITIALIZE).encode(), {**ACCEPT, **bearer()})
    session = connection.getresponse().getheader("mcp-session-id")
    connection.close()
    assert session
    return session


def test_a_server_over_stdio_ends_with_ctrl_c(memory: Memory) -> None:
    command = [sys.executable, "-m", "dsr.cli", "assist", "serve"]
    server = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )  # fmt: skip
    assert server.stdin is not None and server.stdout is not None and server.stderr is not None
    try:
        server.stdin.write(json.dumps(INITIALIZE) + "\n")
        server.stdin.flush()
        assert "Working memory" in server.stdout.readline()
        server.send_signal(signal.SIGINT)
        assert server.wait(20.0) == 130
        assert "Traceback" not in server.stderr.read()
    finally:
        server.kill()
        server.wait(10.0)


@pytest.mark.parametrize(
    ("options", "error"),
    [(["--no-token"], "for --transport http"), (["--transport", "http", "--no-token", "--token-file", "f"], "exclude")],
)
def test_options_that_do_not_go_together(options: list[str], error: str, memory: Memory) -> None:
    command = [sys.executable, "-m", "dsr.cli", "assist", "serve", *options]
    result = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert result.returncode == 2 and error in result.stderr


def test_a_port_that_is_taken_is_told() -> None:
    port = free_port()
    first = listening(port)
    with pytest.raises(ConfigError, match="cannot be used"):
        listening(port)
    first.close()
