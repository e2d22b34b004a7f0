"""What tests of several rooms need: a place apart, and a cable between two serial ports."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import hypothesis
import pytest
from _pytest.runner import runtestprotocol

from robotree.protocol.testing import forgetting_messages

LONGEST_END = 60.0
"""[s] for code that was told to end; a busy machine may take that long."""

MEASUREMENTS, CALM = 4, 5.0
"""How often a test with a budget of time is measured at most; [s] in between, in which others may end."""
LONG = {
    "test_conform", "test_sites", "test_trials", "test_thesis_figures", "test_processes_that_end",
    "test_wheel", "test_laboratory", "test_web_page", "test_a_screen_to_trust", "test_handing_over",
    "test_things", "test_safeguards", "test_families", "test_service", "test_between_sites", "test_moves",
    "test_demos",
}  # fmt: skip
"""Files that take a quarter of a minute or more begin first. Any other order is right, too, and slower."""
_again = pytest.StashKey[list[str]]()

# The suite searches the same cases in each run: what is green stays green until something changes.
# `make soak` searches new ones, and prints what reproduces a case that it finds.
# How long a case takes says something about the machine, not about the code.
_ANY_SPEED = hypothesis.settings(deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.register_profile("repeatable", _ANY_SPEED, derandomize=True)
hypothesis.settings.register_profile("search", _ANY_SPEED, derandomize=False, print_blob=True)
hypothesis.settings.load_profile("repeatable")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Give each worker whole files, unless the command line says otherwise: their tests share processes."""
    if getattr(config.option, "numprocesses", None) and config.option.dist == "no":
        config.option.dist = "loadfile"
        config.option.loadscopereorder = False


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tell a story in its order; put a file that starts real processes before each few of the others.

    Processes are waited for, the others compute: so workers that share a core do not all wait at once.
    The last fifth are others, and long files come first, so that no worker is alone with one at the end.
    """
    chapters: dict[Path, list[pytest.Item]] = {}
    for item in items:
        chapters.setdefault(item.path, []).append(item)
    waiting, computing = list[list[pytest.Item]](), list[list[pytest.Item]]()
    for chapter in chapters.values():
        if chapter[0].get_closest_marker("story"):
            chapter.sort(key=lambda item: item.reportinfo()[1] or 0)
        (waiting if chapter[0].get_closest_marker("e2e") else computing).append(chapter)
    for some in (waiting, computing):
        some.sort(key=lambda chapter: chapter[0].path.stem not in LONG)
    each = 0.8 * len(computing) / max(len(waiting), 1)
    places = [*((each * number, chapter) for number, chapter in enumerate(waiting)), *enumerate(computing)]
    items[:] = [item for _, chapter in sorted(places, key=lambda place: place[0]) for item in chapter]


def pytest_configure(config: pytest.Config) -> None:
    """Begin with no test that was measured again, and look for garbage seldom, from the collection on."""
    config.stash[_again] = []
    gc.set_threshold(50_000, 20, 100)  # after as many new objects, not after 700


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Measure a test with the marker `speed` again if it was too slow, and take the least of what it took.

    What else runs on a machine makes a measurement longer, never shorter. So only a budget that is
    exceeded in each of some measurements says something about the code.
    """
    if item.get_closest_marker("speed") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for _ in range(MEASUREMENTS - 1):
        if not any(report.failed and report.when == "call" for report in reports):
            break
        item.config.stash[_again].append(item.nodeid)
        time.sleep(CALM)
        item._initrequest()  # type: ignore[attr-defined] # as pytest begins with a test
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Tell which tests were measured again."""
    for test in dict.fromkeys(config.stash[_again]):
        terminalreporter.write_line(f"measured {1 + config.stash[_again].count(test)} times: {test}")


@contextlib.contextmanager
def place_apart() -> Generator[Path]:
    """Set a runtime and a state folder for this process and those that it starts, without realm or key.

    Yields:
        The runtime folder, empty. It lies beside pytest's own temporary folders, not in them: their names
        grow with the test's and with the number of runs, and Linux takes 107 bytes for a socket's path.
    """
    with tempfile.TemporaryDirectory(prefix="rt-") as folder, pytest.MonkeyPatch.context() as environment:
        runtime, state = Path(folder, "run"), Path(folder, "state")
        for variable, path in (("XDG_RUNTIME_DIR", runtime), ("XDG_STATE_HOME", state)):
            path.mkdir(mode=0o700)
            environment.setenv(variable, str(path))
        for variable in ("ROBOTREE_REALM", "ROBOTREE_KEY"):
            environment.delenv(variable, raising=False)
        yield runtime


@pytest.fixture(scope="session", autouse=True)
def apart_from_all_others() -> Iterator[None]:
    """Have a test that asks for no place of its own meet nobody of another worker or run."""
    with place_apart():
        yield


@pytest.fixture(scope="session", autouse=True)
def interrupts_are_heard() -> Iterator[None]:
    """Have all that the tests start end at a SIGINT and at a SIGHUP.

    A shell has the one ignored by what it starts in the background, `nohup` the other, and so by all that is
    started from there.
    """
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    ignored = [number for number in usual if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, usual[number])
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def garbage_is_collected_seldom() -> Iterator[None]:
    """Never look for garbage among the libraries of all rooms, and else seldom, see `pytest_configure`.

    A file of tests of the screen takes about a quarter less processor time so, and a worker more memory.
    """
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="session", autouse=True)
def what_is_compiled_is_kept() -> Iterator[None]:
    """Have the processes that tests start compile each module once, also where that is switched off.

    Else each of some hundred processes compiles a hundred modules again.
    """
    with pytest.MonkeyPatch.context() as environment:
        environment.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        yield


@pytest.fixture(autouse=True)
def no_code_runs_on() -> Iterator[None]:
    """Hold that a test ends what it began: code left computing slows, and so fails, whatever comes after it.

    Pools keep threads that wait; those of authors' code are daemons. So are those in which asyncio waits for
    a process, which may be a module's.
    """
    before = set(threading.enumerate())
    yield
    begun = [
        thread
        for thread in set(threading.enumerate()) - before
        if thread.daemon and not thread.name.startswith("asyncio-waitpid")
    ]
    latest = time.monotonic() + LONGEST_END
    for thread in begun:
        while (thread.is_alive() or thread.ident is None) and time.monotonic() < latest:  # it may just begin
            time.sleep(0.001)
    assert not [thread.name for thread in begun if thread.is_alive()], "still run"


@pytest.fixture(autouse=True)
def own_messages_end_with_their_test() -> Iterator[None]:
    """Have no test know the messages and classes that another one added."""
    with forgetting_messages():
        yield


@pytest.fixture
def place() -> Iterator[Path]:
    """Where the processes of this test meet, apart from everybody else's: a runtime folder."""
    with place_apart() as runtime:
        yield runtime


