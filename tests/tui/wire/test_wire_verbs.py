"""`robotree wire …` as a person types it, with a simulated arm at the other end."""

from __future__ import annotations

import asyncio
import gzip
import json
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from robotree.protocol import encode
from robotree.protocol.messages import Claim, ClaimWish, Heartbeat, NamedValueFloat, SetMode
from robotree.protocol.tools.capture import Recording, tlog
from robotree.tui import exit_codes
from robotree.tui.wire.lasting import Lasting
from robotree.tui.wire.replay import DATAGRAMS, Listeners, _send
from tests.command_line import ROBOTREE

NOON = 1_700_000_000_000_000
NO_FRAME = "there is no frame in it that we know; is it a recording, and not compressed?\n"


def recording(path: Path, count: int = 10, *, period: int = 10_000) -> Path:
    """A recording of named values."""
    frames = [encode(NamedValueFloat(n, "x", n / 2), sequence=n, system=1, component=1) for n in range(count)]
    path.write_bytes(b"".join(tlog.encode(NOON + n * period, raw) for n, raw in enumerate(frames)))
    return path


@pytest.mark.parametrize("verb", ["conform", "ping", "monitor"])
def test_a_verb_to_which_nobody_answers_ends_as_the_guide_says(say: Any, verb: str) -> None:
    with socket.socket() as closed:  # bound, and nobody listens
        closed.bind(("127.0.0.1", 0))
        address = f"tcp:127.0.0.1:{closed.getsockname()[1]}"
        assert say("wire", verb, "--connect", address).code == exit_codes.NOBODY


