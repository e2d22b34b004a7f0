"""One key file secures all links of a process, over real sockets and over a restart."""

from __future__ import annotations

import asyncio
import fcntl
import os
import signal
import sys
from subprocess import PIPE, Popen
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.errors import KeyFileError, KeyRefused
from robotree.protocol.links.keyring import PERSIST_PERIOD, Keyring
from robotree.protocol.links.security import UNSIGNED, Security, persisting
from robotree.protocol.messages import Timesync
from robotree.protocol.signing import EPOCH, LARGEST_LEAD, UNITS, Key, Signer, SigningTime

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


NOW = 1_800_000_000.0


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    path = tmp_path / "wire.keys"
    path.touch(mode=0o600)
    path.write_text(f"tcp:127.0.0.1:* {'11' * 32}\n")
    return path


def test_a_link_that_no_line_matches_hears_nobody_and_nobody_hears_it(keys: Path) -> None:
    """A user who gives a file wants no link without a key; a wrong pattern would make one."""
    ours, theirs = (Security(Keyring(keys), lambda: NOW) for _ in range(2))
    for speaker, listener in (("tcp:127.0.0.1:1", "udp:127.0.0.1:1"), ("udp:127.0.0.1:1", "tcp:127.0.0.1:1")):
        signer = ours.signer_pair(speaker)["signer"]
        said = encode(Timesync(1, 2), sequence=0, system=255, component=1, signer=signer)
        plain = encode(Timesync(1, 2), sequence=1, system=255, component=1)
        parser = Parser(theirs.signer_pair(listener)["verifier"])
        assert parser.feed(said + plain) == []
        assert parser.statistics.refused == 2


def test_links_of_one_process_are_different_streams(keys: Path) -> None:
    security = Security(Keyring(keys), lambda: NOW)
    one, two = (security.signer_pair("tcp:127.0.0.1:5760")["signer"] for _ in range(2))
    assert one is not None
    assert two is not None
    assert one.sign(b"")[0] != two.sign(b"")[0]


def test_programs_that_speak_as_the_same_system_do_not_overtake_each_other(keys: Path) -> None:
    """Both have the key and the same wall clock; a frame of one may arrive after a later one of the other."""
    address = "tcp:127.0.0.1:1"
    ours = Security(Keyring(keys), lambda: NOW)
    verifier = ours.signer_pair(address)["verifier"]
    one = Security(Keyring(keys), lambda: NOW, first_link=7).signer_pair(address)["signer"]
    other = Security(Keyring(keys), lambda: NOW + 0.001, first_link=250).signer_pair(address)["signer"]
    earlier, later = (
        encode(Timesync(1, 2), sequence=0, system=255, component=190, signer=signer)
        for signer in (one, other)
    )
    parser = Parser(verifier)
    assert len(parser.feed(later)) == len(parser.feed(earlier)) == 1
    assert parser.feed(later) == parser.feed(earlier) == []


def test_a_restart_with_a_clock_that_was_set_back_signs_on_and_refuses_old_recordings(keys: Path) -> None:
    address = "tcp:127.0.0.1:1"
    long_ago = Security(Keyring(keys), lambda: NOW - 120).signer_pair(address)["signer"]
    recording = encode(Timesync(1, 2), sequence=0, system=1, component=1, signer=long_ago)
    before = Security(Keyring(keys), lambda: NOW)
    before.persist()
    after = Security(Keyring(keys), lambda: NOW - 86400)
    signers = before.signer_pair(address)["signer"], after.signer_pair(address)["signer"]
    stamps = [int.from_bytes(each.sign(b"")[1:7], "little") for each in signers if each is not None]
    assert stamps[1] > stamps[0]
    verifier = after.signer_pair(address)["verifier"]
    assert verifier is not None
    assert Parser(verifier).feed(recording) == []
    assert verifier.statistics.late == 1


