"""The manual page comes from the registry: it names every verb, and `man` reads it without a complaint."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from robotree.tui.cli import main
from robotree.tui.exit_codes import DONE
from robotree.tui.line.actions import ACTIONS, Where


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
