"""The doctor names why a site is not seen, and what helps."""

from __future__ import annotations

import msgspec
import pytest

from robotree.tui.diagnosis.finding import Finding
from robotree.tui.diagnosis.sites import DAY, judged
from robotree.vr.base.requests import GatewayDescribed, SiteSeen
from robotree.vr.sites.site import RememberedSite, Site, seen

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
