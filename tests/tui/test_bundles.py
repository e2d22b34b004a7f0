"""The verbs about bundles, and the chapter that explains them: what stands there is typed here."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from robotree.tui.cli import main
from robotree.vr.base.errors import RevokedSigner
from robotree.vr.base.permissions import Permissions
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.build import manifest_of
from robotree.vr.bundle.requirements import declared

CHAPTER = Path(__file__).parents[2] / "docs" / "bundles.md"
TEAM = '''"""A team."""

from robotree.vr import Child, VirtualRobot, command


class Team(VirtualRobot):
    """A team."""

    arm = Child("Arm")

    @command
    def wave(self) -> None:
        """Wave."""
        self.arm.move(x=1.0)
'''


def blocks(language: str) -> list[str]:
    parts = re.split(r"^```", CHAPTER.read_text(), flags=re.MULTILINE)[1::2]
    return [body for head, _, body in (part.partition("\n") for part in parts) if head == language]


class Person:
    """Somebody with a home and a key, at a terminal."""

    def __init__(self, home: Path) -> None:
        self.home = home
        (home / ".ssh").mkdir(parents=True)
        key = Ed25519PrivateKey.generate()
        private = key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption())
        (home / ".ssh" / "id_ed25519").write_bytes(private)
        from robotree.vr.sites.ssh import public_text

        self.public = public_text(key.public_key().public_bytes_raw())
        (home / ".ssh" / "id_ed25519.pub").write_text(f"{self.public} somebody\n")

    def sits_down(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HOME", str(self.home))
        monkeypatch.setenv("XDG_CONFIG_HOME", str(self.home / ".config"))
        monkeypatch.setenv("XDG_STATE_HOME", str(self.home / ".state"))


@pytest.fixture
def anna(tmp_path: Path) -> Person:
    return Person(tmp_path / "anna")


@pytest.fixture
def bob(tmp_path: Path) -> Person:
    return Person(tmp_path / "bob")


def test_the_chapter_is_played(
    tmp_path: Path,
    anna: Person,
    bob: Person,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("team.py").write_text(TEAM)

    def play(line: str) -> tuple[int, str]:
        code = main(shlex.split(line)[1:])
        said = capsys.readouterr()
        return code, said.out + said.err

    made, looked, trusted, lists, ended = (block.splitlines() for block in blocks("")[:5])
    anna.sits_down(monkeypatch)
    build, verify = made
    assert play(build)[0] == 0
    assert "signed with a key of yours" in play(verify)[1]

    bob.sits_down(monkeypatch)
    show, create = looked
    trust, again, created = trusted
    (listed, replace), (revoke,) = lists, ended
    assert again == verify
    assert create == created == "robotree create team.bundle as team"  # tests/vr/bundle plays it on a host
    code, said = play(show)
    assert code == 0
    assert f"signer    {anna.public}" in said
    assert "calls     Arm.move" in said
    code, said = play(verify)
    assert code == 1
    assert f"is signed by {anna.public}, whom this machine does not trust" in said
    assert f"`robotree bundle trust {anna.public} --name WHO`" in said
    assert play(trust)[0] == 0
    assert play(verify) == (
        0,
        "team.bundle is as it was signed, and is signed by anna; it runs with isolation process\n",
    )
    assert f'anna namespaces="robotree-bundle" {anna.public} may=Arm.*,Rover.move' in play(listed)[1]
    code, said = play(replace.removesuffix(" --replace"))
    assert code != 0
    assert "that key has a line already" in said
    assert play(listed)[1].count("Rover.move") == 1
    code, said = play(replace)
    assert code == 0
    assert "instead of: anna" in said
    assert "Rover.move" not in play(listed)[1]
    assert play(replace.replace("Arm.*", "Rover.*"))[0] == 0
    code, said = play(verify)
    assert code == 1
    hint = said.split("`")[-2]  # it is typed as it stands there
    assert hint.startswith("robotree bundle trust ssh-ed25519 ")
    assert play(hint)[0] == 0
    assert play(verify)[0] == 0
    assert play(revoke)[0] == 0
    code, said = play(trust)
    assert code != 0
    assert "that key was revoked" in said
    code, said = play(f"{verify} --json")
    assert code == 1
    assert json.loads(said.splitlines()[0])["error"] == RevokedSigner.__name__


def test_the_pages_of_the_chapter_say_what_it_says() -> None:
    head, thaw = blocks("python")
    said = declared(head, "page.py")
    assert said.permissions == Permissions(("Arm.move", "Arm.grip"), ("Arm.z",), ("cell.wrist",))
    assert (said.python, said.requires) == (">=3.11", ("numpy>=2",))
    imports = "from robotree.vr import VirtualRobot, state\n\n"
    page = Bundle(imports + thaw, "team.py")
    assert page.create("team").thaw({"picked": 2}, "") == {"done": ["?", "?"]}
    assert manifest_of(page, "key").permissions == Permissions()


def test_a_mistake_in_a_line_is_named(
    tmp_path: Path, anna: Person, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    anna.sits_down(monkeypatch)
    Path("team.py").write_text(TEAM)
    assert main(["bundle", "build", "team.py"]) == 0
    for line, reason in (
        ("bundle build team.py --may Arm", "'Arm' is no permission"),
        ("bundle build none.py", "cannot read none.py"),
        ("bundle build team.py --key none", "there is no key to sign with: none:"),
        ("bundle verify team.py", "is a page, not a bundle"),
        ("bundle trust team.py --name anna", "write `ssh-ed25519 AAAA…`"),
        (f"bundle trust {anna.public}", "say whose key it is"),
        (f"bundle trust {anna.public} --name anna --isolation much", "there is no isolation 'much'"),
        ("bundle verify team.bundle --requirements some", "it is one of refuse, allowlist, locked"),
    ):
        assert main(shlex.split(line)) != 0
        assert reason in capsys.readouterr().err
