"""A script that only watches a partner: it knows its readings, and takes nothing from who commands it."""

from __future__ import annotations

import pytest

from robotree.tui.line.known_kinds import checked_script
from robotree.vr.author.command import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.errors import BrokenScript
from robotree.vr.scripts.known import check_known
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.stage import Stage

WATCHES = """
script: guard
partners:
  cart: {kind: Cart, watch: yes}
  robot: {kind: Companion, needs: [say]}
rules:
  - rule: low
    when: [reading: {partner: cart, name: battery, value: {below: 0.2}}]
    then: [do: [robot, say, the cart is empty]]
"""


class Cart(Robot):
    """A cart."""

    battery = 0.9

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery}

    @command
    def load(self) -> None:
        """Take something on."""


async def test_the_readings_of_a_watched_partner_reach_the_rules_and_it_stays_free(stage: Stage) -> None:
    robot, cart = await stage.companion(), Cart("cart")
    agent = await stage.start(cart)
    script = await stage.script(WATCHES, "guard")
    await stage.enslave("guard", "robot", "c1")
    assert script.condition == "inactive: needs cart (Cart)"
    await stage.enslave("guard", "cart", "cart")
    running = stage.begin("guard")
    await stage.until(lambda: script.condition == "active")
    assert agent.runtime.lease is None, "watching takes no lease"
    await stage.call("cart", "load")
    assert robot.done == []
    cart.battery = 0.1
    await stage.until(lambda: bool(robot.done), within=60.0)
    assert robot.done == ["say the cart is empty [plain]"]
    await stage.call("guard", "finish")
    await running


def test_what_is_only_watched_is_asked_nothing() -> None:
    source = WATCHES.replace("do: [robot, say, the cart is empty]", "do: [cart, load]")
    with pytest.raises(BrokenScript, match="cart is only watched, and is asked nothing"):
        check_known(read_yaml(source, "guard.yaml"), {})
    with pytest.raises(BrokenScript, match="partner cart is only watched: it has no needs"):
        read_yaml(WATCHES.replace("watch: yes", "watch: yes, needs: [load]"), "guard.yaml")


@pytest.mark.parametrize("given", ["pictures", "[pictures, force]"])
def test_a_script_that_wants_streams_of_who_is_watched_is_told_that_it_has_readings(given: str) -> None:
    with pytest.raises(BrokenScript, match=r"watch is yes or no; .* has the readings, and no streams"):
        read_yaml(WATCHES.replace("watch: yes", f"watch: {given}"), "guard.yaml")


@pytest.mark.parametrize("watch", ["", ", watch: yes"])
def test_a_reading_that_is_a_stream_is_refused_where_it_stands(watch: str) -> None:
    source = (
        f"script: guard\npartners:\n  arm: {{kind: Arm{watch}}}\nrules:\n  - rule: pushed\n"
        "    when: [reading: {partner: arm, name: force, value: {above: 3}}]\n    then: [end: it is pushed]\n"
    )
    sentence = r"guard.yaml:6:\d+: force is a stream of arm, and no reading: a page with Watch"
    with pytest.raises(BrokenScript, match=sentence):
        checked_script(source, "guard.yaml")
    assert checked_script(source.replace("force", "fz"), "guard.yaml") == 1


def test_the_role_of_a_service_passes_the_checks_though_it_is_nearly_one_that_comes_along() -> None:
    source = WATCHES.replace("[do: [robot, say, the cart is empty]]", "[role: {robot: desk-butler}]")
    assert checked_script(source, "guard.yaml") == 1
    with pytest.raises(BrokenScript, match="there is no role 'buttler'"):
        checked_script(source.replace("desk-butler", "buttler"), "guard.yaml")
