"""A realm's folder is full of things that no process of ours made: nothing waits, falls or is lost."""

from __future__ import annotations

import asyncio
import os
import resource
import subprocess
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from robotree.vr.world.testing import until
from tests.command_line import ROBOTREE

pytestmark = pytest.mark.e2e
MEMORY = 2 * 10**9
"""[bytes] of addresses that a verb may use: a file without end would take all there is."""
VERBS = ("ls", "stop")


def litter(folder: Path, precious: Path) -> None:
    """Put names that are no text, folders, FIFOs, links and endless files where entries and sockets lie."""
    for number, end in enumerate((".entry", ".sock", ".beat", ".held")):
        (folder / f"1-0000000{number}{end}").mkdir()
        os.mkfifo(folder / f"2-0000000{number}{end}")
        (folder / f"3-0000000{number}{end}").symlink_to(precious)
        (folder / f"4-0000000{number}{end}").symlink_to("/dev/zero")
        Path(os.fsdecode(os.fsencode(folder) + b"/5-\xff\xfe" + end.encode())).touch()
    (folder / "6-deadbeef.entry").write_text(f"unixsock-stream/{precious}")


def told(done: subprocess.CompletedProcess[bytes]) -> tuple[int, str, str]:
    return done.returncode, done.stdout.decode(), done.stderr.decode()


async def run(folder: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """One command line, that may take 20 s and a part of the memory."""
    return await asyncio.to_thread(
        subprocess.run,
        [*ROBOTREE, *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY)),
    )


async def test_a_realm_full_of_strange_files_is_used_as_if_they_were_not_there(
    place: Path, tmp_path: Path
) -> None:
    precious = tmp_path / "precious"
    precious.write_text("kept")
    async with Crew("default") as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        before = [await run(tmp_path, verb) for verb in VERBS]
        litter(place / "robotree" / "default", precious)
        after = [await run(tmp_path, verb) for verb in VERBS]
        assert [told(one) for one in after] == [told(one) for one in before]
        os.mkfifo(tmp_path / "fifo.py")
        (tmp_path / "zero.py").symlink_to("/dev/zero")
        for page, reason in (("fifo.py", "it is a FIFO"), ("zero.py", "it is a device")):
            done = await run(tmp_path, "create", page, "as", "x")
            assert told(done) == (
                exit_codes.REFUSED,
                "",
                f"robotree: cannot read {page}: {reason}, not a file\n",
            )
        await crew.start("lookup", "lookup-2")  # who comes now finds the others
        async with joined("default") as realm_client:
            await until(lambda: sorted(realm_client.services) == ["lookup-1", "lookup-2"], "both are seen")
    assert precious.read_text() == "kept"
