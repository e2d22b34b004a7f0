"""Nothing leaves a host before its cause is written, and a result is kept before the child forgets it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from robotree.vr.base.address import Address
from robotree.vr.base.principal import Credentials
from robotree.vr.base.requests import Returned
from robotree.vr.base.transport import Incoming
from robotree.vr.journal.outlet import Outlet
from robotree.vr.running.child_call import ChildCall


class Wire:
    """A transport that notes what leaves by it."""

    presence: Any = None
    identity: Any = None

    def __init__(self, order: list[str]) -> None:
        self.order = order
        self.take: Any = None

    def __getattr__(self, name: str) -> Any:
        return lambda *_values, **_options: self.order.append(name)

    async def serve(self, _key: str, take: Any, **_: Any) -> Any:
        self.take = take

    async def announce(self, _key: str, **_: Any) -> Any:
        self.order.append("announce")

    async def close(self) -> None:
        self.order.append("close")


async def test_whatever_leaves_is_written_before() -> None:
    order: list[str] = []
    wire = Wire(order)
    outlet = Outlet(wire, lambda: order.append("written"))  # type: ignore[arg-type] # as far as it is used here
    outlet.ask("k", b"", on_reply=lambda _: None)
    outlet.request("k", b"", timeout=1.0)
    outlet.publish("k", b"")
    await outlet.announce("k")
    await outlet.serve("k", lambda incoming: (incoming.reply(b""), incoming.end(b""))[0])
    wire.take(
        Incoming(
            b"",
            Credentials(1, 1),
            lambda _: order.append("reply"),
            lambda _: order.append("end"),
            lambda _: None,
        )
    )
    await outlet.close()
    left = ("ask", "request", "publish", "announce", "reply", "end", "close")
    assert order == [word for each in left for word in ("written", each)]


def test_a_number_is_given_back_when_the_result_of_its_call_is_kept() -> None:
    order: list[str] = []
    frame: Any = SimpleNamespace(
        keeps=True,
        keep_step=lambda _path, _step: order.append("kept"),
        worker=SimpleNamespace(wake=lambda: None),
    )
    call = ChildCall(frame, "arm", "k/1", Address("robot", "arm", "1"), "go", None, passes_on=False)
    call._leave = (lambda: order.append("given back"),)
    call.settle(Returned(key="k/1"))
    assert order == ["kept", "given back"]
