"""The command line as a stranger meets it: help at once, one sentence for each mistake, rules, manual."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.errors import NothingToAsk, sentence
from robotree.tui.exit_codes import DONE, INTERRUPTED, NOBODY, REFUSED, USAGE
from robotree.tui.line import manual
from robotree.tui.line.actions import ACTIONS, Where
from robotree.tui.line.shell import PACE, Console
from robotree.vr.network import realms
from tests.command_line import ROBOTREE

if TYPE_CHECKING:
    pass

pytestmark = pytest.mark.usefixtures("place")


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at no realm of another worker, which may come or go between two lines."""
    monkeypatch.setattr(realms, "all_realms", set[Path])


@pytest.mark.parametrize(
    ("words", "code", "error", "says"),
    [
        ("enslav a.b c", USAGE, "UnknownVerb", "did you mean enslave"),
        ("panel", USAGE, "NotHere", ""),
        ("create a.py", USAGE, "BadLine", "'as' is missing; usage: create FILE as NAME [on HOST]"),
        ("ls --colour", USAGE, "BadLine", "unknown option --colour"),
        ("ls --hosts --lookups", USAGE, "BadLine", "take only one of --hosts and --lookups"),
        ("ls --realm a --realm b", USAGE, "BadLine", "--realm is given twice"),
        ("--realm a ls --realm b", USAGE, "BadLine", "--realm is given twice"),
        ("alarms ack", USAGE, "BadLine", "'ack' is more than it takes (did you mean alarm ack?)"),
        ("wire", USAGE, "BadLine", ""),
        ("help fly", USAGE, "UnknownVerb", "no verb 'fly'"),
        ("run /nowhere.session", REFUSED, "SessionError", "cannot read the session /nowhere.session"),
        ("ls --realm ../x", REFUSED, "BadName", "cannot be a name"),
        ("call a.b --within soon", USAGE, "ValueRefused", ""),
        ("wire decode /nowhere.tlog", REFUSED, "BadRecording", ""),
        ("supervise", USAGE, "NeedsTerminal", "needs a terminal"),
        ("ls", NOBODY, "NothingToAsk", ""),
    ],
)
def test_each_mistake_is_one_sentence_or_one_json_value_with_an_exit_code(
    words: str, code: int, error: str, says: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == code
    said = capsys.readouterr()
    assert said.err.startswith("robotree: ")
    assert says in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert main([*words.split(), "--json"]) == code
    sentence, said = said.err.removeprefix("robotree: ").strip(), capsys.readouterr()
    assert json.loads(said.out) == {"error": error, "message": sentence}
    assert json.loads(said.err) == json.loads(said.out)
    assert list(place.iterdir()) == [], "nothing was begun"


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


@pytest.mark.e2e
def test_interrupting_a_verb_is_clean_and_an_agent_ends_politely_on_a_signal() -> None:
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*ROBOTREE, "host", "host-1"], **pipes) as host:
        assert host.stdout
        assert host.stdout.readline().startswith("ready host/host-1/")
        source = Path(__file__).parents[2] / "examples" / "two_arms.py"
        assert main(["create", str(source), "as", "pair"]) == 0
        with subprocess.Popen([*ROBOTREE, "watch"], **pipes) as watching:
            assert watching.stdout
            assert watching.stdout.readline().startswith("pair ")
            watching.send_signal(signal.SIGINT)
            assert watching.communicate(timeout=60)[1] == "robotree: interrupted\n"
        assert watching.returncode == INTERRUPTED
        host.send_signal(signal.SIGTERM)
        host.communicate(timeout=60)
    assert host.returncode == 0


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


# -- rules of the command line: options in any order, what it refuses, and what it leaves behind ---


@pytest.fixture
def nowhere(place: Path) -> Path:
    """A runtime folder in which no realm was ever made."""
    return place


