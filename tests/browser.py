"""A page in a real browser without a window: its width and its theme are set while it is open."""

import base64
import contextlib
import io
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
PATIENCE = 60.0
"""Seconds that the browser may take for one answer."""
# Remarks of the graphics driver on its own speed are no errors.
DRIVER = ("GL Driver Message", "Canvas2D")


class Page:
    """An open page, spoken to by the DevTools protocol; `console` and `asked` collect what it
    complains of and what addresses it asks for."""

    def __init__(self, browser: subprocess.Popen[bytes]):
        self._browser, self._number, self._session = browser, 0, {}
        self._rest = b""
        self.console: list[str] = []
        self.asked: list[str] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self._session = {"sessionId": session}
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """What the browser answers to a command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params, **self._session}
        assert self._browser.stdin is not None
        self._browser.stdin.write(json.dumps(message).encode() + b"\0")
        self._browser.stdin.flush()
        for answer in self._messages():
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self._note(answer)
        raise AssertionError(f"The browser ended at {method}.")

    def run(self, script: str) -> Any:
        """The value of an expression of JavaScript in the page, once it is there."""
        found = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, script: str) -> None:
        """Until an expression of JavaScript is true in the page."""
        end = time.monotonic() + PATIENCE
        while not self.run(script):
            assert time.monotonic() < end, f"{script} never came true: {self.console}"
            time.sleep(0.02)

    def window(self, width: int, height: int, dark: bool) -> None:
        """Give the page this width and height in pixels, and a light or a dark theme."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", **size)
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[theme])

    def picture(self, name: str) -> np.ndarray:
        """What is seen of the element with this id: rows, columns, and red, green, blue, 0 to 1."""
        rectangle = f"document.getElementById('{name}').getBoundingClientRect()"
        box = self.run(f"(b => [b.x + scrollX, b.y + scrollY, b.width, b.height])({rectangle})")
        clip = dict(zip(("x", "y", "width", "height"), box, strict=True)) | {"scale": 1}
        shot = self.send("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        return imread(io.BytesIO(base64.b64decode(shot["data"])))[..., :3]

    def _messages(self) -> Iterator[dict[str, Any]]:
        assert self._browser.stdout is not None
        while True:
            *whole, self._rest = self._rest.split(b"\0")
            for k, message in enumerate(whole):
                # What comes after the answer waits for the next question.
                self._rest = b"\0".join([*whole[k + 1 :], self._rest])
                yield json.loads(message)
                break
            else:
                ready, _, _ = select.select([self._browser.stdout], [], [], PATIENCE)
                more = os.read(self._browser.stdout.fileno(), 1 << 20) if ready else b""
                if not more:
                    return
                self._rest += more

    def _note(self, event: dict[str, Any]) -> None:
        given = event.get("params", {})
        if event["method"] == "Network.requestWillBeSent":
            self.asked.append(given["request"]["url"])
        elif event["method"] == "Runtime.exceptionThrown":
            self.console.append(str(given["exceptionDetails"]))
        elif event["method"] == "Runtime.consoleAPICalled":
            self._complain(" ".join(str(a.get("value", a)) for a in given["args"]))
        elif event["method"] == "Log.entryAdded":
            self._complain(given["entry"]["text"])

    def _complain(self, text: str) -> None:
        if not any(word in text for word in DRIVER):
            self.console.append(text)


@contextlib.contextmanager
def open_page(url: str, folder: Path, width: int = 1600, dark: bool = False) -> Iterator[Page]:
    """The page at this address; `folder` holds what the browser keeps of its user."""
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += ["--enable-unsafe-swiftshader", f"--user-data-dir={folder / 'user'}"]
    command += ["--remote-debugging-pipe", "about:blank"]
    # The browser listens at descriptor 3 and answers at 4; its own output is not of interest.
    shell = ["sh", "-c", 'exec "$@" 3<&0 4>&1 0</dev/null 1>&2', "sh", *command]
    browser = subprocess.Popen(
        shell, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0
    )
    try:
        page = Page(browser)
        page.window(width, 900, dark)
        page.send("Page.navigate", url=url)
        yield page
    finally:
        browser.kill()
        browser.communicate()
