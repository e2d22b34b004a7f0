"""MAVProxy, the ground station of the terminal, works with the simulated arm as with any vehicle."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from tests.command_line import ROBOTREE
from tests.examples.controllers import generated

pytestmark = pytest.mark.interop


@pytest.fixture
def proxy(mavproxy: Callable[[str], Any], arm: str) -> Any:
    """MAVProxy that has seen the arm."""
    program = mavproxy(arm)
    program.reads(r"Detected vehicle 1:1 on link 0\n")
    return program


@pytest.fixture
def with_parameters(proxy: Any) -> Any:
    """MAVProxy that has fetched the arm's parameters."""
    proxy.type("param fetch")
    proxy.count = int(proxy.reads(r"Received (\d+) parameters")[1])
    return proxy


def test_it_fetches_the_whole_parameter_list(with_parameters: Any) -> None:
    proxy = with_parameters
    assert proxy.count >= 8
    proxy.type("param status")
    proxy.reads(rf"Have {proxy.count}/{proxy.count} params")


def test_it_asks_for_a_file_first_and_loses_no_time_by_it(
    start: Callable[..., Any], tools: Path, arm: str
) -> None:
    """With its module for files, as it is by default, it fetches the parameters as a file where one is."""
    options = (f"--master=tcp:{arm}", "--mav20", "--no-state", "--dialect=robotree")
    modules = "--default-modules=ftp,param,link,cmdlong,wp,log"
    proxy = start(tools / "python", tools / "mavproxy.py", *options, modules)
    proxy.reads(r"Detected vehicle 1:1 on link 0\n")
    began = time.monotonic()
    proxy.reads(r"Received \d+ parameters")
    assert time.monotonic() - began < 6.0, "11 s where nobody answers"
    proxy.type("ftp list /")
    proxy.reads(r"general\.json")
    proxy.type("wp clear")
    proxy.reads(r"MISSION_ACK: TYPE_MISSION: UNSUPPORTED")
    proxy.type("log list")
    proxy.reads(r"No logs")


def test_a_mode_that_it_cannot_have_is_denied_with_a_sentence(proxy: Any) -> None:
    proxy.type("long DO_SET_MODE 1 4 5")
    proxy.reads(r"Got COMMAND_ACK: DO_SET_MODE: DENIED")
    proxy.reads(r"cannot take off, return or land")


def test_it_sets_a_parameter_and_sees_one_refused(with_parameters: Any) -> None:
    proxy = with_parameters
    proxy.type("param set TOOL_SPEED 9")
    proxy.reads(r"Failed to set TOOL_SPEED to 9 \(invalid returned value 0\.2")
    proxy.type("param set TOOL_SPEED 0.1")
    fetched = ""
    while fetched != "0.1000000":  # it sends what was set when it has time, after what was fetched
        proxy.type("param fetch TOOL_SPEED")
        fetched = proxy.reads(r"TOOL_SPEED = (\S+)")[1]


def test_a_named_command_tells_its_progress_and_its_end(proxy: Any) -> None:
    proxy.type("long ROBOTREE_GO_TO 0.45 0.1 0.3 0")
    proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: IN_PROGRESS")
    proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: IN_PROGRESS")
    proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: ACCEPTED")
    proxy.type("long ROBOTREE_GO_TO 9 0 0.3 0")
    proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: DENIED")
    proxy.reads(r"out of reach")


def test_the_gripper_obeys(proxy: Any) -> None:
    proxy.type("long DO_GRIPPER 1 0")
    proxy.reads(r"Got COMMAND_ACK: DO_GRIPPER: ACCEPTED")


def test_a_kill_is_a_protective_stop_that_arming_releases(proxy: Any) -> None:
    proxy.type("long COMPONENT_ARM_DISARM 0 21196")
    proxy.reads(r"Got COMMAND_ACK: COMPONENT_ARM_DISARM: ACCEPTED")
    proxy.reads(r"(?i)safe stop")
    proxy.reads(r"DISARMED")
    proxy.type("long ROBOTREE_GO_TO 0.45 0.1 0.3 0")
    proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: TEMPORARILY_REJECTED")
    proxy.type("long COMPONENT_ARM_DISARM 1")
    proxy.reads(r"(?<!DIS)ARMED\n")


def test_our_own_messages_have_names_fields_and_rates(proxy: Any) -> None:
    proxy.type("watch ROBOTREE_GRIPPER")
    proxy.reads(r"ROBOTREE_GRIPPER \{time_boot_ms : \d+, width : 0\.\d+, ")
    proxy.type("watch")
    proxy.type("messagerate set ROBOTREE_JOINTS 5")
    proxy.reads(r"Got COMMAND_ACK: SET_MESSAGE_INTERVAL: ACCEPTED")
    proxy.type("messagerate get ROBOTREE_JOINTS")
    proxy.reads(r"Msg:ROBOTREE_JOINTS  rate:5\.00Hz")


def keyed(proxy: Any, word: str = "sesame") -> Any:
    """MAVProxy that signs with the key that it makes of a word."""
    proxy.type("module load signing")
    proxy.reads("Loaded module signing")
    proxy.type(f"signing key {word}")
    proxy.reads("Setup signing key")
    return proxy


def obeyed(proxy: Any) -> None:
    """Wait until the arm answers it."""
    proxy.type("param fetch")
    proxy.reads(r"Received \d+ parameters")