def test_conform_at_a_port_where_nobody_speaks_says_so(say: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        said = say("wire", "conform", "--connect", f"tcp:127.0.0.1:{silent.getsockname()[1]}")
        assert said.code == exit_codes.NOBODY
        assert "is a controller of robotree's dialect there?" in said.err


def test_decode_prints_an_object_per_frame_and_statistics_last(say: Any, tmp_path: Path) -> None:
    said = say("wire", "decode", recording(tmp_path / "a.tlog"), "--json")
    *frames, last = said.objects
    assert [frame["fields"]["value"] for frame in frames] == [n / 2 for n in range(10)]
    promised = {"msgid", "name", "sysid", "compid", "seq", "fields", "signed"}
    assert all(promised <= frame.keys() for frame in frames)
    assert last["statistics"]["frames"] == 10
    assert last["statistics"]["messages"] == {"NAMED_VALUE_FLOAT": 10}


def test_decode_tells_people_when_who_and_what(say: Any, tmp_path: Path) -> None:
    said = say("wire", "decode", recording(tmp_path / "a.tlog", 2))
    assert said.lines[1] == "22:13:20.010000 1/1 #1 NAMED_VALUE_FLOAT time_boot_ms=1 name='x' value=0.5"
    assert said.lines[2].split() == ["2", "200.0/s", "NAMED_VALUE_FLOAT"]
    assert said.lines[3].startswith("2 frames in 0.010 s from 58 bytes (tlog), 0 signed; lost 0")
    assert said.lines[-1].startswith("bad checksum 0")


def test_what_cannot_be_done_is_told_in_one_sentence(say: Any, tmp_path: Path) -> None:
    taken = recording(tmp_path / "a.tlog")
    (tmp_path / "a.raw").write_bytes(b"x")
    refused = {
        ("wire", "decode", "missing.tlog"): "missing.tlog: cannot be read: No such file",
        ("wire", "record", "--connect", "tcp:1", taken): "exists already, and recordings are not overwritten",
        ("wire", "record", "--connect", "tcp:1", "a.txt"): "its name must end with .tlog or .mcap",
        ("wire", "replay", tmp_path / "a.raw", "--listen", "tcp:0"): "has no times",
        ("wire", "dialect", "--lang", "ada", "out"): "there is c, c++",
    }
    unanswered = {
        ("wire", "ping", "--connect", "tcp:127.0.0.1:1"): "cannot be opened",
        ("wire", "ping", "--connect", "tcp:[::1]:1"): "tcp:[::1]:1 cannot be opened",
    }
    for words, sentence in {**refused, **unanswered}.items():
        said = say(*words)
        assert said.code == (exit_codes.NOBODY if words in unanswered else exit_codes.REFUSED)
        assert sentence in said.err
        assert said.err.count("\n") == 1
    misunderstood = {
        ("wire", "replay", taken): "wire replay: --connect or --listen is missing; usage: wire replay FILE",
        ("wire", "replay", taken, "--connect", "tcp:1", "--listen", "tcp:0"): "take only one of",
        ("wire", "record", "new.tlog"): "wire record: --connect is missing",
        ("wire", "inject", "--listen", "tcp:0"): "wire inject: --connect is missing",
        ("wire", "inject", "--listen", "tcp:0", "--connect", "tpc:1"): "'tpc:1' is no address of a link",
        ("sim", "arm"): "sim: --listen is missing",
        ("proxy", "arm", "arm-1"): "proxy: --connect is missing",
        ("wire", "dialect", "out"): "wire dialect: --lang is missing",
        ("wire", "replay", taken, "--listen", "tcp:0", "--speed", "0"): "is no speed",
        ("wire", "ping", "--connect", "tcp:1", "--count", "none"): "is no count",
        ("wire", "ping", "--connect", "tcp:1", "--by", "fax"): "there is ping and timesync",
        ("wire", "inject", "--listen", "tcp:0", "--connect", "tcp:1", "--loss", "2"): "is no share",
        ("wire", "decoed", "a"): "did you mean wire decode",
        ("wire",): "wire needs a second word: decode, record, replay, monitor, ping",
        ("wire", "ping", "--connect", "loop:x"): "begin it with can: or serial: or tcp: or udp:",
        ("wire", "replay", taken, "--listen", "tcp:0.0.0.0:0"): "0.0.0.0 can be reached from outside",
        ("sim", "arm", "--listen", "udp:192.0.2.1:0"): "192.0.2.1 can be reached from outside; listen on",
        ("proxy", "arm", "arm-1", "--connect", "loop:x"): "'loop:x' is no address",
        ("wire", "dissector", "--port", "port"): "is no port",
    }
    for words, sentence in misunderstood.items():
        said = say(*words)
        assert said.code == exit_codes.USAGE, words
        assert sentence in said.err


def test_help_knows_the_verbs_of_two_words(say: Any) -> None:
    assert "wire decode FILE" in say("wire", "--help").out
    assert say("help", "wire", "ping").out.startswith("usage: robotree wire ping --connect URL")
    assert say("wire", "ping", "--help").out == say("help", "wire", "ping").out


def test_the_arm_is_recorded_and_its_recording_replayed(say: Any, arm: str, tmp_path: Path) -> None:
    first, again = tmp_path / "first.tlog", tmp_path / "again.mcap"
    said = say("wire", "record", "--connect", arm, first, "--for", "1s", "--json")
    count = said.objects[0]["frames"]
    assert count > 50
    words = [*ROBOTREE, "wire", "replay", str(first), "--listen", "tcp:127.0.0.1:0", "--speed", "4"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as replaying:
        assert replaying.stdout is not None
        address = replaying.stdout.readline().split()[1]
        assert say("wire", "record", "--connect", address, again).code == exit_codes.DONE
    assert replaying.returncode == exit_codes.DONE
    *one, before = say("wire", "decode", first, "--json").objects
    *other, after = say("wire", "decode", again, "--json").objects
    assert [frame["fields"] for frame in other] == [frame["fields"] for frame in one]
    assert len(one) == count
    took = {
        name: told["statistics"]["last"] - told["statistics"]["first"]
        for name, told in (("first", before), ("again", after))
    }
    assert took["again"] == pytest.approx(took["first"] / 4, rel=0.5)


def test_a_controller_that_is_dialled_hears_nothing_that_commands_unless_that_is_asked_for(
    say: Any, tmp_path: Path
) -> None:
    path = tmp_path / "a.tlog"
    claim = Claim(5, 9, 3000, 0, 1, 1, ClaimWish.KEEP, "a proxy")
    spoken = (Heartbeat(6, 8, 0, 0, 4), SetMode(9, 1, 1, 1), NamedValueFloat(1, "x", 0.5), claim)
    frames = [encode(each, sequence=n, system=255, component=1) for n, each in enumerate(spoken)]
    path.write_bytes(b"".join(tlog.encode(NOON + n, raw) for n, raw in enumerate(frames)))

    def replayed(*words: str) -> tuple[dict[str, Any], bytes]:
        with socket.create_server(("127.0.0.1", 0)) as controller:
            address = f"tcp:127.0.0.1:{controller.getsockname()[1]}"
            said = say("wire", "replay", path, "--connect", address, *words, "--json")
            with controller.accept()[0] as link, link.makefile("rb") as heard:
                return said.objects[-1], heard.read()

    passive, whole = replayed(), replayed("--commands")
    left_out = {"ROBOTREE_SET_MODE": 1, "ROBOTREE_CLAIM": 1}
    assert passive == ({"frames": 2, "withheld": 0, "commands": left_out}, frames[0] + frames[2])
    assert whole == ({"frames": 4, "withheld": 0, "commands": {}}, b"".join(frames))


def test_a_recording_of_commands_alone_says_how_to_send_it(say: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog.encode(NOON, encode(SetMode(9, 1, 1, 1), sequence=0, system=255, component=1)))
    said = say("wire", "replay", path, "--connect", "tcp:127.0.0.1:1")
    assert said.code == exit_codes.REFUSED
    assert "has nothing but what commands; --commands sends that" in said.err


async def test_who_cannot_make_a_replay_wait_is_not_sent_faster_than_it_can_read() -> None:
    class Datagrams:
        """Some far end behind UDP."""

        congested = False

        def __init__(self) -> None:
            self.times: list[float] = []

        def send(self, _: bytes) -> None:
            self.times.append(asyncio.get_running_loop().time())

    here, link = Lasting(), Datagrams()
    crowd = Listeners(here)
    crowd.links[link] = None  # type: ignore[index]  # all that is needed of a link
    sent = await _send(((0.0, b"x") for _ in range(200)), crowd, here)
    assert sent == len(link.times) == 200
    assert all(late - soon > 60 / DATAGRAMS for soon, late in zip(link.times, link.times[80:], strict=False))


def test_monitor_shows_rates_delay_and_last_values(say: Any, arm: str) -> None:
    said = say("wire", "monitor", "--connect", arm, arm, "--for", "1.6s", "--every", "500ms", "--json")
    links = said.objects[-1]["links"]
    assert len(links) == 2
    for link in links:
        rows = {row["name"]: row for row in link["messages"]}
        assert 0 < rows["ROBOTREE_JOINTS"]["rate"] < 100  # 50; fewer where the arm has no processor to itself
        assert rows["ROBOTREE_JOINTS"]["age"] < 5
        assert link["loss"] == 0
        assert 0 < link["delay"] < 5
        assert link["bytes_per_second"] > 1000
        peers = [(who["sysid"], who["compid"], who["there"]) for who in link["peers"]]
        assert peers == [(1, 1, True), (1, 100, True), (1, 101, True)]  # the controller and two cameras
    table = say("wire", "monitor", "--connect", arm, "--for", "300ms", "--every", "200ms").out
    assert "MESSAGE" in table
    assert "there: 1/1 GENERIC STANDBY" in table
    assert "\x1b" not in table


def test_the_monitor_shows_who_holds_the_claim(say: Any, arm: str) -> None:
    watching = ("wire", "monitor", "--connect", arm, "--for", "1.2s", "--every", "1.1s")
    assert "\nclaim on 1/1: free, epoch 0\n" in say(*watching).out
    claim = Claim(5, 9, 30_000, 0, 1, 1, ClaimWish.KEEP, "rover-1, pid 812")
    port = int(arm.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as proxy:
        proxy.sendall(encode(claim, sequence=0, system=255, component=30))
        assert "\nclaim on 1/1: held by rover-1, pid 812 (255/30), epoch 9\n" in say(*watching).out


def test_ping_measures_and_says_when_nobody_answers(say: Any, arm: str, tmp_path: Path) -> None:
    words = ("wire", "ping", "--connect", arm, "--count", "5", "--every", "20ms")
    said = say(*words, "--by", "timesync", "--json")
    *answers, last = said.objects
    assert said.code == exit_codes.DONE
    assert [answer["seq"] for answer in answers] == [1, 2, 3, 4, 5]
    assert last["statistics"]["answered"] == 5
    assert 0 < last["statistics"]["shortest"] <= last["statistics"]["longest"] < 1
    slow = recording(tmp_path / "a.tlog", 2, period=9_000_000)
    dumb = [*ROBOTREE, "wire", "replay", str(slow), "--listen", "tcp:0"]
    with subprocess.Popen(dumb, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        said = say("wire", "ping", "--connect", address, "--count", "2", "--every", "10ms")
        process.terminate()
    assert said.code == exit_codes.NOBODY
    assert said.lines[-1].startswith("2 asked, 0 answered, 100% lost")
    assert said.err == "robotree: 1/1 speaks, but answers no PING; try --by timesync\n"


def test_a_bad_link_is_seen_by_the_monitor(say: Any, arm: str) -> None:
    words = [*ROBOTREE, "wire", "inject", "--listen", "tcp:0", "--connect", arm, "--delay", "40ms", "--json"]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        address = json.loads(process.stdout.readline())["ready"]
        assert process.stderr.readline() == "loss 0%, delay 40 ms, jitter 0 ms, duplication 0%\n"
        process.stdin.write("loss 50%\n")
        process.stdin.flush()
        assert process.stderr.readline() == "loss 50%, delay 40 ms, jitter 0 ms, duplication 0%\n"
        said = say("wire", "monitor", "--connect", address, "--for", "2.5s", "--every", "500ms", "--json")
        link = said.objects[-1]["links"][0]
        assert 0.2 < link["loss"] < 0.8
        assert link["delay"] is None or link["delay"] >= 0.04
        process.send_signal(signal.SIGTERM)
        traffic = json.loads(process.stdout.readline())["traffic"]
    assert 0 < traffic["far"]["passed"] < traffic["far"]["taken"]
    assert process.returncode == exit_codes.DONE


def test_who_is_a_bad_link_says_what_is_in_force_and_fails_where_no_robot_is(
    say: Any, tmp_path: Path
) -> None:
    words = [*ROBOTREE, "wire", "inject", "--listen", "tcp:127.0.0.1:0", "--connect", "tcp:127.0.0.1:1"]
    pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([*words, "--delay", "20"], text=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stderr is not None
        address = process.stdout.readline().split()[1]
        process.stdin.write("cut 10min\ndelay 15ms\nheal\n")
        process.stdin.flush()
        began, cut, changed, healed = (process.stderr.readline() for _ in range(4))
        say("wire", "record", "--connect", address, tmp_path / "a.tlog", "--for", "5s")
        assert process.stderr.readline() == "robotree: tcp:127.0.0.1:1 cannot be opened: Connection refused\n"
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
    assert process.returncode == exit_codes.REFUSED
    assert began == "loss 0%, delay 20 s, jitter 0 ms, duplication 0%\n"
    assert cut.startswith(began.rstrip() + "; cut, 600 s left")
    assert changed.startswith("loss 0%, delay 15 ms, jitter 0 ms, duplication 0%; cut, ")
    assert healed == "loss 0%, delay 0 ms, jitter 0 ms, duplication 0%\n"


def test_ctrl_c_ends_a_recording_in_order(arm: str, tmp_path: Path) -> None:
    words = [*ROBOTREE, "wire", "record", "--connect", arm, str(tmp_path / "a.mcap"), "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("recording tcp:")
        while (tmp_path / "a.mcap").stat().st_size < 10_000:
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == exit_codes.DONE
    assert json.loads(out)["frames"] > 0
    assert Recording(str(tmp_path / "a.mcap")).form == "mcap"


@pytest.mark.parametrize(
    ("verb", "name", "data"),
    [
        ("decode", "a.tlog.gz", gzip.compress(b"\xfd" * 500, mtime=0)),
        ("decode", "a.txt", b"(no recording), but a text with words.\n" * 50),
        ("decode", "a.raw", b""),
        ("decode", "a.mcap", b"\x89MCAP0\r\n" + bytes(100)),
        ("replay --listen tcp:127.0.0.1:0", "a.tlog", bytes(range(256)) * 100),
    ],
)
def test_a_file_that_is_no_recording_is_not_taken_with_success(
    say: Any, tmp_path: Path, verb: str, name: str, data: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    said = say("wire", *verb.split(), path)
    assert (said.code, said.err) == (exit_codes.REFUSED, f"robotree: {path}: {NO_FRAME}")


def test_a_taken_address_is_answered_with_what_can_be_done_about_it(
    say: Any, arm: str, tmp_path: Path
) -> None:
    taken = say("sim", "arm", "--listen", arm)
    assert "choose another port (0: any free one)" in taken.err
    assert taken.code == exit_codes.REFUSED, "what cannot start has not asked anybody"
    missing = say("sim", "arm", "--listen", f"serial:{tmp_path}/ttyX").err
    assert "name the device of a port that is there" in missing
    assert "port (0" not in missing
