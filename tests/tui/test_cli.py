"""The command line as a stranger meets it: help at once, one sentence for each mistake, exit codes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.tui.cli import main
from robotree.tui.errors import NothingToAsk
from robotree.tui.exit_codes import INTERRUPTED, NOBODY, REFUSED, USAGE
from robotree.tui.line import manual
from robotree.tui.line.actions import ACTIONS
from robotree.vr.network import realms
from tests.command_line import ROBOTREE, robotree

pytestmark = pytest.mark.usefixtures("place")


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at no realm of another worker, which may come or go between two lines."""
    monkeypatch.setattr(realms, "all_realms", set[Path])


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["enslav", "a.b", "c"], USAGE, "did you mean enslave"),
        (["create", "a.py"], USAGE, "'as' is missing; usage: create FILE as NAME [on HOST]"),
        (["ls", "--colour"], USAGE, "unknown option --colour"),
        (["alarms", "ack"], USAGE, "'ack' is more than it takes (did you mean alarm ack?)"),
        (["help", "fly"], USAGE, "no verb 'fly'"),
        (["run", "/nowhere.session"], REFUSED, "cannot read the session /nowhere.session"),
        (["ls", "--realm", "../x"], REFUSED, "cannot be a name"),
        (["supervise"], USAGE, "needs a terminal"),
    ],
)
def test_each_mistake_gets_one_sentence_and_an_exit_code(
    words: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == code
    said = capsys.readouterr()
    assert says in said.err
    assert said.err.startswith("robotree: ")
    assert said.err.count("\n") == 1
    assert said.out == ""


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["fly"], USAGE, "UnknownVerb"),
        (["panel"], USAGE, "NotHere"),
        (["wire"], USAGE, "BadLine"),
        (["ls", "--colour"], USAGE, "BadLine"),
        (["delete", "a/b"], REFUSED, "BadName"),
        (["call", "a.b", "--within", "soon"], USAGE, "ValueRefused"),
        (["run", "/nowhere.session"], REFUSED, "SessionError"),
        (["wire", "decode", "/nowhere.tlog"], REFUSED, "BadRecording"),
        (["supervise"], USAGE, "NeedsTerminal"),
        (["ls"], NOBODY, "NothingToAsk"),
        (["help", "fly"], USAGE, "UnknownVerb"),
    ],
)
def test_every_mistake_is_one_json_value_with_the_same_exit_code(
    words: list[str], code: int, error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == code
    sentence = capsys.readouterr().err.removeprefix("robotree: ").strip()
    assert main([*words, "--json"]) == code
    said = capsys.readouterr()
    assert json.loads(said.out) == {"error": error, "message": sentence}
    assert json.loads(said.err) == json.loads(said.out)


def test_a_verb_with_which_others_begin_shows_itself_and_them(capsys: pytest.CaptureFixture[str]) -> None:
    for verb, other in (("recording FILE", "recording compare"), ("alarms", "alarms watch")):
        assert main(["help", verb.split()[0]]) == 0
        said = capsys.readouterr().out
        assert f"usage: robotree {verb}" in said
        assert f"  {other} " in said
        assert main(["help", verb.split()[0], "--json"]) == 0
        assert [one["verb"] for one in json.loads(capsys.readouterr().out)] == [verb.split()[0], other]


@pytest.mark.parametrize(
    "words", [["--help"], ["help", "call"], ["help", "wire"], ["--version"]], ids=" ".join
)
def test_help_is_one_json_value_too(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)
    assert said.err == ""


def test_all_mistakes_of_a_session_are_plain_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "a.session"
    script.write_text("stop\nenslav a b\ncreate none.py as x\n")
    assert main(["run", str(script)]) == USAGE
    assert [line.split(": ")[1] for line in capsys.readouterr().err.splitlines()] == [
        f"{script}, line {number}" for number in (2, 3)
    ]
    assert main(["run", str(script), "--json"]) == USAGE
    said = json.loads(capsys.readouterr().out)
    assert said["error"] == "BadScript"
    assert [one["line"] for one in said["mistakes"]] == [2, 3]


def test_of_a_file_that_is_no_script_only_the_first_mistakes_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "a.session"
    script.write_text("words\n" * 120)
    for verb in ("run", "test"):
        assert main([verb, str(script)]) == USAGE
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 11
        assert "more mistakes; is it a session script?" in said[-1]


CHANGES = {
    *("create", "enslave", "group", "release", "delete", "role", "call", "cancel", "decide", "resume"),
    *("pause", "step", "continue", "restart"),
    *("wire replay", "wire inject", "set", "reload", "apply"),
    *("migrate", "drain", "place", "service"),
    *("wire conform", "bundle trust", "policy set"),
    *("fault cut", "fault delay", "fault freeze", "fault kill"),
    "foxglove",
    *(f"control {how}" for how in ("get", "ask", "offer", "take", "leave")),
    *("order cancel", "order confirm", "order settle"),
    *("go", "places add", "places remove"),
    *("mcp", "assistant invite", "assistant revoke", "permit allow", "permit deny"),
    *("compose", "alarm above", "alarm below", "alarm ack", "alarm clear", "alarms watch"),
    *("realm create", "realm invite", "realm join", "realm revoke", "realm renew"),
}
"""Verbs of the shell that change robots, or who commands them."""


def test_who_may_only_look_has_no_verb_that_changes_robots(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    everything, looking = (manual.shell(readonly=readonly).shapes.keys() for readonly in (False, True))
    assert everything - looking == CHANGES
    assert "stop" in looking
    assert main(["--readonly", "delete", "mover"]) == USAGE
    assert "no verb 'delete': this is read-only" in capsys.readouterr().err
    monkeypatch.setenv("ROBOTREE_READONLY", "1")
    assert main(["help"]) == 0
    assert "delete NAME" not in capsys.readouterr().out
    assert main(["help", "delete"]) == USAGE
    monkeypatch.setenv("ROBOTREE_READONLY", "0")
    assert main(["help", "delete"]) == 0


def test_what_the_screen_asks_back_about_is_absent_for_who_may_only_look() -> None:
    assert [action.verb for action in ACTIONS if action.danger and not action.alters] == []


def test_a_script_with_a_wrong_line_is_not_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.session").write_text("stop\nenslav a b\n")
    assert main(["run", str(tmp_path / "a.session")]) == USAGE
    assert "a.session, line 2" in capsys.readouterr().err


class Processes:
    """Agents of one realm, each a process, ended by their tethers."""

    def __init__(self) -> None:
        self.running: list[subprocess.Popen[str]] = []

    def start(self, *words: str) -> str:
        """Start an agent and return its address."""
        process = subprocess.Popen(
            [*ROBOTREE, *words, "--tether"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.running.append(process)
        assert process.stdout
        word, _, address = process.stdout.readline().strip().partition(" ")
        assert word == "ready", f"robotree {words} did not come up"
        return address

    def end(self) -> list[int]:
        """Cut all tethers and return the exit codes."""
        for process in self.running:
            assert process.stdin
            process.stdin.close()
        return [process.wait(10) for process in self.running]


@pytest.fixture
def processes() -> Iterator[Processes]:
    found = Processes()
    yield found
    codes = found.end()
    for process in found.running:
        assert process.stdout
        process.stdout.close()
    assert codes == [0] * len(codes)


@pytest.mark.e2e
def test_interrupting_a_verb_is_clean(processes: Processes) -> None:
    processes.start("host", "host-1")
    source = Path(__file__).parents[2] / "examples" / "two_arms.py"
    assert robotree("create", str(source), "as", "pair").returncode == 0
    watching = subprocess.Popen(
        [*ROBOTREE, "watch"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert watching.stdout
    assert watching.stdout.readline().startswith("pair ")
    watching.send_signal(signal.SIGINT)
    _, err = watching.communicate(timeout=60)
    assert watching.returncode == INTERRUPTED
    assert err == "robotree: interrupted\n"


@pytest.mark.e2e
def test_an_agent_ends_politely_on_a_signal() -> None:
    agent = subprocess.Popen(
        [*ROBOTREE, "lookup", "lookup-1"], stdout=subprocess.PIPE, env=os.environ, text=True
    )
    assert agent.stdout
    assert agent.stdout.readline().startswith("ready lookup/lookup-1/")
    agent.send_signal(signal.SIGTERM)
    assert agent.wait(10) == 0
    agent.stdout.close()


def test_the_state_folder_is_ours_alone_also_one_that_an_earlier_version_made(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from robotree.tui.processes.state_files import state_file

    top = place.with_name("state") / "robotree"
    (top / "old").mkdir(parents=True, mode=0o755)
    top.chmod(0o755)
    for realm in ("old", "new"):
        state_file(realm, "supervisor.log")
    assert [folder.stat().st_mode & 0o777 for folder in (top, top / "old", top / "new")] == [0o700] * 3
    told = capsys.readouterr().err.splitlines()
    assert told == [
        f"{folder} was open to other users of this machine; from now on only you can enter it"
        for folder in (top, top / "old")
    ]


def test_only_a_stop_names_the_stop_of_all_realms() -> None:
    elsewhere = {"--realm lab": ["arm-1"]}
    assert (
        str(NothingToAsk("x", elsewhere))
        == "nobody is in realm 'x', but elsewhere there are arm-1 (--realm lab)"
    )
    assert str(NothingToAsk("x", elsewhere, stopping=True)).endswith(
        "`robotree stop --everywhere` stops them all"
    )
