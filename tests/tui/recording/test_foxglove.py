"""Foxglove sees a living realm and calls its commands; who has no token does not."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import sys
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from robotree.tui.recording import foxglove_messages as messages
from robotree.tui.recording import foxglove_protocol as protocol
from robotree.tui.recording import foxglove_server
from robotree.tui.recording.foxglove_protocol import BadMessage, ServiceCall
from robotree.tui.recording.foxglove_server import FoxgloveServer, listening
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from tests.tui.conftest import play
from tests.tui.recording.foxglove_client import connected
from tests.waiting import until

if TYPE_CHECKING:
    from conftest import Realm

TOKEN = "sesame"  # noqa: S105 # of a test


@asynccontextmanager
async def serving(realm: Realm, *, services: bool = True) -> AsyncGenerator[str]:
    """Serve a realm; yields the address with the token."""
    server = FoxgloveServer(realm.realm_client, TOKEN, services=services, rate=20.0)
    await server.look()
    async with listening(server, 0) as there:
        following = asyncio.create_task(server.follow())
        try:
            yield f"ws://127.0.0.1:{next(iter(there.sockets)).getsockname()[1]}/{TOKEN}"
        finally:
            following.cancel()
            await asyncio.gather(following, return_exceptions=True)


async def test_readings_logs_pictures_and_transforms_come(realm: Realm) -> None:
    async with serving(realm) as address, connected(address) as client:
        topics = ("/robots/arm-1/readings", "/tf", "/views/cell/cell")
        await until(lambda: set(topics) <= client.channels.keys(), "all channels are there")
        assert client.connection.subprotocol == "foxglove.sdk.v1"
        assert client.info["capabilities"] == ["services"]
        for number, topic in enumerate(topics):
            await client.subscribe(topic, number)
        await until(lambda: client.heard.keys() == {0, 1, 2}, "each is heard")
        assert client.heard[0][0]["x"] == pytest.approx(0.35)
        (transform,) = client.heard[1][0]["transforms"]
        assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "arm-1")
        assert client.heard[2][0]["format"] == "jpeg"
        await client.call("/robots/arm-1/stumble", 1)
        await until(lambda: "/log" in client.channels, "its log is there")
        await until(lambda: 1 in client.answers, "it has failed")
        assert client.answers[1] == "arm-1.stumble failed: a stone [/x] lay there"


async def test_a_command_is_a_service_with_its_schema_and_its_limits(realm: Realm) -> None:
    async with serving(realm) as address, connected(address) as client:
        await until(lambda: "/robots/arm-1/go_to" in client.services, "its services are there")
        assert '"maximum": 0.8' in client.services["/robots/arm-1/go_to"]["request"]["schema"]
        await client.call("/robots/arm-1/get_info", 1)
        await client.call("/robots/arm-1/go_to", 2, x=5.0, y=0, z=0.3, twist=0)
        await client.call("/robots/arm-1/shout", 3, text="hey")
        await until(lambda: {1, 2, 3} <= client.answers.keys(), "all have answered")
        assert client.answers[1]["result"]["z"] == pytest.approx(0.4)
        assert "go_to" in client.answers[2]
        assert client.answers[3] == {"result": "hey"}


async def test_a_robot_that_has_a_parent_obeys_no_service(realm: Realm) -> None:
    report, _ = await play(realm, "create move_to.py as mover\nenslave mover.arm arm-1\n")
    assert report.ok
    async with serving(realm) as address, connected(address) as client:
        await until(lambda: "/robots/mover/move" in client.services, "its services are there")
        await client.call("/robots/arm-1/hold", 1)
        await until(lambda: 1 in client.answers, "it has answered")
        assert "mover" in client.answers[1]


async def test_the_command_of_a_client_that_vanishes_ends(realm: Realm) -> None:
    realm.arm.under_way = True
    async with serving(realm) as address:
        async with connected(address) as client:
            await until(lambda: "/robots/arm-1/go_to" in client.services, "its services are there")
            await client.call("/robots/arm-1/go_to", 1, x=0.3, y=0, z=0.3, twist=0)
            await until(lambda: realm.arm.calls == ["go_to"], "it has begun")
            client.connection.transport.abort()

        await idle(realm)
    realm.arm.under_way = False


async def idle(realm: Realm) -> None:
    """Wait until the arm does nothing."""
    async with asyncio.timeout(30):
        while (await realm.realm_client.describe("arm-1")).busy:  # noqa: ASYNC110 # a robot is asked
            await asyncio.sleep(0.05)


HANGS = """
import asyncio, sys
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from tests.tui.recording.foxglove_client import connected
async def main():
    async with connected(sys.argv[1]) as client:
        while not {"/tf", "/views/cell/cell"} <= client.channels.keys() or not client.services:
            await asyncio.sleep(0.01)
        await client.subscribe("/views/cell/cell", 1)
        await client.call("/robots/arm-1/go_to", 1, x=0.3, y=0, z=0.3, twist=0)
        await asyncio.sleep(600)