@pytest.mark.parametrize(
    "words", [["--realm", "nosuch", "ls"], ["--realm=nosuch", "ls"], ["ls", "--realm", "nosuch"]]
)
def test_an_option_for_every_verb_stands_before_the_verb_or_behind_it(
    words: list[str], nowhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == exit_codes.NOBODY
    assert "nobody is in realm 'nosuch'" in capsys.readouterr().err
    assert list(nowhere.iterdir()) == [], "a look at a realm that is not there does not make it"


def test_what_is_for_programs_is_not_offered_to_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["host", "host-1", "--colour"]) == exit_codes.USAGE
    said = capsys.readouterr().err
    assert "known: --json, --realm" in said
    assert "tether" not in said


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (FileNotFoundError(2, "No such file or directory", "a.py"), "a.py: no such file or directory"),
        (PermissionError(13, "Permission denied"), "permission denied"),
        (ValueError("as it is"), "as it is"),
    ],
)
def test_an_error_of_the_system_is_a_sentence_without_a_number(error: Exception, says: str) -> None:
    assert sentence(error) == says


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("h2 --standby-for h2", "h2 cannot stand by for itself"),
        ("h2 --standby-for h1 --after 1s", "1 s is too short to know that a host is away"),
        ("h2 --journal mysql://db/robots", "'mysql://db/robots' is no database"),
        ("h2 --forget --journal postgresql://db/robots", "leave --journal out"),
        ("h2 --forget --standby-for h1", "--standby-for"),
    ],
)
def test_what_a_host_cannot_be_told_is_one_sentence(
    nowhere: Path, capsys: pytest.CaptureFixture[str], words: str, says: str
) -> None:
    assert main(["host", *words.split()]) == exit_codes.USAGE
    assert says in capsys.readouterr().err
    assert not any(nowhere.rglob("*.owner"))


def test_a_session_is_read_from_standard_input(
    nowhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert nowhere.exists()
    monkeypatch.setattr(sys, "stdin", io.StringIO("sleep 1ms\nfly\n"))
    assert main(["run", "-"]) == exit_codes.USAGE
    assert "-, line 2: no verb 'fly'" in capsys.readouterr().err


def test_each_step_of_a_command_is_told_in_a_log_and_the_last_always(
    capsys: pytest.CaptureFixture[str],
) -> None:
    people, programs = (Console(as_json=as_json, clock=lambda: 100.0) for as_json in (False, True))
    for step in range(1, 7):
        people.progress(step / 6, f"{step} of 6")
    assert capsys.readouterr().err.splitlines() == [f"… {step / 6:.0%} {step} of 6" for step in range(1, 7)]
    for step in range(1, 7):
        programs.progress(step / 6, "")
    assert len(capsys.readouterr().err.splitlines()) == 6
    programs.progress(float("nan"), "closing")
    assert capsys.readouterr().err == '{"progress": null, "text": "closing"}\n'


def test_a_motion_that_tells_its_share_often_fills_no_log(capsys: pytest.CaptureFixture[str]) -> None:
    now = 100.0
    console = Console(as_json=False, clock=lambda: now)
    for hundredth in range(100):
        now += PACE / 100
        console.progress(hundredth / 100, "closing")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    console.settle()
    assert capsys.readouterr().err.splitlines() == ["… 99% closing"]
    console.settle()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", ["--help", "wire dissector"])
def test_a_reader_who_has_left_ends_a_verb_in_silence(words: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as out:
        command = [*ROBOTREE, *words.split()]
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (exit_codes.DONE, "")


# -- the manual page comes from the registry: it names every verb, and `man` reads it without a complaint


@pytest.fixture
def page(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["man"]) == DONE
    return capsys.readouterr().out


def test_the_manual_page_names_every_verb_of_the_shell(page: str) -> None:
    assert page.startswith(".TH ROBOTREE 1")
    heads = [
        line.removeprefix(".B ").replace("\\-", "-") for line in page.splitlines() if line.startswith(".B ")
    ]
    verbs = {action.verb for action in ACTIONS if Where.SHELL in action.where}
    assert not [verb for verb in verbs if not any(f"{head} ".startswith(f"{verb} ") for head in heads)]


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_the_manual_page_is_read_without_a_complaint(page: str) -> None:
    command = ["groff", "-man", "-Tutf8", "-K", "utf8", "-ww", "-z"]
    done = subprocess.run(command, input=page, capture_output=True, text=True, check=True)
    assert not done.stderr
