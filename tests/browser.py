"""A real browser, which tests ask what it makes of a page."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needed = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")


def seen(address: str, folder: Path) -> str:
    """What a browser makes of the page: its document, a minute of its own time later."""
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run")
    flags += ("--disable-background-networking", "--disable-component-update", "--disable-sync")
    waits = ("--virtual-time-budget=60000", f"--user-data-dir={folder}", "--dump-dom")
    command = [str(CHROMIUM), *flags, *waits, address]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
