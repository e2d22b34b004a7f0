"""Nobody would call it in the emergency."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    def on_stop(self, reason: str) -> None:
        print(reason)

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: nothing calls on_stop; did you mean safe_stop(reason)?
# check: line 14: nothing calls on_stop: did you mean safe_stop(reason)?