def test_what_was_heard_in_an_earlier_life_is_not_heard_again(keys: Path) -> None:
    """A recording of a release, or of a goal whose key is forgotten, played to a robot that was restarted."""
    address = "tcp:127.0.0.1:1"
    client = Security(Keyring(keys), lambda: NOW).signer_pair(address)["signer"]
    recording = encode(Timesync(1, 2), sequence=0, system=255, component=190, signer=client)
    first = Security(Keyring(keys), lambda: NOW)
    assert len(Parser(first.signer_pair(address)["verifier"]).feed(recording)) == 1
    again = Parser(Security(Keyring(keys), lambda: NOW + 1.1).signer_pair(address)["verifier"])
    assert again.feed(recording) == [], "though the first was killed and has persisted nothing"
    late = encode(Timesync(1, 2), sequence=1, system=255, component=190, signer=client)
    assert again.feed(late) == [], "a clock that is late has to come to the time of our start"
    now = Security(Keyring(keys), lambda: NOW + 1.2).signer_pair(address)["signer"]
    assert len(again.feed(encode(Timesync(1, 2), sequence=2, system=255, component=190, signer=now))) == 1


def test_a_clock_that_was_ahead_in_an_earlier_life_locks_nobody_out(keys: Path) -> None:
    address = "tcp:127.0.0.1:1"
    Security(Keyring(keys), lambda: NOW + 20).persist()
    verifier = Security(Keyring(keys), lambda: NOW).signer_pair(address)["verifier"]
    key = Keyring(keys).key_for(address)
    assert key is not None
    punctual = Signer(key, SigningTime(lambda: NOW + 0.01), 9)
    frame = encode(Timesync(1, 2), sequence=0, system=255, component=190, signer=punctual)
    assert len(Parser(verifier).feed(frame)) == 1


def test_signing_time_is_the_wall_clocks_however_often_a_program_starts(keys: Path) -> None:
    """Else a file used by many short programs would run ahead until long ones refuse them all."""
    first = Security(Keyring(keys), lambda: NOW)
    for start in range(1, 100):
        security = Security(Keyring(keys), lambda start=start: NOW + start / 10)
        security.persist()
    assert security.now - first.now == pytest.approx(9.9 * UNITS, abs=2)


def test_after_a_crash_under_a_clock_that_was_set_back_nothing_is_signed_with_an_old_time(keys: Path) -> None:
    before = Security(Keyring(keys), lambda: NOW)
    before.persist()
    unpersisted = Security(Keyring(keys), lambda: NOW + 0.99 * PERSIST_PERIOD).now  # and then it is killed
    after = Security(Keyring(keys), lambda: NOW - 5)
    assert after.now > unpersisted


async def test_the_time_is_persisted_again_and_again_and_at_the_end(keys: Path) -> None:
    clock = NOW
    ring = Keyring(keys)
    async with persisting(Security(ring, lambda: clock), period=0.001) as security:
        at_start = ring.persisted()
        assert at_start == security.now
        clock += 100
        async with asyncio.timeout(60):
            while ring.persisted() == at_start:  # noqa: ASYNC110  a file has no event
                await asyncio.sleep(0.001)
        clock += 100
    assert ring.persisted() == at_start + 200 * UNITS


async def test_a_disk_that_is_full_for_a_while_ends_no_link(
    keys: Path, caplog: pytest.LogCaptureFixture
) -> None:
    in_the_way = keys.with_name("wire.keys.time.new")
    clock = NOW
    async with persisting(Security(Keyring(keys), lambda: clock), period=0.001):
        in_the_way.mkdir()
        clock += 1
        async with asyncio.timeout(60):
            while "cannot keep the signing time" not in caplog.text:  # noqa: ASYNC110  a log has no event
                await asyncio.sleep(0.001)
        in_the_way.rmdir()
    assert keys.with_name("wire.keys.time").is_file(), "it is kept as soon as there is room"