asyncio.run(main())
"""


async def test_the_command_of_a_client_that_hangs_ends(realm: Realm, monkeypatch: pytest.MonkeyPatch) -> None:
    assert foxglove_server.BEAT + foxglove_server.SILENCE < 10.0
    monkeypatch.setattr(foxglove_server, "BEAT", 0.2)
    monkeypatch.setattr(foxglove_server, "SILENCE", 2.0)
    realm.arm.under_way = True
    async with serving(realm) as address:
        root = Path(__file__).parents[3]
        client = await asyncio.create_subprocess_exec(sys.executable, "-c", HANGS, address, cwd=root)
        try:
            await until(lambda: realm.arm.calls == ["go_to"], "it has begun")
            os.kill(client.pid, signal.SIGSTOP)
            await idle(realm)
        finally:
            client.kill()
            await client.wait()
    realm.arm.under_way = False


async def test_who_has_no_token_or_comes_from_another_site_is_refused(realm: Realm) -> None:
    async with serving(realm) as address:
        bare = address.removesuffix(TOKEN)
        for wrong, origin, status in (
            (bare, None, HTTPStatus.UNAUTHORIZED),
            (f"{bare}sesam", None, HTTPStatus.UNAUTHORIZED),
            (address, "https://evil.example", HTTPStatus.FORBIDDEN),
            (address, "null", HTTPStatus.FORBIDDEN),
        ):
            with pytest.raises(InvalidStatus) as refusal:
                async with connected(wrong, origin):
                    pass
            assert refusal.value.response.status_code == status
        async with connected(address, "https://app.foxglove.dev") as client:
            await until(lambda: bool(client.info), "Foxglove's own site may")


async def test_who_may_only_look_finds_no_services(realm: Realm) -> None:
    async with serving(realm, services=False) as address, connected(address) as client:
        await until(lambda: "/robots/arm-1/readings" in client.channels, "it sees")
        assert client.services == {}
        assert client.info["capabilities"] == []


@pytest.mark.parametrize(
    "message",
    [
        *(b"", b"\x02", b"\x07" + bytes(20), "no JSON", '{"op": "subscribe"}', "[]"),
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 99999999999, "channelId": 1}]}',
    ],
)
async def test_what_is_no_message_ends_the_connection_alone(
    realm: Realm, message: Any, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving(realm) as address, connected(address) as other, connected(address) as client:
        await client.connection.send(message)
        await client.connection.wait_closed()
        await until(lambda: bool(other.channels), "others are served")
        with pytest.raises(ConnectionClosed):
            await client.connection.send("{}")
        other.connection.transport.abort()
    assert "Traceback" not in caplog.text


@given(payload=st.binary(), service=st.integers(0, 2**32 - 1), call=st.integers(0, 2**32 - 1))
def test_a_call_is_read_as_it_was_written(payload: bytes, service: int, call: int) -> None:
    written = protocol.answered(ServiceCall(service, call, b""), payload)
    assert protocol.service_call(b"\x02" + written[1:]) == ServiceCall(service, call, payload)


@given(message=st.binary(max_size=40))
def test_bytes_of_anybody_are_a_call_or_refused(message: bytes) -> None:
    with contextlib.suppress(BadMessage):
        assert protocol.service_call(message).payload in message
    with contextlib.suppress(BadMessage):
        new, over = protocol.wanted(message.decode("latin-1"))
        assert not new or not over


def robot(name: str, **attributes: str) -> RobotDescription:
    return RobotDescription(address=Address("robot", name, "a"), kinds=("Any",), attributes=attributes)


def test_a_robot_without_a_place_has_no_transform_and_a_base_carries_a_body() -> None:
    assert messages.transforms("lamp", {"brightness": 1.0}, None, 0.0) is None
    found = messages.transforms("rover-1", {"x": 1.0, "y": 2.0, "heading": math.pi}, None, 1.5)
    assert found is not None
    (turned,) = found["transforms"]
    assert turned["timestamp"] == {"sec": 1, "nsec": 500_000_000}
    assert turned["parent_frame_id"] == "world"
    assert turned["rotation"]["z"] == pytest.approx(1.0)
    legs = messages.transforms("legs", {"x": 1, "y": 2, "heading": 0}, robot("legs", controller="her"), 0.0)
    assert legs is not None
    assert [one["child_frame_id"] for one in legs["transforms"]] == ["legs", "her/body"]
