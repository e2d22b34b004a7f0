"""Pick-and-place with bluesky: a plan over an ophyd device, with its clean-up in `finalize_wrapper`."""

import signal
import sys
import threading

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
from bluesky import RunEngine
from bluesky.utils import FailedStatus, RequestAbort, RunEngineInterrupted
from client import ArmClient
from ophyd import Device
from ophyd.status import DeviceStatus
from ophyd.utils import LimitError

# -- page
LOW, HIGH = 0.03, 0.15


class Arm(Device):
    """The arm: `set` starts a goal and returns its status, `stop` ends it."""

    def __init__(self, client, **options):
        super().__init__("", **options)
        self.client = client
        self.stopping = False

    def check_value(self, goal):
        if any(not -0.6 <= goal[name] <= 0.6 for name in ("x", "y") if name in goal):
            raise LimitError(f"{goal} is out of range [m]")

    def set(self, goal):
        self.check_value(goal)
        self.stopping = False
        status = DeviceStatus(self)
        under_way = self.client.start(**goal)

        def finish():
            under_way.ended.wait()
            if under_way.error and not self.stopping:
                status.set_exception(RuntimeError(under_way.error))
            else:
                status.set_finished()

        threading.Thread(target=finish, daemon=True).start()
        return status

    def stop(self, *, success=False):
        self.stopping = True
        self.client.stop()


def reach(arm, x, y, grip):
    for goal in ({"x": x, "y": y, "z": HIGH}, {"x": x, "y": y, "z": LOW}, {"grip": grip}):
        yield from bps.mv(arm, goal)
    yield from bps.mv(arm, {"x": x, "y": y, "z": HIGH})


def pick_and_place(arm, x, y, to_x, to_y):
    def work():
        yield from reach(arm, x, y, "close")
        print("gripped", flush=True)
        yield from reach(arm, to_x, to_y, "open")

    def clean_up(error):
        yield from bps.stop(arm)
        yield from bps.sleep(0.1)  # until the status of the motion that was stopped has come
        yield from bps.mv(arm, {"grip": "open"})

    yield from bpp.contingency_wrapper(work(), except_plan=clean_up)


# -- end of the page


def main(port):
    engine = RunEngine({})
    arm = Arm(ArmClient(port), name="arm")
    signal.signal(signal.SIGUSR1, lambda *_: threading.Thread(target=engine.abort).start())
    try:
        engine(pick_and_place(arm, 0.3, 0.0, 0.3, 0.2))
    except (RequestAbort, RunEngineInterrupted):
        print("cancelled", flush=True)
    except (FailedStatus, OSError) as error:
        print(f"failure: {error.__cause__ or error!r}", flush=True)
    else:
        print("success", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
