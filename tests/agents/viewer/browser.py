"""A headless browser that opens a page and tells what it looks like after a while."""

from __future__ import annotations

import base64
import contextlib
import functools
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import msgspec
import numpy as np
from websockets.sync.client import connect

from dsr.clock import WALL_CLOCK

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
"""A browser that is installed; None if there is none."""
_PORT_FILE = "DevToolsActivePort"
_ROUNDS, _PERIOD = 600, 0.1
_ANSWER = 120.0  # s; a busy machine draws slowly


class Browser:
    """A page in a headless browser without a graphics card; a context manager that ends the browser."""

    def __init__(self, page: str, folder: Path) -> None:
        self._folder = folder / "profile"
        command = [str(PROGRAM), "--headless=new", "--no-sandbox", "--window-size=1400,900", page]
        command += ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        command += [f"--user-data-dir={self._folder}", "--remote-debugging-port=0"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()

    def click(self, x: int, y: int) -> None:
        """Press and release the left button there; px from the left and from the top of the page."""
        with self._page() as ask:
            for kind, buttons in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
                place = {"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1}
                ask("Input.dispatchMouseEvent", **place)

    def picture(self) -> Any:
        """(h, w, 3) uint8, what the page looks like now."""
        with self._page() as ask:
            answer = ask("Page.captureScreenshot")
        encoded = np.frombuffer(base64.b64decode(answer["data"]), np.uint8)
        return cv2.cvtColor(cv2.imdecode(encoded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    @contextlib.contextmanager
    def _page(self) -> Iterator[Callable[..., Any]]:
        """A function that gives the page a command of the Chrome DevTools Protocol and returns the answer."""
        port, path = self._address()
        with connect(f"ws://127.0.0.1:{port}{path}", max_size=None) as socket:
            targets = _ask(socket, "Target.getTargets")["targetInfos"]
            page = next(target["targetId"] for target in targets if target["type"] == "page")
            session = _ask(socket, "Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
            yield functools.partial(_ask, socket, session=session)

    def _address(self) -> tuple[str, str]:
        file = self._folder / _PORT_FILE
        for _ in range(_ROUNDS):
            if file.exists() and len(lines := file.read_text().splitlines()) == 2:
                return lines[0], lines[1]
            WALL_CLOCK.wait(threading.Event(), _PERIOD)
        raise AssertionError("the browser does not start")


def _ask(socket: Any, method: str, session: str | None = None, **parameters: Any) -> Any:
    """The answer to one command of the Chrome DevTools Protocol."""
    command = {"id": 1, "method": method, "params": parameters, **({"sessionId": session} if session else {})}
    socket.send(msgspec.json.encode(command).decode())
    while True:
        message = msgspec.json.decode(socket.recv(timeout=_ANSWER))
        if message.get("id") == 1:
            return message["result"]
