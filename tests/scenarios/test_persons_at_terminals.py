"""A person at a real terminal: points where the simulated arm shall go, drives a rover, looks at its wire."""

from __future__ import annotations

import asyncio
import json
import math
import re
import time
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from tests.command_line import ROBOTREE, ran, within_realm
from tests.terminal import CTRL_R, ENTER, RIGHT, Person
from tests.waiting import PATIENCE, until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400), pytest.mark.usefixtures("place")]

REALM = "places"
UP, LEFT = "\x1b[A", "\x1b[D"
MOUSE = "\x1b[<0;{column};{row}M\x1b[<0;{column};{row}m"
"""A click of the left button, as terminals tell it (SGR, xterm's control sequences)."""
CURSOR = re.compile(r"x (-?\d+\.\d+).{1,12}y (-?\d+\.\d+)", re.DOTALL)


def plain(shown: bytes) -> str:
    """What was drawn, without what steers the terminal."""
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", " ", shown.decode(errors="replace"))


def somewhere_in_reach(person: Person) -> str:
    """Click here and there in the picture until the arm says that it would go there; return that click."""
    for row in (14, 13, 15, 16, 12):
        for column in (62, 58, 66, 54, 70):
            click = MOUSE.format(column=column, row=row)
            person.types(click, sees="  y ")
            person.shows(b"the robot", b"arm-1.", b"nothing is there")
            if b"the robot" in person.shown:
                return click
    raise AssertionError("no point of the picture is in reach")


def say(*words: str) -> tuple[int, dict[str, Any]]:
    """Run a line; its exit code and its data."""
    done = ran([*ROBOTREE, "--realm", REALM, *words, "--json"], within=120)
    return done.returncode, json.loads(done.stdout)


@pytest.mark.timeout(400)
async def test_the_arm_goes_where_somebody_points() -> None:
    async with Crew(REALM, key="none") as crew, joined(REALM) as realm_client:
        sim, _ = await crew.start_all(
            ("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--state", "none"), ("lookup", "lookup-1")
        )
        await crew.start_all(
            ("proxy", "arm", "arm-1", "--connect", sim.address), ("view", "cell", "--connect", sim.address)
        )
        await until(lambda: bool(realm_client.robots() and realm_client.views()), "all are listed")

        async def at(x: float, y: float) -> None:
            """Wait until the tool is there."""
            ends = time.monotonic() + PATIENCE
            while True:
                info = (await realm_client.describe("arm-1")).readings
                if math.hypot(info.get("x", 9.0) - x, info.get("y", 9.0) - y) < 0.01:
                    return
                assert time.monotonic() < ends, info
                await asyncio.sleep(0.1)

        person = Person(REALM)
        try:
            await asyncio.to_thread(person.shows, b"arm-1")
            await asyncio.to_thread(person.types, "F", sees="from above")
            await asyncio.to_thread(person.types, UP * 2 + LEFT, sees="the robot would go")
            found = CURSOR.search(plain(person.shown))
            await asyncio.to_thread(person.types, ENTER, sees="Send arm-1 there?")
            await asyncio.to_thread(person.types, RIGHT + ENTER, sees="is done")
            goal = (await realm_client.read_log("arm-1"))[-1].text
            x, y = (float(re.search(rf"{axis}=(-?[\d.]+)", goal)[1]) for axis in "xy")  # type: ignore[index]
            await at(x, y)
            assert found is None or math.hypot(float(found[1]) - x, float(found[2]) - y) < 0.05
            # a picture
            await asyncio.to_thread(person.types, "v", sees="\u2580")  # before it nothing can be pointed at
            click = await asyncio.to_thread(somewhere_in_reach, person)
            await asyncio.to_thread(person.types, click, sees="Send arm-1 there?")
            await asyncio.to_thread(person.types, RIGHT + ENTER, sees="is done")
            goal = (await realm_client.read_log("arm-1"))[-1].text
            await at(*(float(re.search(rf"{axis}=(-?[\d.]+)", goal)[1]) for axis in "xy"))  # type: ignore[index]
            assert b"Traceback" not in person.shown
        finally:
            await asyncio.to_thread(person.leave)
        await named_places(realm_client)


