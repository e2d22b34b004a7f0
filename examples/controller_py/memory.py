"""What must outlive a restart of the controller: the epoch, and the newest signing time that it has accepted.

A file and its copy, each with a checksum. A damaged or missing one is replaced by the other one. If neither is
left the controller does not start: only a person can know which leases were obeyed.
"""

import contextlib, fcntl, hashlib, json, os, sys, threading, time
from pathlib import Path

LOST = """{0} and {0}.copy are both damaged or missing, so nobody knows which leases were obeyed. Look at the robot;
then start it once with --reset-epoch, as at its very first start"""


def complain(text):
    """Say something on standard error; if that is a file on a full disk, nothing."""
    with contextlib.suppress(OSError):
        print("controller:", text, file=sys.stderr, flush=True)


class Memory:
    """Of one controller; without a path it remembers nothing, and each start is its first one."""

    def __init__(self, path="", reset=False):
        self.kept = {"count": 0, "epoch": 0, "heard": 0, "reserve": 0, "machine": ""}
        self.files, self.told = [self.opened(each) for each in (path, path + ".copy") if path], False
        copies = [self.read(each) for each in self.files]
        if path and not any(copies) and not reset:
            sys.exit("controller: " + LOST.format(path))
        for file, copy in zip((path, path + ".copy"), copies):
            if not copy and any(copies):
                complain(f"{file} is damaged or missing; the other copy is intact, and is used")
        self.kept |= max(filter(None, copies), key=lambda copy: copy["count"], default={})
        machine = Path("/proc/sys/kernel/random/boot_id")
        machine = machine.read_text().strip() if machine.exists() else ""
        if machine != self.kept["machine"]:  # the last writes may not have reached the disk
            self.kept["heard"] = self.kept["reserve"]
        if reset:
            complain("it has forgotten which leases were obeyed, and obeys any now")
        self.write(machine=machine, **{"epoch": 0} if reset else {})
        if path:
            threading.Thread(target=self.sync, daemon=True).start()

    def __getattr__(self, name):
        return self.kept[name]

    def obey(self, epoch):
        """Remember an epoch, before anything is done under it."""
        if epoch != self.epoch:
            self.write(epoch=epoch)

    def write(self, **news):
        """Keep what is new; `kill -9` cannot undo it when this returns."""
        self.kept |= news | {"count": self.count + 1}
        body = json.dumps(self.kept).encode()
        try:
            for file in self.files:
                os.pwrite(file, self.sealed(body), 0)
        except OSError as error:  # a full disk must not keep it from obeying a stop
            self.told = self.told or complain(f"its memory cannot be written ({error})") or True

    @staticmethod
    def sealed(body):
        return (hashlib.sha256(body).hexdigest().encode() + b" " + body).ljust(511) + b"\n"

    @classmethod
    def read(cls, file):
        """A copy that is intact, or None."""
        data = os.pread(file, 4096, 0)
        body = data[65:].rstrip()
        return json.loads(body) if body and data == cls.sealed(body) else None

    @staticmethod
    def opened(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sys.exit(f"controller: {path} is the memory of another controller that runs")
        return file

    def sync(self):  # in a thread: a disk may take long, and the robot moves
        while True:
            for file in self.files:
                os.fdatasync(file)
            time.sleep(1)