async def test_a_place_where_time_cannot_be_kept_is_told_at_once(keys: Path) -> None:
    keys.with_name("wire.keys.time.new").mkdir()
    with pytest.raises(KeyFileError, match="cannot keep"):
        async with persisting(Security(Keyring(keys), lambda: NOW)):
            pytest.fail("nothing is opened")


HOLDER = """
import fcntl, os, signal, sys
with open(sys.argv[1], "rb") as file:
    fcntl.flock(file, fcntl.LOCK_EX)
    print("held", flush=True)
    os.kill(os.getpid(), signal.SIGSTOP)
"""


@pytest.fixture
def stopped(keys: Path) -> Iterator[Popen[str]]:
    """A program that was stopped while it held the key file."""
    with Popen([sys.executable, "-c", HOLDER, str(keys)], stdout=PIPE, text=True) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == "held\n"
        os.waitid(os.P_PID, holder.pid, os.WSTOPPED | os.WNOWAIT)
        yield holder
        holder.kill()


async def test_a_stopped_program_that_holds_the_keys_keeps_no_other_from_saying_so(
    keys: Path, stopped: Popen[str]
) -> None:
    turns = 0

    async def turn() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0.001)

    turning = asyncio.create_task(turn())
    with pytest.raises(KeyFileError) as told:
        async with persisting(Security(Keyring(keys, patience=0.2), lambda: NOW)):
            pytest.fail("nothing is opened")
    assert turns > 2, "the loop turns while the file is waited for"
    turning.cancel()
    sentence = f"another program has held it for 0.2 s; let that go on, or end it (fuser {keys} names it)"
    assert str(told.value) == f"{keys}: {sentence}"
    stopped.send_signal(signal.SIGCONT)
    async with persisting(Security(Keyring(keys), lambda: NOW)):
        pass


async def test_a_program_that_is_stopped_meanwhile_lets_the_others_end(keys: Path) -> None:
    with pytest.raises(KeyFileError, match="another program has held it"), keys.open("rb") as held:
        async with persisting(Security(Keyring(keys, patience=0.05), lambda: NOW)):
            fcntl.flock(held, fcntl.LOCK_EX)


LINK = "tcp:127.0.0.1:40000"


def over(address: str) -> Any:
    """A link of which only the names matter."""
    return SimpleNamespace(address=address, controller=address)


NEW = bytes(range(32))
PRESENT = int((NOW - EPOCH) * UNITS)


def test_a_new_key_counts_for_the_links_of_its_pattern_from_now_on(keys: Path) -> None:
    controller, proxy = Security(Keyring(keys), lambda: NOW), Security(Keyring(keys), lambda: NOW)
    ours, theirs = controller.signer_pair(LINK), proxy.signer_pair(LINK)
    assert not proxy.renewed(LINK, theirs)
    assert controller.rotate(over(LINK), ours, NEW, 0)
    assert controller.renewed(LINK, ours)
    assert proxy.renewed(LINK, theirs), "all that share the file find it"
    said = encode(
        Timesync(1, 2), sequence=0, system=255, component=1, signer=proxy.signer_pair(LINK)["signer"]
    )
    old = encode(Timesync(1, 2), sequence=0, system=255, component=2, signer=theirs["signer"])
    parser = Parser(controller.signer_pair(LINK)["verifier"])
    assert len(parser.feed(said)) == 1
    assert parser.feed(old) == []
    assert not controller.rotate(over(LINK), controller.signer_pair(LINK), NEW, 0), (
        "the same key again changes nothing"
    )


