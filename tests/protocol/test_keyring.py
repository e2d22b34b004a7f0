"""Keys lie in a file that nobody else can read; what was heard is remembered over a kill and a power cut."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.errors import KeyFileError, UnmatchedLink
from robotree.protocol.links import heard as module
from robotree.protocol.links.heard import RESERVE, HeardFile
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import Security
from robotree.protocol.messages import Timesync
from robotree.protocol.signing import EPOCH, UNITS, Key, Signer, SigningTime

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.protocol.signing import Verifier

ONE, TWO = "11" * 32, "22" * 32


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "wire.keys"
    path.touch(mode=0o600)
    path.write_text(f"# people\n\ntcp:127.0.0.1:*  {ONE}\ncan:* {TWO}\n")
    return path


def test_the_first_pattern_that_matches_gives_the_key(path: Path) -> None:
    ring = Keyring(path)
    one, two = ring.key_for("tcp:127.0.0.1:5760"), ring.key_for("can:robotree/cell")
    assert one is not None
    assert two is not None
    assert one.fingerprint == Key(bytes.fromhex(ONE)).of_controller("tcp:127.0.0.1:5760").fingerprint
    assert two.fingerprint == Key(bytes.fromhex(TWO)).of_controller("can:robotree/cell").fingerprint
    assert ring.key_for("udp:127.0.0.1:1") is None


def test_a_file_that_others_can_read_is_refused(path: Path) -> None:
    for mode in (0o640, 0o604, 0o660):
        path.chmod(mode)
        with pytest.raises(KeyFileError, match="others can read it; run chmod 600"):
            Keyring(path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_somebody_else_is_refused(path: Path) -> None:
    os.chown(path, 12345, -1)
    with pytest.raises(KeyFileError, match="belongs to somebody else"):
        Keyring(path)


@pytest.mark.parametrize("line", ["*", f"* {ONE}00", f"* {ONE[:-1]}x", f"{ONE}"])
def test_a_line_that_makes_no_sense_is_named_but_not_shown(path: Path, line: str) -> None:
    path.write_text(f"# comment\n{line}\n")
    with pytest.raises(KeyFileError, match="line 2 is no pattern and key of 64 digits") as refused:
        Keyring(path)
    assert ONE[:20] not in str(refused.value)
    assert refused.value.__cause__ is None


@pytest.mark.parametrize("text", ["", "\n\n", "# tcp:* later\n"])
def test_a_file_without_a_key_is_refused_for_it_would_switch_signing_off(path: Path, text: str) -> None:
    path.write_text(text)
    with pytest.raises(KeyFileError, match="holds no key; make another file"):
        Keyring(path)


@pytest.mark.parametrize(
    ("pattern", "address", "listening"),
    [
        ("udp:*", "tcp:127.0.0.1:0", True),
        ("udp:*", "tcp:127.0.0.1:5760", False),
        ("tcp:127.0.0.1:5760", "tcp:127.0.0.1:0", True),
        ("tcp:127.0.0.1:5761", "tcp:5760", False),
        ("can:robotree/cell?node=1&host=130", "can:robotree/cell?node=1", True),
        ("tcp:*", "tcp:5760?controller=arm-1", False),
        ("can:robotree/cell?node=1*", "can:robotree/cell?node=2", False),
        ("serial:/dev/ttyA*", "serial:/dev/ttyB", True),
    ],
)
def test_an_address_without_a_key_is_named_with_the_patterns_that_there_are(
    path: Path, pattern: str, address: str, *, listening: bool
) -> None:
    path.write_text(f"{pattern} {ONE}\n")
    with pytest.raises(UnmatchedLink) as refused:
        Keyring(path).require(address, listening=listening)
    assert f"no pattern matches the links of {address}; there is {pattern};" in str(refused.value)
    assert "--key none" in str(refused.value)


@pytest.mark.parametrize(
    ("pattern", "address", "listening"),
    [
        ("tcp:127.0.0.1:*", "tcp:0", True),
        ("tcp:127.0.0.1:5760", "tcp:5760", False),
        ("tcp:127.0.0.1:5760", "tcp:5760", True),
        ("arm-*", "tcp:5760?controller=arm-1", False),
        ("arm-*", "serial:/dev/ttyA?controller=arm-1", True),
        ("tcp:127.0.0.1:*", "tcp:localhost:5760", False),
        ("udp:127.0.0.1:*", "udp:localhost:5760", False),
        ("can:robotree/cell?node=1*", "can:robotree/cell", True),
        ("can:robotree/cell?node=1", "can:robotree/cell?fd=0", False),
        ("serial:/dev/ttyA?baud=9600", "serial:/dev/ttyA?baud=9600", False),
        ("udp:*", "tcp:no.such.host.invalid:5760", False),  # that there is no such host is told by the dial
    ],
)
def test_an_address_is_matched_as_its_links_will_be_called(
    path: Path, pattern: str, address: str, *, listening: bool
) -> None:
    path.write_text(f"{pattern} {ONE}\n")
    Keyring(path).require(address, listening=listening)
    path.write_text(f"tcp:192.0.2.1:* {ONE}\n")
    unknown_host = address.endswith(".invalid:5760")
    with nullcontext() if unknown_host else pytest.raises(UnmatchedLink):
        Keyring(path).require(address, listening=listening)


def test_a_missing_file_is_told_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="cannot be read: No such file"):
        Keyring(tmp_path / "nowhere")


def test_a_new_file_is_ours_alone_and_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "new.keys"
    create(path, "tcp:*")
    assert path.stat().st_mode & 0o777 == 0o600
    first = Keyring(path).key_for("tcp:x")
    assert first is not None
    with pytest.raises(KeyFileError, match="never overwritten"):
        create(path)
    again = Keyring(path).key_for("tcp:x")
    assert again is not None
    assert again.fingerprint == first.fingerprint


def test_time_is_kept_beside_the_keys(path: Path) -> None:
    ring = Keyring(path)
    assert ring.persisted() == 0
    ring.persist(1_000_000)
    ring.persist(2_000_000)
    assert Keyring(path).persisted() == 2_000_000
    assert path.with_name("wire.keys.time").stat().st_mode & 0o777 == 0o600


def test_a_program_whose_time_is_behind_does_not_set_the_common_time_back(path: Path) -> None:
    ahead, behind = Keyring(path), Keyring(path)
    ahead.persist(2_000_000)
    behind.persist(1_000_000)
    assert ahead.persisted() == behind.persisted() == 2_000_000


PERSISTER = """
import sys
from pathlib import Path
from robotree.protocol.links.keyring import Keyring
ring, numbers = Keyring(Path(sys.argv[1])), range(int(sys.argv[2]), 4000, 2)
newest = 0
for number in numbers:
    ring.persist(number)
    seen = ring.persisted()
    assert seen >= max(number, newest), (number, newest, seen)
    newest = seen
