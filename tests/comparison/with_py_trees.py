"""Pick-and-place with py_trees: behaviours that start a goal, poll it and cancel it, in a sequence."""

import signal
import sys
import threading
import time

import py_trees
from client import ArmClient
from py_trees.common import Status

# -- page
LOW, HIGH = 0.03, 0.15


class Move(py_trees.behaviour.Behaviour):
    """One goal of the arm: started, polled, and cancelled when something of higher priority interrupts."""

    def __init__(self, name, arm, **goal):
        super().__init__(name)
        self.arm, self.goal = arm, goal

    def initialise(self):
        self.under_way = self.arm.start(**self.goal)

    def update(self):
        if not self.under_way.ended.is_set():
            return Status.RUNNING
        self.feedback_message = self.under_way.error or "done"
        return Status.FAILURE if self.under_way.error else Status.SUCCESS

    def terminate(self, new_status):
        if new_status == Status.INVALID and self.status == Status.RUNNING:
            self.arm.stop()


def reach(arm, x, y, grip):
    for value in (x, y):
        if not -0.6 <= value <= 0.6:
            raise ValueError(f"{value} m is out of range")
    sequence = py_trees.composites.Sequence(f"{grip} at {x}, {y}", memory=True)
    sequence.add_children(
        [
            Move("above", arm, x=x, y=y, z=HIGH),
            Move("down", arm, x=x, y=y, z=LOW),
            Move(grip, arm, grip=grip),
            Move("up", arm, x=x, y=y, z=HIGH),
        ]
    )
    return sequence


class PickAndPlace(py_trees.composites.Selector):
    """The work, or else the clean-up; an interruption lets go, too, and waits for that."""

    def __init__(self, arm, **options):
        super().__init__("pick and place", memory=True, **options)
        self.arm = arm

    def terminate(self, new_status):
        if new_status == Status.INVALID and self.status == Status.RUNNING:
            self.arm.start(grip="open").ended.wait(5)


def pick_and_place(arm, x, y, to_x, to_y):
    work = py_trees.composites.Sequence("pick and place", memory=True)
    work.add_children([reach(arm, x, y, "close"), reach(arm, to_x, to_y, "open")])
    clean_up = py_trees.composites.Sequence("clean up", memory=True)
    clean_up.add_children(
        [Move("let go", arm, grip="open"), py_trees.behaviours.Failure("it did not succeed")]
    )
    return PickAndPlace(arm, children=[work, clean_up])


# -- end of the page


def main(port):
    tree = py_trees.trees.BehaviourTree(pick_and_place(ArmClient(port), 0.3, 0.0, 0.3, 0.2))
    tree.setup()
    cancelled = threading.Event()
    signal.signal(signal.SIGUSR1, lambda *_: cancelled.set())
    while tree.root.status in {Status.INVALID, Status.RUNNING}:
        if cancelled.is_set():
            tree.root.stop(Status.INVALID)
            print("cancelled", flush=True)
            return
        tree.tick()
        time.sleep(0.05)
    print(tree.root.status.name.lower(), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