@pytest.mark.parametrize(
    ("address", "secret", "sentence"),
    [
        ("tcp:192.0.2.1:40000", NEW, "only over TCP or UDP from this machine"),
        ("tcp:[::ffff:192.0.2.1]:40000", NEW, "only over TCP or UDP from this machine"),
        ("serial:/dev/ttyUSB0", NEW, "only over TCP or UDP from this machine"),
        ("can:robotree/cell?node=1", NEW, "only over TCP or UDP from this machine"),
        ("udp:127.0.0.1:40000", NEW, "has no key that could be replaced"),
        (LINK, bytes(32), "not switched off over the wire"),
    ],
)
def test_a_key_that_must_not_be_taken_is_refused_in_one_sentence(
    keys: Path, address: str, secret: bytes, sentence: str
) -> None:
    if "udp" not in address:
        keys.write_text(f"* {'11' * 32}\n")
    security, before = Security(Keyring(keys), lambda: NOW), keys.read_bytes()
    with pytest.raises(KeyRefused, match=sentence) as refused:
        security.rotate(over(address), security.signer_pair(address), secret, 0)
    assert str(refused.value).count(".") == 1
    assert keys.read_bytes() == before


def test_without_a_key_file_no_key_is_taken() -> None:
    with pytest.raises(KeyRefused, match="start with --key FILE"):
        UNSIGNED.rotate(over(LINK), UNSIGNED.signer_pair(LINK), NEW, 0)


def test_a_link_of_loopback_may_carry_a_key_over_any_of_its_transports(keys: Path) -> None:
    for i, address in enumerate((LINK, "tcp:[::1]:1", "udp:127.0.0.9:1", "loop:near"), 1):
        keys.write_text(f"* {'11' * 32}\n")
        security = Security(Keyring(keys), lambda: NOW)
        assert security.rotate(over(address), security.signer_pair(address), bytes([i]) * 32, 0)


def test_an_older_key_does_not_undo_what_the_owner_has_put_in(keys: Path) -> None:
    security = Security(Keyring(keys), lambda: NOW)
    signer_pair = security.signer_pair(LINK)
    keys.write_text(f"* {'33' * 32}\n")
    security.signer_pair("tcp:127.0.0.1:2")
    with pytest.raises(KeyRefused, match="the old key stays"):
        security.rotate(over(LINK), signer_pair, NEW, 0)
    assert keys.read_text() == f"* {'33' * 32}\n"


@pytest.mark.parametrize(
    ("named", "expected"),
    [
        (0, PRESENT),
        (PRESENT - 1, PRESENT),
        (PRESENT + 20 * UNITS, PRESENT + 20 * UNITS),
        (2**64 - 1, PRESENT + LARGEST_LEAD),
    ],
)
def test_time_goes_on_where_the_sender_of_a_key_is_but_no_further_than_harms_nobody(
    keys: Path, named: int, expected: int
) -> None:
    security = Security(Keyring(keys), lambda: NOW)
    for i in range(3):  # nor does it add up
        security.rotate(over(LINK), security.signer_pair(LINK), bytes([i + 1]) * 32, named)
    assert security.now == expected
    assert Keyring(keys).persisted() == expected
    signer = security.signer_pair(LINK)["signer"]
    assert signer is not None
    assert int.from_bytes(signer.sign(b"")[1:7], "little") > expected
    punctual = Signer(Key(bytes([3]) * 32), SigningTime(lambda: NOW), 9)
    assert Parser(security.signer_pair(LINK)["verifier"]).feed(
        encode(Timesync(1, 2), sequence=0, system=9, component=1, signer=punctual)
    )


def test_a_key_file_that_is_broken_is_told_once_and_the_keys_stay(
    keys: Path, caplog: pytest.LogCaptureFixture
) -> None:
    security = Security(Keyring(keys), lambda: NOW)
    for mode, text in ((0o600, "nonsense\n"), (0o644, f"* {'22' * 32}\n")):
        keys.chmod(mode)
        keys.write_text(text)
        caplog.clear()
        for _ in range(3):
            verifier = security.signer_pair(LINK)["verifier"]
            assert verifier is not None
            assert verifier.key.fingerprint == Key(b"\x11" * 32).of_controller(LINK).fingerprint
        assert caplog.text.count("the keys stay as they were") == 1
    keys.chmod(0o600)
    verifier = security.signer_pair(LINK)["verifier"]
    assert verifier is not None
    assert verifier.key.fingerprint == Key(b"\x22" * 32).of_controller(LINK).fingerprint