class TestSigning:
    """The arm has a key; MAVProxy makes its own from a passphrase."""

    @pytest.fixture
    def arm(self, simulate: Callable[..., str], tmp_path: Path) -> str:
        keys = tmp_path / "keys"
        keys.touch(mode=0o600)
        keys.write_text(f"arm-1 {sha256(b'sesame').hexdigest()}\n")
        return simulate("--key", keys, name="arm-1")

    def test_with_the_right_key_it_is_obeyed(self, mavproxy: Callable[..., Any], arm: str) -> None:
        proxy = keyed(mavproxy(arm))
        obeyed(proxy)

    def test_it_changes_the_key_and_is_obeyed_with_the_new_one_while_another_is_heard_no_more(
        self, mavproxy: Callable[..., Any], arm: str, tmp_path: Path
    ) -> None:
        changer, other = (keyed(mavproxy(arm)) for _ in range(2))
        obeyed(changer)
        obeyed(other)
        changer.type("signing setup poppy")
        changer.reads("Sent secret_key")
        other.reads(r"The signing key was changed by system 255\.")
        changer.reads(r"The signing key was changed by system 255\.")
        assert (tmp_path / "keys").read_text() == f"arm-1 {sha256(b'poppy').hexdigest()}\n"
        changer.type("long DO_GRIPPER 1 0")
        changer.reads(r"Got COMMAND_ACK: DO_GRIPPER: ACCEPTED")
        other.type("long DO_GRIPPER 1 0")
        with pytest.raises(AssertionError, match="never printed"):
            other.reads("COMMAND_ACK", within=5.0)
        other.type("signing key poppy")
        other.reads("Setup signing key")
        other.type("long DO_GRIPPER 1 0")
        other.reads(r"Got COMMAND_ACK: DO_GRIPPER: ACCEPTED")

    def test_it_cannot_switch_signing_off(
        self, mavproxy: Callable[..., Any], arm: str, tmp_path: Path
    ) -> None:
        before = (tmp_path / "keys").read_text()
        proxy = keyed(mavproxy(arm))
        obeyed(proxy)
        proxy.type("signing remove")
        proxy.reads(r"Signing is not switched off over the wire; edit the key file\.")
        proxy.type("long DO_GRIPPER 1 0")
        with pytest.raises(AssertionError, match="never printed"):
            proxy.reads("COMMAND_ACK", within=5.0)
        assert (tmp_path / "keys").read_text() == before

    def test_with_a_wrong_key_it_is_not_heard_until_it_has_the_right_one(
        self, mavproxy: Callable[..., Any], arm: str
    ) -> None:
        """Its signing module asks for a message of ardupilotmega; in a dialect without it, it went deaf."""
        proxy = keyed(mavproxy(arm), "wheat")
        proxy.type("param fetch")
        proxy.type("long DO_GRIPPER 1 0")
        with pytest.raises(AssertionError, match="never printed"):
            proxy.reads(r"Received \d+ parameters|COMMAND_ACK", within=5.0)
        proxy.type("signing key sesame")
        proxy.reads("Setup signing key")
        obeyed(proxy)
        assert "AttributeError" not in proxy.printed


class TestDerivedKey:
    """A cell has one key; each controller has its own of it, and MAVProxy gets its passphrase."""

    @pytest.fixture
    def cell(self, tmp_path: Path) -> Path:
        subprocess.run([*ROBOTREE, "wire", "key", str(tmp_path / "cell.key")], check=True)
        return tmp_path / "cell.key"

    def passphrase(self, cell: Path, arm: str) -> str:
        """What `robotree wire key FILE --of` says of an arm."""
        words = [*ROBOTREE, "wire", "key", str(cell), "--of", f"tcp:{arm}"]
        told = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        return str(re.search(r"(?m)^passphrase +(\S+)", told)[1])  # type: ignore[index]

    def test_the_passphrase_of_one_arm_commands_it_and_no_other(
        self, mavproxy: Callable[..., Any], simulate: Callable[..., str], cell: Path
    ) -> None:
        ours, other = simulate("--key", cell), simulate("--key", cell)
        proxy = keyed(mavproxy(ours), self.passphrase(cell, ours))
        obeyed(proxy)
        proxy.type("long ROBOTREE_GO_TO 0.45 0.1 0.3 0")
        proxy.reads(r"Got COMMAND_ACK: ROBOTREE_GO_TO: ACCEPTED")
        stranger = keyed(mavproxy(other), self.passphrase(cell, ours))
        stranger.type("param fetch")
        stranger.type("long DO_GRIPPER 1 0")
        with pytest.raises(AssertionError, match="never printed"):
            stranger.reads(r"Received \d+ parameters|COMMAND_ACK", within=5.0)
        stranger.type(f"signing key {self.passphrase(cell, other)}")
        stranger.reads("Setup signing key")
        obeyed(stranger)

    def test_the_example_controllers_hear_it_too(
        self, mavproxy: Callable[..., Any], start: Callable[..., Any], cell: Path, tmp_path: Path
    ) -> None:
        """They know no parameters; what they obey of a station is a set mode of ours."""
        controller = generated(tmp_path)
        memory = ("--memory", tmp_path / "memory", "--reset-epoch")
        program = start(*controller, "0", *memory, "--key", cell)
        url = program.reads(r"ready tcp:(\S+)\n")[1]
        proxy = mavproxy(url)
        proxy.reads("Detected vehicle 1:1")
        proxy.type("param fetch")
        program.reads("refused: a frame of 255 is not signed")
        keyed(proxy, self.passphrase(cell, url))
        proxy.type("watch ROBOTREE_MODE")
        proxy.reads(r"ROBOTREE_MODE \{")
        time.sleep(7.0)  # longer than a client without the key keeps its place
        proxy.reads(r"ROBOTREE_MODE \{")
        assert "link 1 down" not in proxy.printed
