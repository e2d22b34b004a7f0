"""MAVSDK, the library that people write their missions with, works with the simulated arm."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from tests.command_line import ROBOTREE

pytestmark = pytest.mark.interop

ACCEPTED, REJECTED, DENIED, CANCELLED = 0, 1, 2, 6
NOT_IN_CONTROL = 13
"""The detail of an answer."""
SUCCESS = 1
"""What MAVSDK's own methods answer."""
GO_TO = 57601
TAKE_CONTROL = 32100
MODE_READY, MODE_ACTIVE, MODE_SAFE_STOP = 1, 2, 4


@pytest.fixture
def sdk(mavsdk: Callable[[str], Any], arm: str) -> Any:
    """MAVSDK that has found the arm."""
    return mavsdk(arm)


def mode(sdk: Any) -> int:
    """What the controller says it is doing."""
    return int(sdk.ask("direct", "next", "ROBOTREE_MODE")["mode"])


def until_mode(sdk: Any, wanted: int) -> None:
    """Wait until the controller says so; it does twice a second."""
    heard = [mode(sdk)]
    while heard[-1] != wanted:
        assert len(heard) < 10, heard
        heard.append(mode(sdk))


def test_it_learns_the_version(sdk: Any) -> None:
    version = sdk.ask("info", "get_version")
    assert (version["flight_sw_major"], version["flight_sw_minor"]) == (0, 1)


def test_parameters_are_listed_set_and_refused_with_the_reason(sdk: Any) -> None:
    told = sdk.ask("param", "get_all_params")
    assert (told["int_params"], told["custom_params"]) == ([], [])
    names = {each["name"] for each in told["float_params"]}
    assert {"TOOL_SPEED", "GRIP_FORCE", "LINK_SILENCE"} <= names
    assert sdk.ask("param", "set_param_float", "TOOL_SPEED", 0.1) == SUCCESS
    assert sdk.ask("param", "get_param_float", "TOOL_SPEED") == pytest.approx(0.1)
    assert sdk.ask("param", "set_param_float", "TOOL_SPEED", 9.0) == {"error": "VALUE_OUT_OF_RANGE"}
    assert sdk.ask("param", "set_param_float", "NO_SUCH", 1.0) == {"error": "DOES_NOT_EXIST"}
    assert sdk.ask("param", "get_param_float", "TOOL_SPEED") == pytest.approx(0.1)


def test_it_reads_texts_units_and_limits_of_the_parameters(sdk: Any) -> None:
    told = {each["name"]: each for each in sdk.ask("metadata", "parameters")["parameters"]}
    assert told["TOOL_SPEED"]["units"] == "m/s"
    assert told["TOOL_SPEED"]["shortDesc"] == "Of a goal that names no speed"
    assert (told["LINK_SILENCE"]["min"], told["LINK_SILENCE"]["max"]) == (0.01, 3600)


def test_it_lists_the_files_and_changes_none(sdk: Any) -> None:
    listed = sdk.ask("ftp", "list_directory", "/")["entries"]
    assert [each["name"] for each in listed] == ["general.json", "parameter.json"]
    assert "error" in sdk.ask("ftp", "remove_file", "/general.json")


def test_a_named_command_moves_the_arm_and_waits_for_its_end(sdk: Any) -> None:
    began = time.monotonic()
    ended = sdk.command(GO_TO, 0.45, 0.1, 0.3, 0.0)
    assert ended["result"] == ACCEPTED
    assert time.monotonic() - began > 0.5, "so far does no arm go at once"
    tool = sdk.ask("direct", "next", "ROBOTREE_TOOL")
    assert (tool["x"], tool["y"], tool["z"]) == pytest.approx((0.45, 0.1, 0.3), abs=0.005)
    assert sdk.command(GO_TO, 9.0, 0.0, 0.3, 0.0)["result"] == DENIED


def test_the_gripper_plugin_opens_and_closes_the_fingers(sdk: Any) -> None:
    def width() -> float:
        told = sdk.ask("direct", "next", "ROBOTREE_GRIPPER")
        return float(told["width"])

    assert sdk.ask("gripper", "release", 0) == SUCCESS
    deadline = time.monotonic() + 10
    while width() < 0.075:
        assert time.monotonic() < deadline
    assert sdk.ask("gripper", "grab", 0) == SUCCESS
    while width() > 0.01:
        assert time.monotonic() < deadline