@pytest.fixture(scope="module")
def shared_place() -> Iterator[Path]:
    """The same for all tests of a module."""
    with place_apart() as runtime:
        yield runtime


class Cable:
    """A null-modem cable between two serial ports: two pseudo-terminals, whose far sides are joined here."""

    def __init__(self, folder: Path) -> None:
        self._loop = asyncio.get_running_loop()
        pairs = [os.openpty(), os.openpty()]
        self._masters = [master for master, _ in pairs]
        # Held open, so that a port that is closed by its program is not unplugged.
        self._ports = [port for _, port in pairs]
        self.devices = [folder / "near", folder / "far"]
        for device, port in zip(self.devices, self._ports, strict=True):
            tty.setraw(port)
            device.symlink_to(os.ttyname(port))
        for here, there in (self._masters, self._masters[::-1]):
            os.set_blocking(here, False)
            self._loop.add_reader(here, self._carry, here, there)

    def url(self, end: int, options: str = "?baud=4000000") -> str:
        return f"serial:{self.devices[end]}{options}"

    def _carry(self, here: int, there: int) -> None:
        with contextlib.suppress(BlockingIOError):
            rest = os.read(here, 1024)
            while rest:  # a real line would not wait either, but the laws are about the link
                rest = rest[os.write(there, rest) :]

    def pull(self) -> None:
        """Unplug both adapters: their devices are gone. Twice is once."""
        if not self._masters:
            return
        for master in self._masters:
            self._loop.remove_reader(master)
        for descriptor in (*self._masters, *self._ports):
            os.close(descriptor)
        for device in self.devices:
            device.unlink()
        self._masters, self._ports = [], []


@pytest.fixture
def make_cable(tmp_path: Path) -> Iterator[Callable[[], Cable]]:
    """Lays a cable between the devices `near` and `far`; a new one after the old one was pulled."""
    cables: list[Cable] = []

    def make() -> Cable:
        cables.append(Cable(tmp_path))
        return cables[-1]

    yield make
    for cable in cables:
        cable.pull()
