"""A real PostgreSQL server for tests: in a folder of its own, on a Unix socket alone.

python -m tests.vr.space.postgres     says what is missing, and ends with 1 if anything is
"""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

REQUIRED = "ROBOTREE_REQUIRE_POSTGRES"
"""A test fails without PostgreSQL if this is set; else it is skipped."""
USER = "nobody"
"""Who runs the server when the tests run as root: PostgreSQL refuses to."""
START = 60.0
"""[s]"""


def found(program: str) -> str | None:
    """Return where a program of PostgreSQL is; Debian has its server's outside of PATH."""
    others = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{program}"), reverse=True)
    return shutil.which(program) or next(map(str, others), None)


def lacking() -> str:
    """Return why there can be no server here; empty: there can."""
    for program in ("initdb", "postgres"):
        if found(program) is None:
            return f"{program} is not installed; install it: `apt-get install postgresql`"
    if os.geteuid() == 0 and shutil.which("setpriv") is None:
        return "PostgreSQL does not run as root, and there is no setpriv to be somebody else"
    return ""


def as_somebody() -> list[str]:
    """What a line begins with so that its program is not root, and ends when the tests were killed."""
    if shutil.which("setpriv") is None:
        return []
    end = ["setpriv", "--pdeathsig=QUIT"]
    if os.geteuid() != 0:
        return end
    group = pwd.getpwnam(USER).pw_gid
    return [*end, f"--reuid={USER}", f"--regid={group}", "--clear-groups"]


class Server:
    """A running server."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self._options = folder, options
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"postgresql://robotree@/postgres?host={self.folder}"

    def make(self) -> None:
        """Make its files."""
        if os.geteuid() == 0:
            shutil.chown(self.folder, USER)
        line = [*as_somebody(), found("initdb") or "", "-D", str(self.folder / "data"), "-U", "robotree"]
        line += ["-A", "trust", "-E", "UTF8", "--no-sync", "--locale=C"]
        subprocess.run(line, check=True, capture_output=True, cwd="/")

    def start(self) -> None:
        """Start it, and wait until it takes connections."""
        import psycopg

        line = [*as_somebody(), found("postgres") or "", "-D", str(self.folder / "data")]
        line += ["-c", "listen_addresses=", "-c", f"unix_socket_directories={self.folder}"]
        for option in self._options:
            line += ["-c", option]
        self.process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd="/")
        latest = time.monotonic() + START
        while True:
            try:
                psycopg.connect(self.url).close()
            except psycopg.OperationalError:
                assert self.process.poll() is None, "the server has ended"
                assert time.monotonic() < latest, "the server does not start"
                time.sleep(0.05)
            else:
                return

    def stop(self) -> None:
        """End it at once (SIGQUIT), as a crash would. Twice is once."""
        if self.process is not None:
            self.process.send_signal(3)
            self.process.wait(START)
            self.process = None


@contextmanager
def server(*options: str) -> Iterator[Server]:
    """Have a server for the time of a block, or skip the test with the reason.

    Args:
        *options: as in postgresql.conf: `fsync=off`.
    """
    reason = lacking()
    if reason and os.environ.get(REQUIRED):
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)
    with tempfile.TemporaryDirectory(prefix="rt-pg-", ignore_cleanup_errors=True) as folder:
        running = Server(Path(folder), *options)
        running.make()
        try:
            running.start()
            yield running
        finally:
            running.stop()


if __name__ == "__main__":
    sys.exit(lacking() or None)
