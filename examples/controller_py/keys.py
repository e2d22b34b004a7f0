"""Who may speak to the controller: MAVLink 2 signatures with a key that no other controller has.

Unsigned frames, those with another key, and recordings are refused, also after a restart. (pymavlink's own check
would not do: it believes the time of a frame before it has verified the signature, and after a restart it accepts
every recording.) Times count 10 us since the beginning of 2015.
"""

import fnmatch, hashlib, hmac, os, sys, time

UNITS, MINUTE, RESERVE, STREAMS = 100_000, 6_000_000, 2_000_000, 64
SET_FROM = (1767225600 - 1420070400) * UNITS  # a clock before 2026 was never set


def derived(shared, name):
    """A controller's key from that of the realm or the cell: HKDF without salt (RFC 5869), then a passphrase."""
    block = hmac.digest(bytes(32), shared, "sha256")
    block = hmac.digest(block, b"robotree controller " + name.encode() + b"\x01", "sha256")
    return hashlib.sha256(block[:16].hex().encode()).digest()


def key_of(file, name):
    """The key of a controller; of a key file the first line counts that fits."""
    with open(file, encoding="utf-8") as lines:
        status = os.fstat(lines.fileno())
        if status.st_mode & 0o077 or status.st_uid != os.geteuid():
            sys.exit(f"controller: {file} can be read by others; run chmod 600 on it")
        words = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if any(len(each) != 2 or len(each[1]) != 64 or set(each[1]) - set("0123456789abcdef") for each in words):
        sys.exit(f"controller: {file} has a line that is no pattern and key of 64 digits")
    for pattern, digits in words:
        if pattern == name:
            return bytes.fromhex(digits)  # its own, as it is
        if fnmatch.fnmatchcase(name, pattern):
            return derived(bytes.fromhex(digits), name)
    sys.exit(f"controller: {file} has no line for {name}")


class Keys:
    """Signs what the controller says, and decides what it hears; `wall` is a clock, Unix time in seconds."""

    def __init__(self, secret, memory, wall=time.time):
        self.secret, self.memory, self._wall = secret, memory, wall
        self.streams, self.floor = {}, 0  # newest time by system, component and link; that of those forgotten
        self.start = max(self.wall(), memory.heard + 1)  # no stream begins before it
        self.last = (
            self.wall() if self.wall() > memory.heard else memory.reserve
        )  # the last time that we signed
        self.tick()

    def wall(self):
        return max(0, int((self._wall() - 1420070400) * UNITS))

    def next(self):
        """A time for one frame that we sign."""
        self.last = max(self.wall(), self.last + 1)
        return self.last

    def tick(self, heard=0):
        """Remember what is heard, and now and then a time ahead, for a clock that is set back."""
        news = {"heard": heard} if heard else {}
        latest = max(self.wall(), self.last, heard, self.memory.heard)
        if latest + RESERVE // 2 >= self.memory.reserve:
            news["reserve"] = latest + RESERVE
        if news:
            self.memory.write(**news)

    def objection(self, frame):
        """Why a frame is not obeyed; empty: it is."""
        if frame[0] != 0xFD or not frame[2] & 1:
            return "is not signed"
        if not hmac.compare_digest(hashlib.sha256(self.secret + frame[:-6]).digest()[:6], frame[-6:]):
            return "is signed with another key"  # before its time is believed
        sender, moment = frame[5:7] + frame[-13:-12], int.from_bytes(frame[-12:-6], "little")
        now, newest = max(self.wall(), self.last), self.streams.get(sender)
        if newest is not None and moment <= newest:
            return "was heard before"
        if newest is None and (moment < self.start or moment <= self.floor or moment + MINUTE < now):
            return "is too old"
        if moment > self.memory.heard + MINUTE and moment > now + MINUTE and self.wall() >= SET_FROM:
            return "is of a clock that is more than a minute ahead"
        if newest is None and len(self.streams) == STREAMS:  # one is forgotten, and its time stays
            self.floor = max(self.floor, self.streams.pop(min(self.streams, key=self.streams.get)))
        self.streams[sender] = moment
        if moment > self.memory.heard:
            self.tick(moment)  # written before the frame is obeyed
        return ""
