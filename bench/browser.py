"""How soon the full screen is there in a browser, beside a page without one.

    python bench/browser.py [--times 9]

A headless Chromium opens `robotree web` (a realm with a lookup service and nothing else), and, alternately,
the same page without a token, which loads the same files and shows one sentence. Measured by the page's own
clock, from the beginning of the navigation to the frame in which the words are there.
"""

from __future__ import annotations

import json
import statistics

from measuring import apart, end, heard, options, start, started
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
    times = options(__doc__, times=9).times
    with apart() as folder:
        chromium = Options()
        chromium.binary_location = "/usr/bin/chromium"
        for word in (*QUIETLY, f"--user-data-dir={folder}/profile", "--window-size=1200,800"):
            chromium.add_argument(word)
        robotree = ("-m", "robotree.tui")
        with started((*robotree, "lookup", "lookup-1")):
            web = start(*robotree, "web", "--listen", "0", "--json", wait=False)
            address = json.loads(heard(web))["command"]
            driver = webdriver.Chrome(options=chromium, service=Service("/usr/bin/chromedriver"))
            try:
                found = {"screen": list[float](), "page": list[float]()}
                for _ in range(times):
                    found["screen"].append(measured(driver, address, "screen", "1 lookup"))
                    driver.execute_script("sessionStorage.clear()")  # type: ignore[no-untyped-call] # not in its stubs
                    found["page"].append(measured(driver, address.partition("#")[0], "told", "no token"))
            finally:
                driver.quit()
                end([web])
    screen, page = (statistics.median(found[name]) for name in ("screen", "page"))
    least, most = min(found["screen"]), max(found["screen"])
    print(f"first picture {screen:.0f} ms ({least:.0f} to {most:.0f}), {times} times")
    print(f"the page without a screen {page:.0f} ms; the screen takes {screen / page:.1f} times as long")
    print(f"at most {LIMIT:.0f} ms: {'met' if screen <= LIMIT else 'NOT MET'}")


if __name__ == "__main__":
    main()