async def named_places(realm_client: Any) -> None:
    """A name stands for a place wherever a pose is asked; what is out of reach is one sentence."""
    code, place = await asyncio.to_thread(
        say, "places", "add", "shelf", "of", "arm-1", "x=0.35", "y=0.15", "z=0.3"
    )
    assert (code, place["at"]) == (exit_codes.DONE, {"x": 0.35, "y": 0.15, "z": 0.3})
    code, told = await asyncio.to_thread(say, "go", "arm-1", "@shelf", "--preview")
    assert (code, told["done"], told["way"]["checked"]) == (exit_codes.DONE, False, True)
    assert (told["way"]["x"][-1], told["way"]["y"][-1]) == pytest.approx((0.35, 0.15), abs=1e-6)
    code, _ = await asyncio.to_thread(say, "call", "arm-1.go_to", "@shelf", "twist=0")
    readings = (await realm_client.describe("arm-1")).readings
    assert code == exit_codes.DONE
    assert (readings["x"], readings["y"]) == pytest.approx((0.35, 0.15), abs=0.01)
    code, refused = await asyncio.to_thread(say, "go", "arm-1", "x=0.6", "y=0.6")
    assert code == exit_codes.REFUSED
    assert "is out of reach: no posture brings the tool there" in refused["message"]
    code, refused = await asyncio.to_thread(say, "go", "arm-1", "@nowhere")
    assert (code, refused["message"]) == (
        exit_codes.USAGE,
        "PLACE: there is no place @nowhere; known: @shelf",
    )
    code, refused = await asyncio.to_thread(say, "call", "arm-1.grip", "@shelf")
    assert code == exit_codes.USAGE
    assert "arm-1.grip asks for no pose" in refused["message"]
    await asyncio.to_thread(say, "stop")
    code, refused = await asyncio.to_thread(say, "go", "arm-1", "@shelf", "--preview")
    assert code == exit_codes.REFUSED
    assert "safe stop is in force" in refused["message"]


@pytest.mark.timeout(300)
async def test_a_rover_is_moved_by_who_knows_nothing_of_robots() -> None:
    async with Crew("user", key="none") as crew:
        sim, _ = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none"), ("lookup", "lookup-1")
        )
        await crew.start("proxy", "rover", "rover-1", "--connect", sim.address)
        person = Person("user", "user", columns=40, lines=20)
        try:
            await asyncio.to_thread(person.shows, b"Move by a distance")
            for keys, sees in (
                (ENTER, "by rover-1"),
                (f"0.2{ENTER}0{ENTER}", "typed"),
                (CTRL_R, "Results"),
            ):
                await asyncio.to_thread(person.types, keys, sees=sees)
            await asyncio.to_thread(person.types, " ", sees="")
            # of the row, either line may be drawn anew
            await asyncio.to_thread(person.shows, b"go on?", b"stopped: rover-1")
            assert b"Traceback" not in person.shown
        finally:
            await asyncio.to_thread(person.leave)


async def test_a_field_on_the_wire_is_ticked_and_drawn(place: Path) -> None:
    run = within_realm("messages")
    async with Crew("messages", place) as crew:
        await crew.start("lookup", "l1")
        rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none")
        await crew.start("proxy", "rover", "rover-1", "--connect", rover.address)
        code, _, complaints = await run("show", "rover-1")
        assert code == 0, complaints
        person = Person("messages", columns=140, lines=44)
        try:
            await asyncio.to_thread(person.shows, b"rover-1")
            await asyncio.to_thread(person.types, "Q", sees="HEARTBEAT")
            await asyncio.to_thread(person.types, "", sees="□")
            await asyncio.to_thread(person.types, ENTER, sees="0.")
            await asyncio.to_thread(person.types, ENTER, sees="■")
            await asyncio.to_thread(person.types, "U", sees="⠉⠉")
        finally:
            person.leave()
