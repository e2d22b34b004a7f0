"""Two sites and a hub on one machine: what people see and command across them, and what a stop says."""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.tui.exit_codes import DONE, NOBODY, REFUSED
from tests.command_line import ROBOTREE
from tests.listening import listening
from tests.plant import EXAMPLES, Machine, Plant
from tests.ports import free_port
from tests.terminal import ENTER, Sitting
from tests.waiting import wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.story]


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        found = Plant(Path(folder))
        try:
            yield found
        finally:
            for machine in found.machines:
                for called in list(machine.running):
                    machine.end(called, signal.SIGKILL)


def test_a_realm_is_made_and_joined_with_a_token_that_counts_once(plant: Plant) -> None:
    address = plant.start_hub()
    lab, hall = plant.lab, plant.hall
    made = lab.say("realm", "create", "plant", "--hub", address, "--site", "lab")
    folder = Path(made["folder"])
    assert folder.stat().st_mode & 0o777 == 0o700
    assert all(file.stat().st_mode & 0o077 == 0 for file in folder.iterdir())
    again = lab.say("realm", "create", "plant", "--hub", address, "--site", "lab", code=REFUSED)
    assert again["error"] == "KeysExist"
    assert hall.say("gateway", code=REFUSED)["error"] == "NoKeys"
    lab.start("gateway", "gateway")
    token = lab.say("realm", "invite", "hall")["token"]
    joined = hall.say("realm", "join", token)
    assert (joined["name"], joined["kind"]) == ("hall", "site")
    assert plant.desk.say("realm", "join", token, code=REFUSED)["error"] == "InvitationRefused"
    assert hall.say("realm", "invite", "desk", code=REFUSED)["error"] == "NoAuthority"
    assert [row["name"] for row in lab.say("realm", "members")] == ["lab", "hall"]
    exported = json.dumps(lab.say("realm", "export"))
    for secret in ("authority.key", "member.key"):
        assert (folder / secret).read_bytes().hex() not in exported


