"""The doctor names the cause and the cure of each fault, before anybody is asked."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from unittest.mock import Mock

import msgspec
import pytest
from packaging.specifiers import SpecifierSet

from robotree.tui.cli import main
from robotree.tui.diagnosis import agents, doctor, finding, machine, meeting
from robotree.tui.diagnosis.finding import Finding
from robotree.tui.diagnosis.sites import DAY, judged
from robotree.tui.wire.security import realm_key
from robotree.vr.base import extras
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec
from robotree.vr.base.errors import RobotAway
from robotree.vr.base.requests import GatewayDescribed, HostDescribed, SiteSeen
from robotree.vr.network.realms import runtime_directory, sealed
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.sites.site import RememberedSite, Site, seen

pytestmark = pytest.mark.usefixtures("place")


def robot(name: str, **more: object) -> RobotDescription:
    return RobotDescription(address=Address("robot", name, "1"), kinds=("Arm", "Robot"), **more)  # type: ignore[arg-type] # any field


def told(found: object) -> str:
    return " ".join(f"{one.result} {one.remedy}" for one in found)  # type: ignore[attr-defined] # findings


@pytest.mark.parametrize(
    ("have", "wanted", "fit"),
    [
        ("1.10.2", ">=1.10.2,<1.11", True),
        ("1.11.0", ">=1.10.2,<1.11", False),
        ("4.0", ">=4.0,<5", True),
        ("4", "==4.0", True),
        ("0.4.9", ">=0.5", False),
        ("2.4.6+local7", ">=2.4", True),
        ("7", "", True),
        ("8.9", "~=8.2", True),
        ("9.0", "~=8.2", False),
        ("8.2.8rc1", ">=8.2.8", False),
        ("1.0.6", "==1.0.*", True),
        ("", "", False),
    ],
)
def test_a_version_is_within_bounds_or_not(have: str, wanted: str, *, fit: bool) -> None:
    assert machine.Needed("one", SpecifierSet(wanted), have).fits is fit


def needed(*given: tuple[str, str, str]) -> list[machine.Needed]:
    return [machine.Needed(name, SpecifierSet(wanted), have) for name, wanted, have in given]


def test_a_missing_package_is_named_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    core = needed(("msgspec", ">=1", ""), ("pint", ">=2", "1.0"), ("psutil", ">=4", "4.1"))
    monkeypatch.setattr(machine, "packages", lambda extra="": [] if extra else core)
    found = list(machine.installed())
    assert [one.grade for one in found if one.check == "packages"] == ["bad", "bad", "good"]
    assert "msgspec is not installed" in found[0].result
    assert "pint 1.0 is installed, >=2 is needed" in found[1].result
    assert found[0].remedy.endswith(" install robotree")


def test_an_extra_may_be_absent_but_not_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"sim": needed(("mujoco", ">=4", "")), "scripts": needed(("clipspy", "==1.0.6", "1.0.5"))}
    monkeypatch.setattr(machine, "packages", lambda extra="": given.get(extra, []))
    found = {one.result: one for one in machine.installed() if one.check == "extras"}
    absent, broken = (
        next(one for told, one in found.items() if word in told) for word in ("mujoco", "clips")
    )
    assert (absent.grade, broken.grade) == ("doubt", "bad")
    assert "`sim` cannot be used without it" in absent.result
    assert absent.remedy.endswith("'robotree[sim]'")


def test_a_library_that_no_wheel_brings_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "LIBRARIES", {"sim": {"libnobody.so.9": "libnobody9"}})
    (found,) = (one for one in machine.installed() if one.grade == "bad")
    assert "the system's library libnobody.so.9" in found.result
    assert found.remedy.endswith("apt-get install libnobody9")


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_the_links_of_a_process_are_told_over_both_kinds_of_addresses(host: str) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as server, socket.socket(family) as free:
        port = server.getsockname()[1]
        shown = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        free.bind((host, 0))  # nobody listens there
        entry = meeting.Entry(os.getpid(), "lives", 0.0, (), f"proxy arm a --connect tcp:{shown}")
        assert f"not connected to tcp:{shown}" in told(meeting.links([entry]))
        with socket.create_connection((host, port)):
            said = told(meeting.links([entry]))
            assert "not connected" not in said
            assert f"listens at {shown}" in said
            assert f"to {shown}" in said


def test_a_clock_that_is_far_behind_is_bad() -> None:
    assert machine.clock(0.0).grade == "bad"
    assert machine.clock(1_500_000_000.0).grade == "bad"
    assert machine.clock().grade == "good"


def test_a_folder_that_others_can_enter_is_named_with_its_mode() -> None:
    assert "nobody is in realm 'x'" in told(meeting.folder("x"))
    folder = runtime_directory() / "x"
    folder.mkdir(parents=True, mode=0o700)
    runtime_directory().chmod(0o700)
    folder.chmod(0o755)
    assert f"{folder} has mode 0755, not 0700 chmod 700 {folder}" in told(meeting.folder("x"))
    folder.chmod(0o700)
    assert finding.sound(meeting.folder("x"))
    folder.rmdir()
    folder.write_text("")
    assert "is no folder" in told(meeting.folder("x"))


def test_the_entry_of_a_dead_process_is_told_from_one_that_hangs() -> None:
    with socket.socket(socket.AF_UNIX) as listening:
        place = Rendezvous("x")
        dead, hung = (place.directory / f"{pid}-0123abcd" for pid in (4_000_000, os.getpid()))
        listening.bind(f"{hung}.sock")
        listening.listen()
        with socket.socket(socket.AF_UNIX) as gone:
            gone.bind(f"{dead}.sock")
        Path(f"{hung}.held").write_bytes(sealed(b"robot/arm-1/1\n"))
        Path(f"{hung}.beat").write_bytes(bytes(8))  # long ago
        found = meeting.entries("x")
        assert {(one.pid, one.condition) for one in found} == {(4_000_000, "dead"), (os.getpid(), "hangs")}
        said = told(meeting.processes(found))
        assert f"process {os.getpid()} (robot arm-1) has given no sign of life" in said
        assert f"kill -KILL {os.getpid()}" in said
        assert "process 4000000 (it has announced nothing) has died" in said
        assert "arm-1 is in process" in told(agents.missed("arm-1", "x", {}, set(), found))
        elsewhere = meeting.whereabouts("arm-1", "y")
        assert elsewhere
        assert elsewhere.remedy == "add --realm x"


@pytest.mark.parametrize("damage", [b"", b"\xff\0", None], ids=["cut", "garbage", "gone"])
def test_a_process_whose_list_is_damaged_is_not_said_to_have_announced_nothing(damage: bytes | None) -> None:
    with socket.socket(socket.AF_UNIX) as listening:
        entry = Rendezvous("x").directory / f"{os.getpid()}-0123abcd"
        listening.bind(f"{entry}.sock")
        listening.listen()
        if damage is not None:
            Path(f"{entry}.held").write_bytes(damage)
        said = told(meeting.processes(meeting.entries("x")))
        assert "is damaged or gone: nobody who comes now knows its robots" in said
        assert f"end it: kill -KILL {os.getpid()}" in said
        assert "announced nothing" not in said


def test_why_a_robot_is_not_listed_is_said() -> None:
    bond = BondSpec(parent=Address("robot", "mover", "1"), slot="arm", epoch=1, remaining=5.0)
    robots = {"arm-1": robot("arm-1", bond=bond), "arm-2": robot("arm-2"), "arm-3": robot("arm-3")}
    said = {name: told(agents.missed(name, "x", robots, {"arm-2"}, [])) for name in (*robots, "arm-4")}
    assert "enslaved by mover.arm" in said["arm-1"]
    assert "robotree release mover.arm" in said["arm-1"]
    assert "runs, answers and is listed" in said["arm-2"]
    assert "no lookup service lists it" in said["arm-3"]
    assert "did you mean arm-" in said["arm-4"]


def test_the_host_that_keeps_a_robot_is_named_with_the_command_that_brings_it_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    away = RobotAway(name="tele", host="h1", since="5 s", goes_on="")
    monkeypatch.setattr(agents.away, "explained", Mock(return_value=away))
    (finding,) = agents.missed("tele", "x", {}, set(), [])
    assert finding.result == "tele is kept by host h1, which wrote last 5 s ago"
    assert finding.remedy == "robotree host h1"


def test_how_a_robot_is_comes_with_what_to_do() -> None:
    slot = SlotSpec(name="arm", kind="Arm")
    assert "lost the controller" in told(agents.condition(robot("a", online=False)))
    assert "robotree resume a" in told(agents.condition(robot("a", stopped=True, stop_reason="the operator")))
    assert "restart host h" in told(agents.condition(robot("a", abandoned=("turn",), host="h")))
    assert "robotree enslave a.arm NAME, of a robot of kind Arm" in told(
        agents.condition(robot("a", slots=(slot,)))
    )
    assert [one.grade for one in agents.condition(robot("a"))] == ["good"]


def test_a_key_file_that_others_can_read_is_bad(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("ROBOTREE_KEY", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert doctor.keys("nobodys").grade == "doubt"
    realm_key("nobodys")
    assert doctor.keys("nobodys").grade == "good"
    monkeypatch.setenv("ROBOTREE_KEY", str(tmp_path / "none.key"))
    assert doctor.keys("nobodys").grade == "bad"
    key = tmp_path / "a.key"
    assert main(["wire", "key", str(key)]) == 0
    monkeypatch.setenv("ROBOTREE_KEY", str(key))
    assert doctor.keys("nobodys").grade == "good"
    key.chmod(0o644)
    assert doctor.keys("nobodys").grade == "bad"


def test_the_verdict_is_the_exit_code_and_plain_data(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "arm-1", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["ok"] is False
    assert {"python", "packages", "clock", "terminal", "state", "keys", "folder"} <= {
        one["check"] for one in data["checks"]
    }
    assert finding.sound([Finding("a", "good", ""), Finding("b", "doubt", "")])
    assert main(["doctor"]) == 1
    assert "→ start something, for example `robotree demo`" in capsys.readouterr().out
    assert list(runtime_directory().parent.iterdir()) == [], "looking makes nothing"


def test_info_tells_versions_paths_terminal_and_realm(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--json", "--realm", "x"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["realm"]["name"] == "x"
    assert data["paths"]["realm"] == str(runtime_directory() / "x")
    assert {"type", "size", "colours", "encoding"} <= data["terminal"].keys()
    assert data["versions"]["packages"]["textual"]
    assert main(["info"]) == 0
    said = capsys.readouterr().out
    assert all(group in said for group in ("versions", "paths", "terminal", "environment"))


def test_the_doctor_says_who_stands_by_and_where_nobody_does_any_more() -> None:
    def host(name: str, stands_by: str = "", instead_of: str = "") -> HostDescribed:
        return HostDescribed(address=Address("host", name, "1"), stands_by=stands_by, instead_of=instead_of)

    (pair,) = agents.standing_by([host("h1"), host("h2", stands_by="h1")])
    assert (pair.grade, pair.result) == ("good", "h2 stands by for h1")
    (alone,) = agents.standing_by([host("h2", instead_of="h1")])
    assert alone.grade == "doubt"
    assert (alone.result, alone.remedy) == (
        "h2 has the robots of h1, and no host stands by for it",
        "robotree host h1: it stands by then",
    )
    whole = agents.standing_by([host("h1", stands_by="h2"), host("h2", instead_of="h1")])
    assert [one.grade for one in whole] == ["good", "good"]


# -- the doctor names why a site is not seen, and what helps ---------------------------------------

NOW = 1_800_000_000.0
HALL = SiteSeen(
    name="hall", state="linked", heard=0.2, way=0.15, agents=3, version="1.0", ends=NOW + 60 * DAY
)


def found(site: SiteSeen = HALL, **fields: object) -> list[Finding]:
    described = GatewayDescribed(site="lab", realm="plant", hub="tls:hub:7447", version="1.0", sites=(site,))
    return list(judged(msgspec.structs.replace(described, **fields), NOW))


def changed(**fields: object) -> SiteSeen:
    return msgspec.structs.replace(HALL, **fields)


def test_a_site_that_is_linked_is_good_with_the_delay_that_its_bonds_bear() -> None:
    assert [one.grade for one in found()] == ["good", "good"]
    assert "150 ms there and back, of which a bond bears 3333" in found()[1].result


@pytest.mark.parametrize(
    ("site", "fields", "grade", "says"),
    [
        (HALL, {"trouble": "the hub tls:hub:7447 is not reached: no answer"}, "bad", "is not reached"),
        (HALL, {"out": "this machine's certificate was revoked"}, "bad", "was revoked"),
        (changed(state="silent", reason="its line has fallen silent"), {}, "bad", "fallen silent"),
        (changed(state="away", heard=-1.0, reason="nothing comes"), {}, "bad", "has not been heard since"),
        (changed(version="0.9"), {}, "doubt", "runs robotree 0.9, and here runs 1.0"),
        (changed(clock=400.0), {}, "bad", "400 s ahead of the one here"),
        (changed(clock=-20.0), {}, "doubt", "20 s behind the one here"),
        (changed(ends=NOW - 1), {}, "bad", "certificate of site hall has ended"),
        (changed(ends=NOW + 3 * DAY), {}, "doubt", "ends in 3 days"),
        (changed(way=2.8), {}, "doubt", "bonds across it end"),
        (
            changed(hung=(("r1", "process 47", "`kill -CONT 47`"),)),
            {},
            "bad",
            "hall:r1 hangs there, in process 47",
        ),
        (HALL, {"refused": {"somebody is no member": 7}}, "doubt", "7 times: somebody is no member"),
        (HALL, {"sites": ()}, "doubt", "no other site has joined"),
    ],
)
def test_what_is_wrong_is_said_with_a_remedy(
    site: SiteSeen, fields: dict[str, object], grade: str, says: str
) -> None:
    (one,) = [one for one in found(site, **fields) if one.grade != "good"]
    assert (one.grade, says in one.result) == (grade, True), one
    assert one.remedy or site.state != "linked"


def test_what_was_not_answered_has_a_reason() -> None:
    site = Site("hall")
    nothing = seen(RememberedSite("hall"), None, 9.0, ("", ""))
    assert (nothing.state, nothing.heard) == ("away", -1.0)
    assert "nothing comes from there" in nothing.reason
    assert "`robotree gateway` runs at site hall" in nothing.remedy
    site.refused = "it shows that it is site hall, and its certificate ended 3.0 days ago"
    assert seen(RememberedSite("hall"), site, 9.0, ("", "")).reason == site.refused
    assert seen(RememberedSite("hall"), site, 9.0, ("no hub", "look")).reason == "no hub"
