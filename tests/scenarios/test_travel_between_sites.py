"""A robot moves to a host of another site, over a slow line, in the middle of a command."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.tui.exit_codes import REFUSED
from robotree.tui.sites.slow_line import SlowLine
from tests.command_line import ROBOTREE
from tests.plant import Plant
from tests.ports import free_port
from tests.waiting import PATIENCE, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.story, pytest.mark.soak]  # minutes, over a slow line

DELAY = 0.05
"""[s] one way, of the line of hall."""

PAGE = '''
from robotree.vr import Child, VirtualRobot, command, state


class Courier(VirtualRobot):
    """Drives a rover, wherever it is itself."""

    rover = Child("Rover")
    legs: int = state(0)

    @command
    def carry(self, legs: int) -> int:
        """Drive out and back."""
        for n in range(legs):
            self.rover.move(x=0.02 if n % 2 else -0.02, y=0)
            self.legs += 1
        return self.legs
'''


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    """Two linked sites, hall behind a slow line, with a host each, and a rover at hall."""
    loop = asyncio.new_event_loop()
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        found = Plant(Path(folder))
        try:
            address = found.start_hub()
            line = SlowLine("127.0.0.1", found.port, delay=DELAY)
            thread = threading.Thread(target=loop.run_forever, daemon=True)
            thread.start()
            port = asyncio.run_coroutine_threadsafe(line.open(), loop).result(10)
            slow = address.replace(str(found.port), str(port))
            found.lab.say("realm", "create", "plant", "--hub", slow, "--site", "lab")
            found.lab.start("gateway", "gateway")
            found.hall.say("realm", "join", found.lab.say("realm", "invite", "hall")["token"])
            for machine in (found.lab, found.hall):
                if machine is found.hall:
                    machine.start("gateway", "gateway")
                machine.start("lookup", "lookup", f"lookup-{machine.name}")
                machine.start("host", "host", f"host-{machine.name}")
            wire = free_port()
            found.hall.start("sim", "sim", "rover", "--listen", f"tcp:127.0.0.1:{wire}", "--open")
            found.hall.start("proxy", "proxy", "rover", "r1", "--connect", f"tcp:127.0.0.1:{wire}", "--open")
            found.lab.until_listed("r1")
            yield found
        finally:
            for machine in found.machines:
                for called in list(machine.running):
                    machine.end(called, signal.SIGKILL)
            asyncio.run_coroutine_threadsafe(line.close(), loop).result(10)
            loop.call_soon_threadsafe(loop.stop)
            thread.join()
            loop.close()


def test_it_is_refused_until_its_signer_is_trusted_there_and_then_it_moves_while_it_works(
    plant: Plant, tmp_path: Path
) -> None:
    lab, hall, legs = plant.lab, plant.hall, 12
    page = tmp_path / "courier.py"
    page.write_text(PAGE)
    lab.say("create", str(page), "as", "plain", "on", "host-lab")
    refused = lab.say("migrate", "plain", "to", "hall:host-hall", code=REFUSED)
    assert refused["error"] == "NotSigned", refused
    bundle = str(page.with_suffix(".bundle"))
    lab.say("bundle", "build", str(page), "--out", bundle)
    lab.say("create", bundle, "as", "courier", "on", "host-lab")
    refused = lab.say("migrate", "courier", "to", "hall:host-hall", code=REFUSED)
    assert refused["error"] == "UnknownSigner", refused
    hall.say("bundle", "trust", bundle, "--name", "lab", "--may", "Rover.*", "--isolation", "none")
    lab.say("enslave", "courier.rover", "r1")
    calling = subprocess.Popen(
        [*ROBOTREE, "call", "courier.carry", f"legs={legs}", "--json"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=lab.environment,
    )
    try:
        wait_until(lambda: lab.say("show", "courier")["kept"]["legs"] >= 2)
        lab.say("migrate", "courier", "to", "hall:host-hall")
        assert hall.say("ls", "--hosts")[0]["robots"] == ["courier"]
        said, complained = calling.communicate(timeout=PATIENCE)
    finally:
        calling.kill()
    assert calling.returncode == 0, complained
    assert json.loads(said) == legs
    done = [one for one in hall.say("log", "r1") if one["level"] == "done" and one["command"] == "move"]
    assert len(done) == legs, "no leg is driven twice, none is left out"
    assert lab.say("show", "courier")["site"] == "hall"
    assert lab.say("migrate", "courier", "to", "host-lab") == {"migrated": "courier", "host": "host-lab"}
    assert lab.say("call", "courier.carry", "legs=1") == legs + 1
    hall.say("migrate", "courier", "to", "host-hall")
    assert hall.say("call", "courier.carry", "legs=1") == legs + 2