"""


def test_programs_that_share_a_file_never_see_its_time_go_back(path: Path) -> None:
    programs = [
        subprocess.Popen([sys.executable, "-c", PERSISTER, str(path), first], stderr=subprocess.PIPE)
        for first in ("3900", "3901")
    ]
    for program in programs:
        _, told = program.communicate(timeout=60)
        assert program.returncode == 0, told.decode()
    assert Keyring(path).persisted() == 3999
    assert sorted(each.name for each in path.parent.iterdir()) == ["wire.keys", "wire.keys.time"]


def test_a_time_that_cannot_be_kept_is_told(path: Path) -> None:
    ring = Keyring(path)
    path.with_name("wire.keys.time.new").mkdir()
    with pytest.raises(KeyFileError, match="cannot keep the signing time"):
        ring.persist(1)


@pytest.mark.parametrize("pattern", ["", "tcp:* x", "# all", "\n"])
def test_a_pattern_that_would_not_be_read_again_is_refused(tmp_path: Path, pattern: str) -> None:
    with pytest.raises(KeyFileError, match="is no pattern of addresses"):
        create(tmp_path / "new.keys", pattern)
    assert not (tmp_path / "new.keys").exists()


def test_a_passphrase_makes_the_key_that_ground_stations_make_of_it(tmp_path: Path) -> None:
    create(tmp_path / "new.keys", passphrase="correct horse")  # noqa: S106  not in use
    ((_, key),) = Keyring(tmp_path / "new.keys").keys
    told_by_sha256sum = "4104d36f8da2c254349f85836793ebe029e0c957063a34c91c2e9203187b5631"
    assert key.fingerprint == Key(bytes.fromhex(told_by_sha256sum)).fingerprint


def test_a_time_file_that_makes_no_sense_is_refused(path: Path) -> None:
    ring = Keyring(path)
    ring.persist(1)
    path.with_name("wire.keys.time").write_text("yesterday")
    with pytest.raises(KeyFileError, match="holds no time; remove it"):
        ring.persisted()


def test_a_keyring_shows_patterns_and_no_keys(path: Path) -> None:
    assert "can:*" in repr(Keyring(path))
    assert ONE not in repr(Keyring(path))


TCP, CAN = "tcp:127.0.0.1:5760", "can:robotree/cell"
NEW = bytes(range(32))


def fingerprint(ring: Keyring, address: str) -> str:
    key = ring.key_for(address)
    assert key is not None
    return key.fingerprint


def key_of(ring: Keyring, address: str) -> Key:
    key = ring.key_for(address)
    assert key is not None
    return key


def derived(secret: str, controller: str) -> str:
    return Key(bytes.fromhex(secret)).of_controller(controller).fingerprint


def test_a_controller_gets_a_key_of_its_own_and_every_other_byte_stays(path: Path) -> None:
    text = f"# die Zelle \xfc\r\n\r\n  tcp:127.0.0.1:*   {ONE}  \r\n# {ONE}\ncan:* {ONE}".encode("latin-1")
    path.write_bytes(text)
    ring, again = Keyring(path), bytes(reversed(NEW))
    ring.replace(TCP, key_of(ring, TCP), NEW, 4)
    assert path.read_bytes() == f"{TCP} {NEW.hex()}\n".encode() + text
    ring.replace(TCP, key_of(ring, TCP), again, 5)
    assert path.read_bytes() == f"{TCP} {again.hex()}\n".encode() + text
    assert path.stat().st_mode & 0o777 == 0o600
    for each in (ring, Keyring(path)):
        assert fingerprint(each, TCP) == Key(again).fingerprint
        assert fingerprint(each, "tcp:127.0.0.1:5761") == derived(ONE, "tcp:127.0.0.1:5761"), "of another one"
        assert fingerprint(each, CAN) == derived(ONE, CAN)
        assert each.persisted() == 5
    assert sorted(each.name for each in path.parent.iterdir()) == ["wire.keys", "wire.keys.time"]


def test_no_two_controllers_have_the_same_key(path: Path) -> None:
    path.write_text(f"{TCP} {NEW.hex()}\ntcp:* {ONE}\nudp:* {ONE}\n")
    ring, other = Keyring(path), "tcp:127.0.0.1:5761"
    keys = {fingerprint(ring, name) for name in (TCP, other, "tcp:127.0.0.1:5762", "udp:127.0.0.1:5760")}
    assert len(keys) == 4
    with pytest.raises(KeyFileError, match="two controllers have the same key, so that a recording of one"):
        ring.replace(other, key_of(ring, other), NEW, 5)
    path.write_text(f"{TCP} {ONE}\n{other} {ONE}\n")
    with pytest.raises(KeyFileError, match="give each line a key of its own"):
        Keyring(path)


def test_a_serial_line_needs_a_name_that_both_ends_know(path: Path) -> None:
    path.write_text(f"serial:* {ONE}\n")
    with pytest.raises(KeyFileError, match=r"another name at the other end .* \?controller=NAME"):
        Keyring(path).require("serial:/dev/ttyA", listening=False)


def test_a_symbolic_link_to_the_file_stays_one(path: Path) -> None:
    link = path.with_name("link.keys")
    link.symlink_to(path)
    ring = Keyring(link)
    ring.replace(TCP, key_of(ring, TCP), NEW, 5)
    assert link.is_symlink()
    assert fingerprint(Keyring(path), TCP) == Key(NEW).fingerprint


def test_all_links_to_a_file_find_one_signing_time(path: Path) -> None:
    """Else what was signed by way of one name could be played again to who uses another."""
    link = path.parent / "elsewhere" / "link"
    link.parent.mkdir()
    link.symlink_to(path)
    Keyring(path).persist(1234)
    assert Keyring(link).persisted() == 1234
    Keyring(link).persist(1300)
    assert Keyring(path).persisted() == 1300
    assert [each.name for each in link.parent.iterdir()] == ["link"]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ["wire.keys", "wire.keys.time", "wire.keys.time.new"])
def test_what_somebody_puts_in_the_place_of_a_file_neither_holds_us_up_nor_is_written_to(
    path: Path, name: str
) -> None:
    precious, spot = path.with_name("precious"), path.with_name(name)
    precious.touch(mode=0o600)
    precious.write_text("kept")
    if name != "wire.keys":
        Keyring(path).persist(7)
    for leads_to in ("", precious, "/dev/zero"):
        spot.unlink(missing_ok=True)
        spot.symlink_to(leads_to) if leads_to else os.mkfifo(spot)
        with suppress(KeyFileError):
            Keyring(path).persist(9)
    assert precious.read_text() == "kept"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a link away")
def test_nobody_else_chooses_the_key_by_a_link(path: Path) -> None:
    link = path.with_name("link")
    link.symlink_to(path)
    os.lchown(link, 12345, -1)
    with pytest.raises(KeyFileError, match="a link that user 12345 made"):
        Keyring(link)


def test_a_key_that_somebody_else_has_changed_is_not_replaced(path: Path) -> None:
    ring = Keyring(path)
    old = key_of(ring, TCP)
    path.write_text(f"tcp:* {TWO}\n")
    for address in (TCP, CAN):
        with pytest.raises(KeyFileError, match="another key was put in meanwhile"):
            ring.replace(address, old, NEW, 5)
    assert path.read_text() == f"tcp:* {TWO}\n"


def test_a_file_that_cannot_be_replaced_keeps_its_key_and_so_do_we(path: Path) -> None:
    path.with_name("wire.keys.new").mkdir()
    ring, before = Keyring(path), path.read_bytes()
    with pytest.raises(KeyFileError, match="cannot be written") as refused:
        ring.replace(TCP, key_of(ring, TCP), NEW, 5)
    assert NEW.hex()[:8] not in str(refused.value)
    assert path.read_bytes() == before
    assert fingerprint(ring, TCP) == derived(ONE, TCP)


def test_a_program_that_holds_the_file_delays_a_new_key_but_not_for_ever(path: Path) -> None:
    ring = Keyring(path)
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(KeyFileError, match=r"another program has held it for 0.25 s; let that go on"):
            ring.replace(TCP, key_of(ring, TCP), NEW, 5)
    ring.replace(TCP, key_of(ring, TCP), NEW, 5)


def test_what_another_program_puts_in_is_found(path: Path) -> None:
    ours, theirs = Keyring(path), Keyring(path)
    theirs.replace(TCP, key_of(theirs, TCP), NEW, 5)
    assert fingerprint(ours, TCP) == derived(ONE, TCP)
    ours.refresh()
    assert fingerprint(ours, TCP) == Key(NEW).fingerprint


def test_a_file_of_which_half_is_written_switches_no_signing_off(path: Path) -> None:
    """An editor may write it piece by piece; at every moment each link has its old key or its new one."""
    ring, whole = Keyring(path), f"tcp:* {TWO}\ncan:* {ONE}\nudp:* {TWO}\n"
    may = {
        TCP: {derived(key, TCP) for key in (ONE, TWO)},
        CAN: {derived(key, CAN) for key in (ONE, TWO)},
    }
    broken = 0
    for end in range(len(whole)):
        path.write_text(whole[:end])
        try:
            ring.refresh()
        except KeyFileError:
            broken += 1
        for address, keys in may.items():
            assert fingerprint(ring, address) in keys
    assert broken > 100
    path.write_text(whole)
    ring.refresh()
    assert fingerprint(ring, CAN) == derived(ONE, CAN)
    assert fingerprint(ring, "udp:127.0.0.1:1") == derived(TWO, "udp:127.0.0.1:1")


REPLACER = """
import sys
from pathlib import Path
from robotree.protocol.errors import KeyFileError
from robotree.protocol.links.keyring import Keyring
from robotree.protocol.signing import Key
ring, own = Keyring(Path(sys.argv[1])), int(sys.argv[2])
for number in range(40):
    ring.persist(100 * number + own)
    while True:
        try:
            ring.refresh()
            key = ring.key_for("tcp:127.0.0.1:1")
            ring.replace("tcp:127.0.0.1:1", key, bytes([own, number]) * 16, 100 * number)
            break
        except KeyFileError as error:
            told = str(error)  # on a busy machine the other one may hold the file for longer than one waits
            assert any(word in told for word in ("meanwhile", "cannot be written", "has held it")), told
