"""What connected clients cost a simulated controller, beyond its physics.

    python bench/sim_clients.py [--clients N] [--rate HZ] [--seconds S]

Each client connects over TCP and asks for JOINTS, TOOL and GRIPPER at the rate; what it hears besides is the
default. The cost is processor time of the whole controller (threads of loop and physics) per second of its
own time, in which it keeps its rates also when the machine is too busy for real time; with the clients and
without, in turns in one run. The bound is 20 % of a core for ten clients at 100 Hz.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from asyncio.subprocess import PIPE

from measuring import options, stay

from robotree.protocol.frame import encode
from robotree.protocol.messages import CommandLong, Gripper, Heartbeat, Joints, MavCmd, Message, Tool
from robotree.sim.serving.server import Server, serving

BOUND = 0.20
TURNS = 3
ASKED: tuple[type[Message], ...] = (Joints, Tool, Gripper)


def orders(rate: float) -> bytes:
    """What a client says first."""
    said: list[Message] = [Heartbeat(6, 8, 0, 0, 4)]
    for kind in ASKED:
        msgid = float(kind.codec.definition.id)
        said.append(CommandLong(1, 1, MavCmd.SET_MESSAGE_INTERVAL, 0, msgid, 1e6 / rate, 0, 0, 0, 0, 0))
    return b"".join(encode(each, sequence=i, system=255, component=190) for i, each in enumerate(said))


async def crowd(address: str, clients: int, rate: float) -> float:
    """Be the clients until standard input ends; the bytes that they heard in a second."""
    host, port = address.removeprefix("tcp:").split(":")
    heard = 0

    async def listen(reader: asyncio.StreamReader) -> None:
        nonlocal heard
        while data := await reader.read(65536):
            heard += len(data)

    listening = []
    for _ in range(clients):
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(orders(rate))
        listening.append((asyncio.create_task(listen(reader)), writer))
    await asyncio.sleep(0.5)
    began, heard = time.monotonic(), 0
    await asyncio.to_thread(stay)
    return heard / (time.monotonic() - began)


async def share(server: Server, seconds: float) -> float:
    """Of a core, that this process takes while its controller lives for about `seconds`."""
    began, processor = server.pace.time_ms, time.process_time()
    await asyncio.sleep(seconds)
    return 1e3 * (time.process_time() - processor) / (server.pace.time_ms - began)


async def measure(clients: int, rate: float, seconds: float) -> dict[str, float]:
    """Take turns without and with the clients."""
    alone, together, heard = [], [], []
    async with serving("arm", "tcp:127.0.0.1:0") as server:
        await asyncio.sleep(1.0)
        before = server.pace
        for _ in range(TURNS):
            alone.append(await share(server, seconds))
            arguments = [server.address, str(clients), str(rate)]
            far = await asyncio.create_subprocess_exec(
                sys.executable, __file__, "--crowd", *arguments, stdin=PIPE, stdout=PIPE
            )
            if far.stdin is None or far.stdout is None:
                raise RuntimeError("the clients' process has no pipes")
            await far.stdout.readline()
            together.append(await share(server, seconds))
            far.stdin.close()
            said, _ = await far.communicate()
            heard.append(float(said))
        dropped = server.pace.dropped - before.dropped
    costs = [with_clients - without for with_clients, without in zip(together, alone, strict=True)]
    return {
        "alone": statistics.median(alone),
        "together": statistics.median(together),
        "clients": statistics.median(costs),
        "bytes_per_second": statistics.median(heard),
        "debt_dropped_s": dropped,
    }


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--crowd"]:
        address, clients, rate = sys.argv[2:]
        print(asyncio.run(crowd(address, int(clients), float(rate))))
        return
    given = options(__doc__, clients=10, rate=100.0, seconds=4.0)
    figures = asyncio.run(measure(given.clients, given.rate, given.seconds))
    verdict = "" if figures["clients"] < BOUND else f", above the bound of {100 * BOUND:g} %"
    print(f"controller alone           {100 * figures['alone']:6.1f} % of a core")
    print(f"with {given.clients:3} clients at {given.rate:g} Hz {100 * figures['together']:6.1f} %")
    print(f"the clients                {100 * figures['clients']:6.1f} %{verdict}")
    heard, dropped = figures["bytes_per_second"] / 1e3, figures["debt_dropped_s"]
    print(f"they heard {heard:.0f} kB/s; real time was missed by {dropped:.1f} s")


if __name__ == "__main__":
    main()
