"""A controller remembers what it has heard: over a kill, a power cut, and a clock that is set back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.errors import KeyFileError
from robotree.protocol.links import heard as module
from robotree.protocol.links.heard import RESERVE, HeardFile
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import Security
from robotree.protocol.messages import Timesync
from robotree.protocol.signing import EPOCH, UNITS, Signer, SigningTime

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.protocol.signing import Verifier

NOW = 1_800_000_000.0
NAME = "tcp:127.0.0.1:5760"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    create(tmp_path / "cell.key")
    return tmp_path / "cell.key.heard"


def controller(path: Path, at: float, heard: HeardFile) -> Verifier:
    """Start a controller at a time of its clock [s]."""
    pair = Security(Keyring(path.with_suffix("")), lambda: at, heard=heard).signer_pair(NAME)
    verifier = pair["verifier"]
    assert verifier is not None
    return verifier


def said(path: Path, at: float) -> bytes:
    """A frame of a program whose clock shows a time [s]."""
    key = Keyring(path.with_suffix("")).key_for(NAME)
    assert key is not None
    signer = Signer(key, SigningTime(lambda: at), 7)
    return encode(Timesync(1, 2), sequence=0, system=255, component=190, signer=signer)


def passes(verifier: Verifier, frame: bytes) -> bool:
    return bool(Parser(verifier).feed(frame))


def test_what_was_heard_is_refused_after_a_kill_though_the_clock_was_set_back(path: Path) -> None:
    heard = HeardFile(path)
    recording = said(path, NOW + 0.5)
    assert passes(controller(path, NOW, heard), recording)
    heard.close()  # all that a kill leaves, for nothing was synced
    again = HeardFile(path)
    restarted = controller(path, NOW - 3600, again)
    assert not passes(restarted, recording)
    assert passes(restarted, said(path, NOW + 0.6)), "a clock that was not set back is accepted at once"
    again.close()


def test_a_restart_delays_nobody_whose_clock_is_right(path: Path) -> None:
    for start in range(5):
        heard = HeardFile(path)
        verifier = controller(path, NOW + start, heard)
        heard.reserve(int((NOW + start - EPOCH) * UNITS))
        assert passes(verifier, said(path, NOW + start + 0.001))
        heard.close()


def test_after_a_power_cut_nothing_that_may_have_been_heard_is_heard_again(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = HeardFile(path)
    verifier = controller(path, NOW, heard)
    heard.reserve(int((NOW - EPOCH) * UNITS))
    synced = path.read_bytes()
    later = [said(path, NOW + seconds) for seconds in (1.0, 5.0, 19.0)]
    assert all(passes(verifier, frame) for frame in later)
    heard.close()
    path.write_bytes(synced)  # the rest was in the memory of the machine
    monkeypatch.setattr(module, "_life", lambda: b"another one".ljust(36, b"-"))
    heard = HeardFile(path)
    restarted = controller(path, NOW - 100, heard)
    assert not any(passes(restarted, frame) for frame in later)
    assert passes(restarted, said(path, NOW + RESERVE / UNITS + 0.1))
    heard.close()


def test_a_time_ahead_of_the_reserve_is_kept_for_good_at_once(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = HeardFile(path)
    verifier = controller(path, NOW, heard)
    recording = said(path, NOW + 59)
    assert passes(verifier, recording)
    heard.close()
    monkeypatch.setattr(module, "_life", lambda: b"another one".ljust(36, b"-"))
    heard = HeardFile(path)
    assert not passes(controller(path, NOW, heard), recording)
    heard.close()


def test_who_is_refused_because_a_clock_was_set_back_is_told_what_to_do(path: Path) -> None:
    heard = HeardFile(path)
    assert passes(controller(path, NOW, heard), said(path, NOW + 0.1))
    heard.close()
    heard = HeardFile(path)
    verifier = controller(path, NOW - 3600, heard)
    assert not passes(verifier, said(path, NOW - 3599))
    assert "their clock is 3599 s behind, and 60 s are allowed; set both clocks right" in rejection(verifier)
    assert "or give both ends a new key" in rejection(verifier)
    heard.close()


def test_no_flipped_bit_is_taken_for_an_earlier_time(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    heard = HeardFile(path)
    newest = int((NOW - EPOCH) * UNITS)
    heard.reserve(newest)
    heard.note(newest + 5)
    heard.close()
    whole = path.read_bytes()
    for bit in range(8 * len(whole)):
        data = bytearray(whole)
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        heard = HeardFile(path)
        assert heard.newest in {newest + 5, newest + RESERVE}
        heard.close()
    path.write_bytes(b"nonsense" * 100)
    heard = HeardFile(path)
    assert heard.newest == 0
    assert "is damaged; recordings are refused by the clock alone" in caplog.text
    heard.close()


def test_two_controllers_cannot_have_one_name(path: Path) -> None:
    heard = HeardFile(path)
    with pytest.raises(KeyFileError, match="another process is the controller of this name"):
        HeardFile(path)
    heard.close()
    HeardFile(path).close()


def test_a_file_that_cannot_be_opened_is_refused_in_one_sentence(path: Path) -> None:
    with pytest.raises(KeyFileError, match="cannot be used: Is a directory"):
        HeardFile(path.parent)


def test_a_full_disk_keeps_nobody_from_being_heard(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    heard = HeardFile(path)
    verifier = controller(path, NOW, heard)
    monkeypatch.setattr(module.os, "pwrite", full)
    for second in range(1, 50):
        assert passes(verifier, said(path, NOW + second))
    assert caplog.text.count("cannot be written (No space left on device)") == 1
    heard.close()
