"""A person says yes to a call of a robot that cannot read the permit: at another site, or apart."""

from __future__ import annotations

import asyncio
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters

from robotree.client.blocking import Realm
from tests.assistants.conftest import ME, PAGE, text
from tests.command_line import ran
from tests.plant import Plant

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400)]
PATIENT = 60.0

RULES = f"""realm: plant
version: 1
persons: {{'{ME}': all, '{ME}@lab': all, '{ME}@hall': all}}
assistants: {{claude: {{role: helper, calls: 1000, metres: 30, seconds: 300}}}}
roles:
  all: {{see: '*', command: '*', create: '*', resume: '*', administrate: yes}}
  helper: {{see: '*', command: '*.count', ask: '*.walk'}}
"""


@pytest.fixture(scope="module")
def plant() -> Iterator[tuple[Plant, Realm]]:
    """Two linked sites with a policy, and two carts at hall, one of them apart; and the realm at hall."""
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        found = Plant(Path(folder))
        try:
            lab, hall = found.lab, found.hall
            lab.say("realm", "create", "plant", "--hub", found.start_hub(), "--site", "lab")
            lab.start("gateway", "gateway")
            hall.say("realm", "join", lab.say("realm", "invite", "hall")["token"])
            hall.start("gateway", "gateway")
            for machine in (lab, hall):
                machine.start("lookup", "lookup", f"lookup-{machine.name}")
            hall.start("host", "host", "host-hall")
            page, rules = Path(folder) / "cart.py", Path(folder) / "plant.yaml"
            page.write_text(PAGE)
            rules.write_text(RULES)
            hall.say("create", str(page), "as", "cart")
            hall.say("create", str(page), "as", "lone", "--isolate", "process")
            lab.say("policy", "set", str(rules))
            for cart in ("cart", "lone"):
                lab.until_listed(cart)
            with hall.joined() as realm:
                yield found, realm
        finally:
            for machine in found.machines:
                for called in list(machine.running):
                    machine.end(called, signal.SIGKILL)


@pytest.mark.parametrize(("site", "cart"), [("lab", "lone"), ("hall", "lone")])
async def test_a_yes_is_good_once_for_a_call_of_a_robot_that_cannot_read_it(
    plant: tuple[Plant, Realm], site: str, cart: str
) -> None:
    sites, realm = plant
    here, hall, count = sites.lab if site == "lab" else sites.hall, sites.hall, realm[cart].count
    key = {"ROBOTREE_MCP_KEY": here.say("assistant", "invite", "claude")["key"]}
    server = StdioServerParameters(
        command=sys.executable, args=["-m", "robotree.tui", "mcp"], env={**here.environment, **key}
    )
    before = count()
    async with Client(server, read_timeout_seconds=PATIENT) as client:

        async def asked() -> str:
            answer = await client.call_tool(f"{cart}__walk", {"x": 2, "_why": "to see it go"})
            if "has no policy" in text(answer):  # that of lab is on its way to hall
                await asyncio.sleep(0.1)
                return await asked()
            assert not answer.is_error, text(answer)
            told: Any = answer.structured_content
            return str(told["permit"])

        async def begun(permit: str) -> str:
            answer = await client.call_tool("robotree_permit", {"permit": permit})
            return text(answer) if answer.is_error else ""

        permit = await asked()
        [shown] = here.say("permits")
        assert (shown["assistant"], shown["arguments"]) == ("claude", {"x": 2.0})
        assert ("at site hall" in shown["preview"]) == (here is not hall)
        assert count() == before
        here.say("permit", "allow", permit)
        assert await begun(permit) == ""
        assert count() == before + 1
        assert "it is over" in await begun(permit)
        # what was stopped there since is another robot than the person has seen
        permit = await asked()
        here.say("permit", "allow", permit)
        realm.stop(cart)
        realm.resume(cart)
        assert "was stopped since" in await begun(permit)
        assert count() == before + 1
    why = hall.text("why", cart)
    assert "claude says «to see it go»" in why
    assert "said yes at" in why


FORGER = """
import asyncio, sys, time
from robotree.client.joining import joined
from robotree.vr.base.envelope import asking_for_assistant
from robotree.vr.base.errors import VrError
from robotree.vr.base.permit import Permit
from robotree.vr.base.requests import Call

async def main():
    async with joined("plant") as realm:
        cart, now = await realm.describe(sys.argv[1]), time.time()
        begun = dict(state="begun", asked=now, answered=now, key="k")
        what = dict(command="walk", arguments={"x": 1.0})
        life = dict(life=cart.address.key, stops=cart.stops)
        forged = Permit(id="abcdefgh", assistant="claude", robot=sys.argv[1], **begun, **what, **life)
        call = Call(key="k", deadline=9.0, permit="abcdefgh", vouched=forged, **what)
        with asking_for_assistant("claude"):
            try:
                await realm.carry_out(cart.address, call)
            except VrError as error:
                print(type(error).__name__, error)

asyncio.run(main())
"""


@pytest.mark.parametrize(("site", "cart"), [("lab", "cart"), ("hall", "cart"), ("hall", "lone")])
def test_a_robot_believes_no_permit_that_nobody_has_read_from_its_realm(
    plant: tuple[Plant, Realm], site: str, cart: str
) -> None:
    """A program of each site that speaks the protocol itself writes a permit into its call."""
    sites, realm = plant
    before, machine = realm[cart].count(), sites.lab if site == "lab" else sites.hall
    done = ran([sys.executable, "-c", FORGER, cart], check=True, env=machine.environment)
    assert done.stdout.strip() == "PermitRefused permit abcdefgh does not allow this: there is none"
    assert realm[cart].count() == before
