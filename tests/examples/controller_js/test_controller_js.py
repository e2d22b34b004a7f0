"""The controller in JavaScript: its messages, the real proxy of an arm before it, and its memory."""

from __future__ import annotations

import json
import math
import random
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from robotree.protocol.dialect.table import definitions
from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    TYPED,
    Claim,
    ClaimStatus,
    ClaimWish,
    Goal,
    GoalState,
    GoalStatus,
    Message,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.testing import random_values
from tests.examples.controllers import JAVASCRIPT, started
from tests.station import Station

pytestmark = pytest.mark.e2e

T = TypeVar("T", bound=Message)
SAID_AGAIN = """
const { MavLinkPacketParser, MavLinkPacketSplitter } = require('node-mavlink');
const wire = require('./robotree.js');
process.stdin.pipe(new MavLinkPacketSplitter({}, { magicNumbers: wire.MAGIC_NUMBERS }))
  .pipe(new MavLinkPacketParser()).on('data', ({ header, payload, protocol: spoken }) => {
    [spoken.sysid, spoken.compid] = [header.sysid, header.compid];
    process.stdout.write(spoken.serialize(spoken.data(payload, wire.REGISTRY[header.msgid]), header.seq));
  });
"""
"""Reads frames, and writes each one again from the message that it has read."""
HARNESS = """
const {{ MavLinkPacketParser, MavLinkPacketSplitter, MavLinkProtocolV2 }} = require('node-mavlink');
const wire = require('./robotree.js');
const socket = new (require('node:stream').PassThrough)(), sequence = 5;
const hear = ({{ epoch }}, ...from) => console.log(JSON.stringify([epoch, ...from]));
{}
"""
"""What the guide leaves out around its lines; the socket gives back what is written to it."""
COMPARED = """
const { common, minimal, standard } = require('node-mavlink');
const wire = require('./robotree.js');
const theirs = { ...minimal.REGISTRY, ...standard.REGISTRY, ...common.REGISTRY };
const both = Object.keys(theirs).filter((id) => id in wire.REGISTRY);
const differ = both.filter((id) => theirs[id].MAGIC_NUMBER !== wire.REGISTRY[id].MAGIC_NUMBER);
console.log(JSON.stringify([both.length, differ]));
"""


@pytest.fixture(scope="session")
def folder(controller_js: list[str]) -> Path:
    return Path(controller_js[-1]).parent


def test_all_of_its_packages_are_pinned_and_no_registry_is_named() -> None:
    lock = json.loads((JAVASCRIPT / "package-lock.json").read_text())
    packages = {name: each for name, each in lock["packages"].items() if name}
    assert packages["node_modules/node-mavlink"]["version"] == "2.3.0"
    assert all(each["integrity"].startswith("sha512-") for each in packages.values())
    assert not any("resolved" in each for each in packages.values())


def test_node_mavlink_reads_and_writes_each_of_our_messages_without_a_change(
    controller_js: list[str], folder: Path
) -> None:
    chance = random.Random(1)
    ours = [each for each in definitions().values() if each.name.startswith("ROBOTREE_")] * 8
    messages = [TYPED[each.id].codec.build(*random_values(each, chance).values()) for each in ours]
    frames = b"".join(encode(each, sequence=i, system=7, component=9) for i, each in enumerate(messages))
    done = subprocess.run(
        [controller_js[0], "-e", SAID_AGAIN], cwd=folder, input=frames, capture_output=True, check=True
    )
    assert len(frames) > 4000
    assert done.stdout == frames, done.stderr


def test_the_lines_of_the_guide_send_and_hear_a_message(controller_js: list[str], folder: Path) -> None:
    guide = (JAVASCRIPT.parents[1] / "docs" / "bring-your-own-robot.md").read_text()
    (lines,) = re.findall(r"```js\n(.*?)```", guide, re.DOTALL)
    words = [controller_js[0], "-e", HARNESS.format(lines)]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.stdout == "[3,1,1]\n", done.stderr


def test_messages_that_node_mavlink_has_too_have_the_same_checksums(
    controller_js: list[str], folder: Path
) -> None:
    done = subprocess.run([controller_js[0], "-e", COMPARED], cwd=folder, capture_output=True, check=True)
    both, differ = json.loads(done.stdout)
    assert both > 200
    assert differ == []


