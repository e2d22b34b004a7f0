"""A real browser without a window, for tests of pages: Debian's Chromium, driven by Selenium."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.terminal import children
from tests.waiting import PATIENCE

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
WITHOUT = "" if CHROMIUM and DRIVER else "no Chromium: `apt-get install chromium chromium-driver`"
"""Why there is no browser; empty: there is."""
QUIETLY = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
PHONE = {"width": 390, "height": 780, "deviceScaleFactor": 2, "mobile": True}
"""[px] of the screen of a telephone."""


class Browser:
    """A browser with nothing in it but what a test opens."""

    def __init__(self, profile: str) -> None:
        """Start it."""
        options = Options()
        options.binary_location = CHROMIUM or ""
        for one in (*QUIETLY, f"--user-data-dir={profile}", "--window-size=1100,760"):
            options.add_argument(one)
        service = Service(DRIVER)
        self.driver = webdriver.Chrome(options=options, service=service)
        self.driver.set_page_load_timeout(60)
        self._service: Any = service

    def command(self, name: str, **values: object) -> Any:
        """Say something to the browser in its own protocol (Chrome DevTools Protocol)."""
        return self.driver.execute_cdp_cmd(name, values)  # pyright: ignore[reportUnknownMemberType] # left open there

    def be_a_phone(self) -> None:
        """Have the screen of a telephone, and fingers."""
        self.command("Emulation.setDeviceMetricsOverride", **PHONE)
        self.command("Emulation.setTouchEmulationEnabled", enabled=True)

    def run(self, script: str, *given: object) -> Any:
        """Run JavaScript in the page, and return what it returns."""
        return self.driver.execute_script(script, *given)  # type: ignore[no-untyped-call]

    def shows(self, *words: str, at: str = "screen") -> None:
        """Wait until these words are in a part of the page."""
        text = ""
        latest = time.monotonic() + PATIENCE
        while not all(word in text for word in words):
            assert time.monotonic() < latest, f"in vain: the page shows {words}:\n{text}"
            text = self.run("return document.getElementById(arguments[0])?.innerText ?? ''", at)
            text = text.replace("\xa0", " ")

    def types(self, *keys: str) -> None:
        """Press keys."""
        self.driver.switch_to.active_element.send_keys(*keys)

    def touches(self, label: str) -> None:
        """Touch a button of the bar of keys in its middle."""
        button = self.driver.find_element(By.XPATH, f"//nav/button[normalize-space()='{label}']")
        place = cast("dict[str, float]", button.rect)  # pyright: ignore[reportUnknownMemberType] # left open there
        point = {"x": place["x"] + place["width"] / 2, "y": place["y"] + place["height"] / 2}
        self.command("Input.dispatchTouchEvent", type="touchStart", touchPoints=[point])
        self.command("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def kill(self) -> None:
        """End all its processes at once."""
        family = [self._service.process.pid]
        for one in family:
            family += children(one)
        for one in reversed(family):
            with contextlib.suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)

    def quit(self) -> None:
        """Close it, and see that nothing of it is left."""
        with contextlib.suppress(Exception):  # it may have been killed
            self.driver.quit()
        with contextlib.suppress(OSError):
            self.kill()


@pytest.fixture
def open_browser() -> Iterator[Callable[[], Browser]]:
    """Open browsers, and close them behind the test."""
    opened = list[Browser]()
    with tempfile.TemporaryDirectory(prefix="rt-", ignore_cleanup_errors=True) as folder:

        def begin() -> Browser:
            opened.append(Browser(tempfile.mkdtemp(dir=folder)))
            return opened[-1]

        yield begin
        for one in opened:
            one.quit()


__all__ = ["WITHOUT", "Browser", "Keys", "open_browser"]
