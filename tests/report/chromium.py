"""A page opened in Chromium without a window or a network."""

import shutil
import subprocess

import pytest

OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--virtual-time-budget=15000",
)


def drawn(path, profile):
    """The document of the page at `path` after its scripts have run; `profile` is a folder for the browser."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not chromium:
        pytest.skip("no Chromium here: install chromium to check the drawn page")
    words = [chromium, *OPTIONS, f"--user-data-dir={profile}", "--dump-dom", path.as_uri()]
    return subprocess.run(words, capture_output=True, text=True, timeout=300).stdout
