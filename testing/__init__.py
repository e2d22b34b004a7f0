"""testing: tests of an author's page, in virtual time, with the robots below it faked or simulated.

    def test_it_lifts_what_it_grips() -> None:
        arm = Fake(Arm, get_info={"z": 0.3})
        team = rehearse(PickAndPlace, arm=arm)
        team.call("pick_and_place", x="30 cm")
        assert team.commanded == [("arm", "grip", {"action": "close"}), ...]

`rehearse` runs the page in a small World (`robotree.vr.world`): the page, each robot below it and the
operator are simulated processes with the real agents, leases, checks and stops between them. A `Fake` is a
robot made from the description of a kind; `cell` is the simulated robot with its real proxy and firmware.
Nothing here takes real time, and the same seed gives the same order of events.

    trial       a page carried out once, for a program that asks
    parts       what can be in a slot, and what goes wrong with it
    fake        fakes of a kind (a class, a description or a file), their results and their faults
    journal     what was commanded, and how it differs from what a test expects
    home        the process of a page, which keeps its robot and comes back after a crash; the space
    team        the World of one rehearsal, and what a test does to it
    seeds       the same page under many seeds, with faults
    simulated   simulated robots, and the cable between controller and proxy in virtual time
    plugin      for pytest, which finds it by itself
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robotree.testing.fake import Fake, in_turn
    from robotree.testing.front import cell, rehearse, rehearse_seeds
    from robotree.testing.journal import Commanded, Step
    from robotree.testing.parts import Page

_HOMES = {
    "Commanded": "journal",
    "Fake": "fake",
    "Page": "parts",
    "Step": "journal",
    "cell": "front",
    "in_turn": "fake",
    "rehearse": "front",
    "rehearse_seeds": "front",
}
"""The module of each name, loaded when it is asked for: pytest loads this package in every run."""

__all__ = ["Commanded", "Fake", "Page", "Step", "cell", "in_turn", "rehearse", "rehearse_seeds"]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from robotree.vr.base.extras import lacks

    for lack in lacks("testing"):
        raise ImportError(str(lack))
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
