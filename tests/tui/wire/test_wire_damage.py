"""Full disks, killed recorders and damaged files: who is at fault is named, and what was kept stays."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from robotree.protocol import encode
from robotree.protocol.messages import NamedValueFloat
from robotree.protocol.tools.capture import Recording, tlog
from robotree.tui import exit_codes
from tests.command_line import NO_BYTECODE, ROBOTREE, ran

NOON = 1_700_000_000_000_000


def damaged(path: Path) -> Path:
    """A recording of ten values, one of them with a flipped bit in its time."""
    frames = [encode(NamedValueFloat(n, "x", n / 2), sequence=n, system=1, component=1) for n in range(10)]
    times = [(NOON + n * 10_000) ^ ((n == 4) << 62) for n in range(10)]
    path.write_bytes(b"".join(map(tlog.encode, times, frames)))
    return path


def test_a_damaged_time_is_counted_and_its_frame_shown_without_one(say: Any, tmp_path: Path) -> None:
    path = damaged(tmp_path / "a.tlog")
    *frames, last = say("wire", "decode", path, "--json").objects
    assert [frame["fields"]["value"] for frame in frames] == [n / 2 for n in range(10)]
    assert [n for n, one in enumerate(frames) if "time" not in one] == [4]
    assert last["statistics"]["bad_times"] == 1
    said = say("wire", "decode", path)
    assert said.code == exit_codes.DONE
    assert "1 frames with a damaged time" in said.out


def test_a_replay_does_not_wait_for_a_damaged_time(say: Any, tmp_path: Path) -> None:
    words = [*ROBOTREE, "wire", "replay", str(damaged(tmp_path / "a.tlog")), "--listen", "tcp:127.0.0.1:0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as replaying:
        assert replaying.stdout is not None
        address = replaying.stdout.readline().split()[1]
        said = say("wire", "record", "--connect", address, tmp_path / "again.tlog", "--json", "--for", "20s")
        replaying.terminate()
    assert said.objects[0]["frames"] == 10
    assert said.objects[0]["seconds"] < 10


@pytest.mark.parametrize("suffix", ["tlog", "mcap"])
def test_a_killed_recorder_leaves_what_it_heard(arm: str, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    words = [*ROBOTREE, "wire", "record", "--connect", arm, str(path)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as recording:
        assert recording.stderr is not None
        recording.stderr.readline()
        began = time.monotonic()
        while not path.exists() or path.stat().st_size < 4096:
            assert time.monotonic() < began + 60, "nothing is ever written"
            time.sleep(0.05)
        recording.kill()
    kept = Recording(str(path))
    assert sum(map(len, kept.frames())) > 10
    assert kept.statistics.broken == 0


def test_a_link_that_cannot_be_had_leaves_no_file_in_the_way_of_the_next_attempt(
    say: Any, arm: str, tmp_path: Path
) -> None:
    words = ("wire", "record", tmp_path / "a.tlog", "--for", "300ms", "--connect")
    assert say(*words, "tcp:127.0.0.1:1").code == exit_codes.NOBODY
    assert [*tmp_path.iterdir()] == []
    assert say(*words, arm).code == exit_codes.DONE


@pytest.mark.parametrize(("suffix", "limit"), [("tlog", 8192), ("mcap", 32768)])
def test_a_full_disk_is_blamed_on_the_file_and_not_on_the_link(
    arm: str, tmp_path: Path, suffix: str, limit: int
) -> None:
    path = tmp_path / f"a.{suffix}"
    done = ran(
        [*ROBOTREE, "wire", "record", "--connect", arm, str(path), "--for", "20s"],
        within=60,
        env={**os.environ, **NO_BYTECODE},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == exit_codes.REFUSED
    kept = sum(map(len, Recording(str(path)).frames()))
    told = f"cannot be written: File too large; the first {kept} frames are kept"
    assert done.stderr.splitlines()[1:] == [f"robotree: {path}: {told}"]
    assert 0 < path.stat().st_size <= limit
    assert kept > 10


def test_a_full_disk_is_not_blamed_on_what_a_dialect_is_made_of(say: Any, tmp_path: Path) -> None:
    said = say("wire", "dialect", "--lang", "python", "/dev/full")
    assert re.fullmatch(r"robotree: /dev/full cannot be written: [\w ]+\n", said.err)
    assert said.code == exit_codes.REFUSED
    done = ran(
        [*ROBOTREE, "wire", "dialect", "--lang", "c", "out"],
        within=60,
        cwd=tmp_path,
        env={**os.environ, **NO_BYTECODE},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )
    assert re.fullmatch(r"robotree: .*/robotree-dialect-\w+ cannot be written: [\w ]+\n", done.stderr)
    assert done.returncode == exit_codes.REFUSED


@pytest.mark.parametrize("words", ["dissector", "monitor --for 1s --connect"])
def test_results_that_cannot_be_written_are_not_blamed_on_the_link(arm: str, words: str) -> None:
    command = [*ROBOTREE, "wire", *words.split(), *[arm] * words.endswith("connect")]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=60
        )
    assert done.stderr.endswith("robotree: standard output: no space left on device\n")
    assert done.returncode == exit_codes.REFUSED