def test_each_sees_the_robots_of_the_other(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    hall.start("gateway", "gateway")
    lab.start("lookup", "lookup", "lookup-lab")
    hall.start("lookup", "lookup", "lookup-hall")
    port = free_port()
    hall.start("sim", "sim", "rover", "--listen", f"tcp:127.0.0.1:{port}", "--open")
    hall.start("view", "view", "cell", "--connect", f"tcp:127.0.0.1:{port}", "--open")
    hall.start("proxy", "proxy", "rover", "r1", "--connect", f"tcp:127.0.0.1:{port}", "--open")
    lab.start("host", "host", "host-lab")
    lab.until_listed("r1")
    assert [row["name"] for row in hall.say("ls", "--hosts")] == ["host-lab"]


def test_nothing_listens_off_loopback_without_keys(plant: Plant) -> None:
    """A hub may, for who dials it proves a key; and so the listing shows that it sees what it must."""
    port = free_port()
    plant.desk.start("hub", "hub", "--listen", f"tls:0.0.0.0:{port}")
    try:
        processes = [one.pid for machine in plant.machines for one in machine.running.values()]
        found = listening(processes)
        assert {one.port for one in found} >= {plant.port, port}
        assert [(one.protocol, one.port) for one in found if not one.address.is_loopback] == [("tcp", port)]
    finally:
        plant.desk.end("hub")


def test_a_command_goes_there_and_the_log_there_names_who_asked(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    lab.say("call", "r1.move", "x=0.05", "y=0")
    lines = json.dumps(hall.say("log", "r1"))
    assert "@lab" in lines, lines


def test_operators_of_two_sites_see_and_hear_each_other(
    plant: Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, people = plant.lab, list[Sitting]()
    for machine in (lab, plant.hall):
        with monkeypatch.context() as there:
            for variable, value in machine.environment.items():
                there.setenv(variable, value)
            people.append(Sitting("plant"))
    here, afar = people
    try:
        for person in people:
            person.shows(b"r1")
        wait_until(lambda: len(lab.say("who")["operators"]) == 2, "both are seen")
        found = lab.say("who")
        assert "hall" in [one["person"].rpartition("@")[2] for one in found["operators"]]
        assert found["silent_sites"] == []
        afar.types(f":say the cup is hot{ENTER}", sees="")
        here.shows(b"the cup is hot")
        wait_until(
            lambda: lab.say("say", "tea is ready")["heard"] == 2, "all have heard it before a shell left"
        )
        for person in people:
            person.shows(b"tea is ready")
        plant.hub.running["hub"].send_signal(signal.SIGSTOP)
        try:
            wait_until(lambda: lab.say("who")["silent_sites"] == ["hall"], "a site that is silent is named")
        finally:
            plant.hub.running["hub"].send_signal(signal.SIGCONT)
        wait_until(lambda: len(lab.say("who")["operators"]) == 2, "it is heard again")
    finally:
        for person in people:
            person.leave()
    wait_until(lambda: not lab.say("who")["operators"], "they are gone")
    assert lab.say("say", "is anybody there")["heard"] == 0


def test_a_robot_is_shown_with_its_site_and_age_and_the_doctor_knows_the_way(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    (row,) = [row for row in lab.say("ls") if row["address"]["name"] == "r1"]
    assert row["site"] == "hall"
    assert 0 <= row["age"] < 60
    assert lab.say("show", "hall:r1")["site"] == "hall"
    lab.say("call", "hall:r1.move", "x=0.05", "y=0")
    assert hall.say("show", "hall:r1")["address"]["name"] == "r1", "where it is at home, too"
    assert lab.say("show", "cellar:r1", code=REFUSED)["error"] == "NoSuchSite"
    checks = lab.say("doctor", "hall:r1")["checks"]
    assert any(one["check"] == "sites" and "site hall is linked" in one["result"] for one in checks), checks
    assert any("is at site hall and answers in" in one["result"] for one in checks), checks


def test_a_virtual_robot_here_commands_a_robot_there(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    lab.say("create", str(EXAMPLES / "move_square.py"), "as", "square")
    lab.say("enslave", "square.rover", "r1")
    lab.say("call", "square.move_square", "length=0.05m")
    tree = json.dumps(hall.say("tree"))
    assert "square" in tree
    assert "r1" in tree


def test_what_a_robot_of_another_site_did_and_why_is_told_here(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    kept = lab.say("history", "r1")
    assert {one["source"] for one in kept} == {"robot hall:r1"}
    assert [one for one in kept if one["kind"] == "accepted" and one.get("caller") == "square"]
    assert [{**one, "source": "robot hall:r1"} for one in hall.say("history", "r1")] == kept
    (examined,) = lab.say("history", "hall:r1", "--verify")
    assert examined["count"] >= len(kept)
    why = lab.say("why", "hall:r1")
    assert [link["call"]["robot"] for link in why["links"]] == ["r1", "square"]
    assert [link["source"] for link in why["links"]] == ["robot hall:r1", "host host-lab"]
    assert why["person"].endswith("@script")
    assert lab.say("why", why["links"][0]["call"]["key"]) == why
    texts = [line["text"] for line in lab.say("log", "hall:r1")]
    assert len([text for text in texts if text.startswith("r1 (robot, site hall, process")]) == 1, texts


def test_a_picture_and_a_watch_come_across(plant: Plant, tmp_path: Path) -> None:
    lab, hall = plant.lab, plant.hall
    lab.until_listed("r1", there=False)  # it is enslaved
    picture = tmp_path / "cell.jpg"
    lab.say("look", "cell", str(picture))
    assert picture.read_bytes()[:2] == b"\xff\xd8"
    watching = subprocess.Popen(
        [*ROBOTREE, "watch", "square", "--json"], stdout=subprocess.PIPE, text=True, env=hall.environment
    )
    try:
        assert watching.stdout
        assert "square" in watching.stdout.readline()
    finally:
        watching.send_signal(signal.SIGINT)
        watching.communicate(timeout=60)


def test_a_stop_reaches_all_sites_and_says_which_robot_is_where(plant: Plant) -> None:
    stopped = plant.lab.say("stop")
    assert {"square", "hall:r1"} <= set(stopped["stopped"])
    assert {"r1", "lab:square"} <= set(plant.hall.say("stop")["stopped"])
    resumed(plant.lab)


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM])
def test_a_stop_names_a_site_whose_gateway_is_dead(plant: Plant, sign: signal.Signals) -> None:
    lab, hall = plant.lab, plant.hall
    hall.end("gateway", sign)
    said = lab.say("stop", code=NOBODY)
    assert said["error"] == "NotConfirmed"
    assert "site hall" in said["message"]
    assert "not reached" in said["message"]
    assert "kill" not in said["message"]
    hall.start("gateway", "gateway")
    lab.until_listed("square")
    linked(lab, "r1")
    resumed(lab)


def test_a_robot_that_hangs_at_another_site_is_named_with_what_helps_there(plant: Plant) -> None:
    lab, proxy = plant.lab, plant.hall.running["proxy"]
    proxy.send_signal(signal.SIGSTOP)
    try:
        lab.until_listed("r1", there=False)
        said = lab.say("stop", code=NOBODY)
    finally:
        proxy.send_signal(signal.SIGCONT)
    assert "hall:r1 (in process" in said["message"]
    assert f"at site hall: `kill -CONT {proxy.pid}` wakes it" in said["message"]
    linked(lab, "r1")
    resumed(lab)


def resumed(machine: Machine) -> None:
    """Resume as soon as nobody commands a robot any more whose bond the cut has ended: its lease is over."""
    machine.until(lambda realm: realm.resume() is not None, "all are resumed")


def linked(machine: Machine, robot: str) -> None:
    machine.until(lambda realm: realm.describe(robot), f"{robot} answers")


def test_a_stop_names_all_other_sites_where_the_own_gateway_is_dead(plant: Plant) -> None:
    lab = plant.lab
    lab.end("gateway", signal.SIGKILL)
    said = lab.say("stop", code=NOBODY)
    assert "site hall (not reached: no gateway runs on this machine)" in said["message"]
    lab.start("gateway", "gateway")
    linked(lab, "r1")
    resumed(lab)


def test_a_hub_that_dies_is_named_and_one_that_is_back_links_them_again(plant: Plant) -> None:
    lab = plant.lab
    plant.hub.end("hub", signal.SIGKILL)
    said = {"message": ""}

    def told() -> bool:
        said.update(lab.say("stop", code=NOBODY))
        return "hub" in said["message"]

    wait_until(told, "the hub is named")
    assert "site hall" in said["message"]
    plant.start_hub()
    linked(lab, "r1")
    resumed(lab)


def test_a_revoked_site_is_out(plant: Plant) -> None:
    lab, hall = plant.lab, plant.hall
    lab.say("realm", "revoke", "hall")
    revoked = time.monotonic()
    while (
        subprocess.run(
            [*ROBOTREE, "show", "r1"], capture_output=True, check=False, env=lab.environment
        ).returncode
        == DONE
    ):
        assert time.monotonic() < revoked + 60
    assert hall.say("realm", "members", code=REFUSED)["error"] == "NotAMember"
    assert lab.say("stop")["stopped"] == ["square"], "it belongs to the realm no longer"
