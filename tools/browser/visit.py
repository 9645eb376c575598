"""Use the page in a real browser, chromium, and say what it shows and how long it takes.

    python tools/browser/visit.py FOLDER [PICTURES]

FOLDER: where build.py wrote the pages. PICTURES: a folder for pictures of the page, as wide as a desk and as a phone.
Exits with an error where the page says that something is wrong, or does not answer.
"""

from __future__ import annotations

import base64
import fcntl
import functools
import http.server
import json
import os
import select
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

PATIENCE = 120.0  # s
SAMPLE = "bistable"  # of 128 x 128 pixels and two materials
DRAGS = 10
STATE, PROBLEM = (f"document.getElementById({name!r}).textContent" for name in ("state", "problem"))
LINK = "#sample=step&tip.radius=2e-8&interaction.contact=hertz"
DRAG = """(() => {
  const slider = document.querySelector("[id='scan.setpoint']").parentElement.querySelector("input[type=range]");
  document.getElementById("state").textContent = "";
  slider.value = 500 + 10 * %d;
  slider.dispatchEvent(new Event("input"));
})()"""
READ, WRITE = 3, 4  # the ends of the pipe that chromium has


class Browser:
    """Chromium without a screen, spoken to through a pipe."""

    def __init__(self, folder: str) -> None:
        (to_read, self._write), (self._read, to_write) = os.pipe(), os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 64) for end in (to_read, to_write)]

        def connect() -> None:
            for end, place in zip(ends, (READ, WRITE), strict=True):
                os.dup2(end, place)

        options = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--remote-debugging-pipe",
            f"--user-data-dir={folder}",
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(["chromium", *options], preexec_fn=connect, close_fds=False, **quiet)
        self._count, self._left, self._session = 0, b"", None
        target = self.do("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.do("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def do(self, method: str, **parameters: Any) -> Any:
        """What a command of the browser's protocol answers."""
        self._count += 1
        session = {"sessionId": self._session} if self._session else {}
        os.write(
            self._write,
            json.dumps({"id": self._count, "method": method, "params": parameters, **session}).encode() + b"\0",
        )
        while (answer := self._next()).get("id") != self._count:
            pass
        return answer["result"]

    def _next(self) -> Any:
        while b"\0" not in self._left:
            if not select.select([self._read], [], [], PATIENCE)[0]:
                raise TimeoutError("chromium says nothing")
            self._left += os.read(self._read, 1 << 16)
        message, self._left = self._left.split(b"\0", 1)
        return json.loads(message)

    def ask(self, script: str) -> Any:
        """The value of an expression in the page."""
        return self.do("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def wait(self, script: str) -> float:
        """Wait until an expression holds; returns how long [s]."""
        began = time.monotonic()
        while not self.ask(script):
            if time.monotonic() > began + PATIENCE:
                raise TimeoutError(f"{script}: {self.ask(STATE)} {self.ask(PROBLEM)}")
            time.sleep(0.02)
        return time.monotonic() - began

    def picture(self, path: Path, width: int, height: int) -> None:
        """Keep what is seen on a screen of this size."""
        self.do(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        time.sleep(1.0)
        path.write_bytes(base64.b64decode(self.do("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()


class Files(http.server.SimpleHTTPRequestHandler):
    """A server of files, as every static host is one."""

    def guess_type(self, path: Any) -> str:
        """The media type, also of modules."""
        return "text/javascript" if str(path).endswith(".mjs") else super().guess_type(path)

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


def visit(browser: Browser, address: str, pictures: Path | None) -> None:
    """Open the page, drag a slider, follow a link."""
    browser.do("Emulation.setDeviceMetricsOverride", width=1400, height=1000, deviceScaleFactor=1, mobile=False)
    browser.do("Page.navigate", url=f"{address}#sample={SAMPLE}")
    first = browser.wait("document.getElementById('materials')?.hidden === false")
    solved = browser.wait(f"/curves in/.test({STATE})")
    why = browser.ask("document.getElementById('why').textContent")
    print(f"first image after {first:.1f} s, curves {solved:.1f} s later: {why}")
    took = []
    for i in range(DRAGS):
        browser.ask(DRAG % i)
        browser.wait(f"/curves in/.test({STATE})")
        took.append(int(browser.ask(STATE).split()[2]))
    median, most = statistics.median(took), max(took)
    print(f"{DRAGS} drags: an image of 128 x 128 pixels within {median} ms (median), {most} ms at most")
    browser.do("Page.navigate", url="about:blank")
    browser.do("Page.navigate", url=address + LINK)
    browser.wait(f"/curves in/.test({STATE})")
    radius, law = (
        browser.ask(f"document.getElementById({key!r}).value") for key in ("tip.radius", "interaction.contact")
    )
    assert (radius, law) == ("20", "hertz"), (radius, law)
    browser.wait("document.getElementById('map-state').textContent.includes('minus')")
    assert not browser.ask(PROBLEM), browser.ask(PROBLEM)
    if pictures is not None:
        pictures.mkdir(exist_ok=True)
        browser.picture(pictures / "desk.png", 1400, 1000)
        browser.picture(pictures / "phone.png", 390, 844)


def main(folder: str, pictures: str | None = None) -> None:
    """Serve the pages, and visit them."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Files, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(profile)
        try:
            visit(browser, f"http://127.0.0.1:{server.server_port}/index.html", pictures and Path(pictures))
        finally:
            browser.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