"""


def test_programs_that_replace_keys_at_the_same_time_leave_a_whole_file(path: Path) -> None:
    programs = [
        subprocess.Popen([sys.executable, "-c", REPLACER, str(path), own], stderr=subprocess.PIPE)
        for own in ("1", "2")
    ]
    times: list[int] = []
    ring = Keyring(path)
    while any(program.poll() is None for program in programs):
        times.append(ring.persisted())
        ring.refresh()  # raises, if it ever finds half a file
        assert [pattern for pattern, _ in ring.keys][-2:] == ["tcp:127.0.0.1:*", "can:*"]
    for program in programs:
        _, told = program.communicate(timeout=60)
        assert program.returncode == 0, told.decode()
    assert times == sorted(times)
    assert fingerprint(Keyring(path), CAN) == derived(TWO, CAN)
    assert sorted(each.name for each in path.parent.iterdir()) == ["wire.keys", "wire.keys.time"]


NOW = 1_800_000_000.0
NAME = "tcp:127.0.0.1:5760"


@pytest.fixture
def heard_path(tmp_path: Path) -> Path:
    create(tmp_path / "cell.key")
    return tmp_path / "cell.key.heard"


def controller(heard_path: Path, at: float, heard: HeardFile) -> Verifier:
    """Start a controller at a time of its clock [s]."""
    pair = Security(Keyring(heard_path.with_suffix("")), lambda: at, heard=heard).signer_pair(NAME)
    verifier = pair["verifier"]
    assert verifier is not None
    return verifier


def said(heard_path: Path, at: float) -> bytes:
    """A frame of a program whose clock shows a time [s]."""
    key = Keyring(heard_path.with_suffix("")).key_for(NAME)
    assert key is not None
    signer = Signer(key, SigningTime(lambda: at), 7)
    return encode(Timesync(1, 2), sequence=0, system=255, component=190, signer=signer)


def passes(verifier: Verifier, frame: bytes) -> bool:
    return bool(Parser(verifier).feed(frame))


def test_what_was_heard_is_refused_after_a_kill_though_the_clock_was_set_back(heard_path: Path) -> None:
    heard = HeardFile(heard_path)
    recording = said(heard_path, NOW + 0.5)
    assert passes(controller(heard_path, NOW, heard), recording)
    heard.close()  # all that a kill leaves, for nothing was synced
    again = HeardFile(heard_path)
    restarted = controller(heard_path, NOW - 3600, again)
    assert not passes(restarted, recording)
    assert passes(restarted, said(heard_path, NOW + 0.6)), "a clock that was not set back is accepted at once"
    again.close()


def test_a_restart_delays_nobody_whose_clock_is_right(heard_path: Path) -> None:
    for start in range(5):
        heard = HeardFile(heard_path)
        verifier = controller(heard_path, NOW + start, heard)
        heard.reserve(int((NOW + start - EPOCH) * UNITS))
        assert passes(verifier, said(heard_path, NOW + start + 0.001))
        heard.close()


def test_after_a_power_cut_nothing_that_may_have_been_heard_is_heard_again(
    heard_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = HeardFile(heard_path)
    verifier = controller(heard_path, NOW, heard)
    heard.reserve(int((NOW - EPOCH) * UNITS))
    synced = heard_path.read_bytes()
    later = [said(heard_path, NOW + seconds) for seconds in (1.0, 5.0, 19.0)]
    assert all(passes(verifier, frame) for frame in later)
    heard.close()
    heard_path.write_bytes(synced)  # the rest was in the memory of the machine
    monkeypatch.setattr(module, "_life", lambda: b"another one".ljust(36, b"-"))
    heard = HeardFile(heard_path)
    restarted = controller(heard_path, NOW - 100, heard)
    assert not any(passes(restarted, frame) for frame in later)
    assert passes(restarted, said(heard_path, NOW + RESERVE / UNITS + 0.1))
    heard.close()


def test_a_time_ahead_of_the_reserve_is_kept_for_good_at_once(
    heard_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = HeardFile(heard_path)
    verifier = controller(heard_path, NOW, heard)
    recording = said(heard_path, NOW + 59)
    assert passes(verifier, recording)
    heard.close()
    monkeypatch.setattr(module, "_life", lambda: b"another one".ljust(36, b"-"))
    heard = HeardFile(heard_path)
    assert not passes(controller(heard_path, NOW, heard), recording)
    heard.close()


def test_who_is_refused_because_a_clock_was_set_back_is_told_what_to_do(heard_path: Path) -> None:
    heard = HeardFile(heard_path)
    assert passes(controller(heard_path, NOW, heard), said(heard_path, NOW + 0.1))
    heard.close()
    heard = HeardFile(heard_path)
    verifier = controller(heard_path, NOW - 3600, heard)
    assert not passes(verifier, said(heard_path, NOW - 3599))
    assert "their clock is 3599 s behind, and 60 s are allowed; set both clocks right" in rejection(verifier)
    assert "or give both ends a new key" in rejection(verifier)
    heard.close()


def test_no_flipped_bit_is_taken_for_an_earlier_time(
    heard_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    heard = HeardFile(heard_path)
    newest = int((NOW - EPOCH) * UNITS)
    heard.reserve(newest)
    heard.note(newest + 5)
    heard.close()
    whole = heard_path.read_bytes()
    for bit in range(8 * len(whole)):
        data = bytearray(whole)
        data[bit // 8] ^= 1 << bit % 8
        heard_path.write_bytes(data)
        heard = HeardFile(heard_path)
        assert heard.newest in {newest + 5, newest + RESERVE}
        heard.close()
    heard_path.write_bytes(b"nonsense" * 100)
    heard = HeardFile(heard_path)
    assert heard.newest == 0
    assert "is damaged; recordings are refused by the clock alone" in caplog.text
    heard.close()


def test_two_controllers_cannot_have_one_name(heard_path: Path) -> None:
    heard = HeardFile(heard_path)
    with pytest.raises(KeyFileError, match="another process is the controller of this name"):
        HeardFile(heard_path)
    heard.close()
    HeardFile(heard_path).close()


def test_a_file_that_cannot_be_opened_is_refused_in_one_sentence(heard_path: Path) -> None:
    with pytest.raises(KeyFileError, match="cannot be used: Is a directory"):
        HeardFile(heard_path.parent)


def test_a_full_disk_keeps_nobody_from_being_heard(
    heard_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    heard = HeardFile(heard_path)
    verifier = controller(heard_path, NOW, heard)
    monkeypatch.setattr(module.os, "pwrite", full)
    for second in range(1, 50):
        assert passes(verifier, said(heard_path, NOW + second))
    assert caplog.text.count("cannot be written (No space left on device)") == 1
    heard.close()
