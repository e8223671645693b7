"""Chromium without a window, by its driver."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium: pip install 'orip[browser]'")

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")

needs_chromium = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="needs Chromium and its driver: apt install chromium chromium-driver"
)

_OPTIONS = (
    "--headless=new --disable-quic --no-first-run --disable-background-networking --disable-component-update "
    "--disable-sync"
)


@contextmanager
def chromium(profile: Path, options: str, *logs: str, trace: str = "") -> Iterator[Any]:
    """Open a browser with a profile folder, more options, the logs and the parts of the trace that are wanted."""
    wanted = webdriver.ChromeOptions()
    wanted.binary_location = CHROMIUM
    for word in [*_OPTIONS.split(), *options.split(), f"--user-data-dir={profile}"]:
        wanted.add_argument(word)
    if os.geteuid() == 0:
        wanted.add_argument("--no-sandbox")  # Chromium's own sandbox does not start for root
    wanted.set_capability("goog:loggingPrefs", dict.fromkeys(logs, "ALL"))
    if trace:
        wanted.add_experimental_option("perfLoggingPrefs", {"traceCategories": trace})
    driver = webdriver.Chrome(options=wanted, service=webdriver.ChromeService(DRIVER))
    try:
        yield driver
    finally:
        driver.quit()