@pytest.mark.parametrize("method", ["kill", "disarm", "terminate"])
def test_what_ends_a_flight_stops_the_arm_until_it_is_armed(sdk: Any, method: str) -> None:
    assert sdk.ask("action", method) == SUCCESS
    until_mode(sdk, MODE_SAFE_STOP)
    assert sdk.command(GO_TO, 0.45, 0.1, 0.3, 0.0)["result"] != ACCEPTED
    assert sdk.ask("action", "arm") == SUCCESS
    until_mode(sdk, MODE_READY)


def test_nobody_on_the_wire_reboots_the_controller(sdk: Any) -> None:
    assert sdk.ask("action", "reboot") == {"error": "COMMAND_DENIED"}


@pytest.fixture
def claim(start: Callable[..., Any], arm: str) -> Callable[[], Any]:
    """Starts a proxy that claims the arm; it holds the claim when this returns."""

    def begin() -> Any:
        proxy = start(*ROBOTREE, "proxy", "arm", "arm-1", "--connect", f"tcp:{arm}")
        proxy.reads("ready")
        return proxy

    return begin


def holder(sdk: Any, *, held: bool) -> None:
    """Wait until the arm says that somebody holds its claim, or that nobody does."""
    for _ in range(20):
        if bool(sdk.ask("direct", "next", "ROBOTREE_CLAIM_STATUS")["term_ms"]) is held:
            return
    pytest.fail(f"held did not become {held}")


@pytest.mark.parametrize("connected", ["before", "after"])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_after_a_proxy_has_claimed_and_gone_its_plain_commands_are_obeyed(
    mavsdk: Callable[[str], Any], arm: str, claim: Callable[[], Any], connected: str, times: int
) -> None:
    sdk = mavsdk(arm) if connected == "before" else None
    for _ in range(times):
        proxy = claim()
        if sdk:
            holder(sdk, held=True)
        proxy.end()
    sdk = sdk or mavsdk(arm)
    holder(sdk, held=False)
    assert sdk.command(GO_TO, 0.45, 0.1, 0.3, 0.0)["result"] == ACCEPTED
    assert sdk.command(GO_TO, 0.45, 0.0, 0.3, 0.0)["result"] == ACCEPTED
    assert sdk.ask("gripper", "release", 0) == SUCCESS


def test_beside_a_proxy_each_command_returns_and_it_commands_when_it_has_taken_control(
    mavsdk: Callable[[str], Any], arm: str, claim: Callable[[], Any]
) -> None:
    sdk = mavsdk(arm)
    claim()
    holder(sdk, held=True)
    for _ in range(3):
        refused = sdk.command(GO_TO, 0.45, 0.1, 0.3, 0.0)
        assert (refused["result"], refused["result_param2"]) == (REJECTED, NOT_IN_CONTROL)
        assert sdk.ask("gripper", "release", 0) == {"error": "FAILED"}
    assert sdk.command(TAKE_CONTROL, 1, 1, 10)["result"] == ACCEPTED
    assert sdk.command(GO_TO, 0.45, 0.1, 0.3, 0.0)["result"] == ACCEPTED
    assert sdk.command(TAKE_CONTROL, 0)["result"] == ACCEPTED
    assert sdk.command(GO_TO, 0.45, 0.0, 0.3, 0.0)["result"] == REJECTED


def test_a_command_that_another_one_ends_returns(mavsdk: Callable[[str], Any], arm: str) -> None:
    moving, stopping = mavsdk(arm), mavsdk(arm)
    moving.begin(GO_TO, 0.45, -0.3, 0.3, 0.0)
    until_mode(stopping, MODE_ACTIVE)
    assert stopping.ask("action", "kill") == SUCCESS
    assert moving.answer()["result"] == CANCELLED
    assert stopping.ask("action", "arm") == SUCCESS
    assert moving.command(GO_TO, 0.45, 0.1, 0.3, 0.0)["result"] == ACCEPTED


def test_our_own_messages_are_sent_by_the_dialect_s_xml_alone(sdk: Any) -> None:
    args = [0.4, 0.05, 0.35, 0.0, 0.1, 0.0, 0.0]
    goal = {"key": 7, "epoch": 1, "ttl_ms": 0, "args": args, "verb": 1}
    sdk.ask("direct", "send_message", {"name": "ROBOTREE_GOAL", "fields": goal})
    told = sdk.ask("direct", "next", "ROBOTREE_GOAL_STATUS")
    assert told["key"] == 7