def goal(key: int, epoch: int, *, verb: int = Verb.HOLD) -> Goal:
    return Goal(key, epoch, 0, (math.nan,) * 7, verb, 1, 1)


async def hear(station: Station, kind: type[T], such: Callable[[T], bool] = lambda _: True) -> T:
    message: T = await station.next(lambda message: isinstance(message, kind) and such(message))
    return message


async def answer(station: Station, key: int, epoch: int) -> GoalStatus:
    station.say(goal(key, epoch))
    return await hear(station, GoalStatus, lambda it: it.key == key and it.state != GoalState.ACTIVE)


async def test_a_restart_forgets_no_lease_and_has_another_life(
    controller_js: list[str], tmp_path: Path
) -> None:
    words = [*controller_js, "0", "--memory", str(tmp_path / "arm.json")]
    lives: list[int] = []
    for options in (["--reset-epoch"], []):
        with started([*words, *options]) as running:
            station = await Station(component=30).dial(running.url)
            mode = await hear(station, Mode)
            lives.append(mode.life)
            assert mode.epoch == (0 if options else 7)
            if options:
                station.say(Claim(5, 7, 9000, 0, 1, 1, ClaimWish.KEEP, "arm-1, pid 812"))
                await hear(station, ClaimStatus, lambda it: it.holder == 5)
                continue
            held = await hear(station, ClaimStatus)
            assert (held.holder, held.name) == (5, "arm-1, pid 812"), "it waits for its last holder"
            await hear(station, ClaimStatus, lambda it: not it.holder)
            assert (await answer(station, 1, 6)).reason == Reason.STALE_EPOCH
            assert (await answer(station, 2, 7)).state == GoalState.SUCCEEDED
    assert lives[1] == lives[0] % 0xFFFF + 1


@pytest.mark.parametrize("damage", ["missing", "a flipped bit", "half of it", "empty"])
def test_a_memory_that_is_lost_is_no_lower_epoch(
    damage: str, controller_js: list[str], tmp_path: Path
) -> None:
    memory = tmp_path / "arm.json"
    words = [*controller_js, "0", "--memory", str(memory)]
    with started([*words, "--reset-epoch"]):
        pass
    data = memory.read_bytes()
    flipped = re.sub(rb'"epoch":0', b'"epoch":1', data)
    wrong = {"a flipped bit": flipped, "half of it": data[: len(data) // 2], "empty": b""}
    if damage == "missing":
        memory.unlink()
    else:
        assert wrong[damage] != data
        memory.write_bytes(wrong[damage])
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "is damaged or missing, so nobody knows which leases were obeyed" in done.stderr


async def test_what_it_cannot_remember_it_does_not_obey_but_a_stop(
    controller_js: list[str], tmp_path: Path
) -> None:
    folder = tmp_path / "memory"
    folder.mkdir()
    with started([*controller_js, "0", "--memory", str(folder / "arm.json"), "--reset-epoch"]) as running:
        station = await Station(component=30).dial(running.url)
        assert (await answer(station, 1, 7)).state == GoalState.SUCCEEDED
        shutil.rmtree(folder)
        refused = await answer(station, 2, 8)
        assert (refused.state, refused.reason, refused.epoch) == (GoalState.REFUSED, Reason.FAULT, 7)
        station.say(Claim(5, 9, 9000, 0, 1, 1, ClaimWish.KEEP, "arm-1"))
        status = await hear(station, ClaimStatus, lambda it: it.target_component == 30)
        assert (status.holder, status.reason) == (0, Reason.FAULT)
        assert (await answer(station, 3, 7)).state == GoalState.SUCCEEDED, "what it obeys it goes on to obey"
        station.say(SetMode(0, 1, 1, ModeKind.SAFE_STOP))
        await hear(station, Mode, lambda it: it.mode == ModeKind.SAFE_STOP)
        assert "its memory cannot be written" in running.complaints()


@pytest.mark.parametrize("words", ["", "x", "65536", "1 2", "0 --memory", "0 --memory=", "0 --wrong"])
def test_a_wrong_command_line_is_answered_with_the_right_one(controller_js: list[str], words: str) -> None:
    line = [*controller_js, *words.split()]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr.split()[0]) == (2, "usage:")
