"""A headless Chromium, driven through its debugging pipe: what the tests of pages need of it, nothing to install."""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--mute-audio",
)
WAIT_MS = 60_000


class Browser:
    """A page in a browser of its own.

    Attributes:
        errors: what the console said that is an error, and what was raised.
    """

    def __init__(self, profile: Path, width: int = 1280, height: int = 900) -> None:
        assert CHROMIUM is not None
        from_me, self._to = os.pipe()
        self._from, to_me = os.pipe()

        def connect() -> None:
            spare = [os.dup(end) for end in (from_me, to_me)]
            for end, wanted in zip(spare, (3, 4), strict=True):
                os.dup2(end, wanted)

        command = [CHROMIUM, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            command, preexec_fn=connect, close_fds=False, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        os.close(from_me)
        os.close(to_me)
        self._rest, self._count, self._session = b"", 0, ""
        self.errors: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.size(width, height)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the debugging protocol and return its answer, noting errors that are told meanwhile."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            told = self._read()
            if told.get("id") == self._count:
                assert "error" not in told, told
                answer: dict[str, Any] = told["result"]
                return answer

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = os.read(self._from, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        line, _, self._rest = self._rest.partition(b"\0")
        told: dict[str, Any] = json.loads(line)
        what, of = told.get("method"), told.get("params", {})
        if what == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(of["exceptionDetails"]))
        elif what == "Log.entryAdded" and of["entry"]["level"] == "error":
            self.errors.append(of["entry"]["text"])
        elif what == "Runtime.consoleAPICalled" and of["type"] in ("error", "assert"):
            self.errors.append(json.dumps(of["args"]))
        return told

    def size(self, width: int, height: int, dark: bool = False) -> None:
        """Set the window's size [CSS pixels], and whether the system is dark."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=features)

    def open(self, file: Path, ready: str = "true") -> None:
        """Open a file and wait until an expression holds in it."""
        self.call("Page.navigate", url=file.absolute().as_uri())
        self.wait(f"document.readyState === 'complete' && location.href.startsWith('file:') && ({ready})")

    def wait(self, expression: str) -> None:
        """Wait until an expression holds."""
        asked = f"""new Promise((done, failed) => {{
            const begun = Date.now();
            const look = () => {{
                if ({expression}) done(true);
                else if (Date.now() - begun > {WAIT_MS}) failed(new Error("never so"));
                else setTimeout(look, 20);
            }};
            look();
        }})"""
        assert self.ask(asked) is True, expression

    def ask(self, expression: str) -> Any:
        """Return an expression's value, of a promise what it gives."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press and release a key, by its name and its key code."""
        text = {"text": "\r"} if key == "Enter" else {"text": " "} if key == " " else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)

    def picture(self, file: Path, whole: bool = False) -> None:
        """Save a picture of the window, or of the whole page."""
        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        file.write_bytes(base64.b64decode(data))

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(20)
        os.close(self._to)
        os.close(self._from)
