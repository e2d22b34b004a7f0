"""How soon the full screen is there in a browser, beside a page without one.

    python bench/browser.py [--times 9]

A headless Chromium opens `robotree web` (a realm with a lookup service and nothing else), and, alternately,
the same page without a token, which loads the same files and shows one sentence. Measured by the page's own
clock, from the beginning of the navigation to the frame in which the words are there.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

QUIETLY = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
SEEN = """
const [id, words, done] = arguments;
const look = () => document.getElementById(id).innerText.replaceAll('\\u00a0', ' ').includes(words)
  ? done(performance.now()) : requestAnimationFrame(look);
look();
"""
LIMIT = 1500.0
"""[ms] that the first picture may take on a quiet machine."""


def measured(driver: webdriver.Chrome, address: str, part: str, words: str) -> float:
    """Return [ms] from the beginning of a navigation until these words are there."""
    driver.get("about:blank")
    driver.get(address)
    return float(driver.execute_async_script(SEEN, part, words))  # type: ignore[no-untyped-call] # not in its stubs


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=int, default=9)
    times = parser.parse_args().times
    with tempfile.TemporaryDirectory(prefix="rt-", ignore_cleanup_errors=True) as folder:
        for name in ("run", "state", "profile"):
            pathlib.Path(f"{folder}/{name}").mkdir(mode=0o700)
        os.environ |= {"XDG_RUNTIME_DIR": f"{folder}/run", "XDG_STATE_HOME": f"{folder}/state"}
        program = [sys.executable, "-m", "robotree.tui"]
        options = Options()
        options.binary_location = "/usr/bin/chromium"
        for one in (*QUIETLY, f"--user-data-dir={folder}/profile", "--window-size=1200,800"):
            options.add_argument(one)
        quiet: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        with (
            subprocess.Popen([*program, "lookup", "lookup-1"], **quiet) as lookup,
            subprocess.Popen([*program, "web", "--listen", "0", "--json"], **quiet) as web,
        ):
            next(iter(lookup.stdout or ()))
            address = json.loads(next(iter(web.stdout or ())))["command"]
            driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
            try:
                found = {"screen": list[float](), "page": list[float]()}
                for _ in range(times):
                    found["screen"].append(measured(driver, address, "screen", "1 lookup"))
                    driver.execute_script("sessionStorage.clear()")  # type: ignore[no-untyped-call] # not in its stubs
                    found["page"].append(measured(driver, address.partition("#")[0], "told", "no token"))
            finally:
                driver.quit()
                web.terminate()
                lookup.terminate()
    screen, page = (statistics.median(found[name]) for name in ("screen", "page"))
    least, most = min(found["screen"]), max(found["screen"])
    print(f"first picture {screen:.0f} ms ({least:.0f} to {most:.0f}), {times} times")
    print(f"the page without a screen {page:.0f} ms; the screen takes {screen / page:.1f} times as long")
    print(f"at most {LIMIT:.0f} ms: {'met' if screen <= LIMIT else 'NOT MET'}")


if __name__ == "__main__":
    main()
