"""What the host reads of a robot, while its command runs, is no step of the command."""

from __future__ import annotations

from pathlib import Path

from tests.vr.scripts.test_scripts_after_a_crash import Bundle, HostClient, Life

MOODY = '''
import threading

from robotree.vr import Child, VirtualRobot, command, state

class Moody(VirtualRobot):
    """Publishes its mood among its attributes."""

    mood: str = state("calm")
    read = threading.Event()

    @property
    def attributes(self) -> dict[str, str]:
        """Free pairs, and its mood."""
        mood = self.mood
        if mood == "bright":
            self.read.set()
        return {"mood": mood}

    @attributes.setter
    def attributes(self, given: dict[str, str]) -> None:
        pass

    @command
    def cheer(self) -> None:
        """Be bright, until the host has read that."""
        self.mood = "bright"
        print("it is said, too")
        while not self.read.is_set():
            self.sleep(0.005)

class Friend(VirtualRobot):
    """Has one that is moody."""

    other = Child("Moody")

    @command
    def visit(self) -> None:
        """Cheer the other one."""
        self.other.cheer()
'''


async def test_a_host_that_reads_attributes_during_a_command_is_no_thread_of_it(tmp_path: Path) -> None:
    async with Life(tmp_path) as life:
        hosts = HostClient(life.operator, life.host.address)
        await hosts.create(Bundle(MOODY, "moody.py", "Moody"), "moody")
        await hosts.create(Bundle(MOODY, "moody.py", "Friend"), "friend")
        await life.client("friend").enslave("other", life.host.agents["moody"].address)
        begins = life.journal.size
        await life.call("friend", "visit")
        records = life.journal.file.read_bytes()[begins:]
    assert b"bright" in records, "the log holds what it keeps"
    assert b"thread" not in records, "a command with steps of other threads is in doubt after a crash"
