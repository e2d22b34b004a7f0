"""How quickly a bundle is checked, and what one's own page pays for that; prints microseconds.

python bench/bundles.py [REPETITIONS]

Checked: a page of 20 kB with ten files beside it, in memory: signature, key, trust, hash of each file, and
permissions. The bound is 1 ms. One's own page is compared with itself without the gate, both by turns.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.base.permissions import Permissions
from robotree.vr.base.principal import ITSELF
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.build import SigningKey, file_of, signed
from robotree.vr.bundle.file import BundleFile
from robotree.vr.bundle.trust import Signer

BOUND = 1000.0
"""[us] for a check."""
PAGE = '"""Page."""\n\nfrom robotree.vr import VirtualRobot\n\n\nclass Page(VirtualRobot):\n    """Page."""\n'


def each(repetitions: int, *work: Callable[[], object]) -> list[tuple[float, float]]:
    """Return median and 99th percentile [us] of each, done by turns."""
    times: list[list[float]] = [[] for _ in work]
    for _ in range(repetitions):
        for one, spent in zip(work, times, strict=True):
            began = time.perf_counter()
            one()
            spent.append(1e6 * (time.perf_counter() - began))
    return [(statistics.median(spent), sorted(spent)[int(len(spent) * 0.99)]) for spent in times]


def main() -> None:
    """Measure and print."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    source = PAGE + "# a line of the page, as long as a line is\n" * 450
    files = {f"lib/part{number}.py": b"x = 1\n" * 300 for number in range(10)}
    own = Bundle(source, "page.py", "", files)
    key = SigningKey(Ed25519PrivateKey.generate(), "anna")
    sent = signed(own, key, Permissions(("Arm.*",)))
    packed = file_of(sent).pack()
    with tempfile.TemporaryDirectory() as folder:
        trust = Path(folder, "allowed_signers")
        trust.write_text(Signer(("anna",), key.key.public_key().public_bytes_raw()).line() + "\n")
        trust.chmod(0o600)
        gate = Gate(trust)
        found = each(
            repetitions,
            lambda: gate.admit(sent, ITSELF, "host-1"),
            lambda: BundleFile.unpack(packed, "page.bundle"),
            lambda: signed(own, key, Permissions(("Arm.*",))),
            lambda: gate.admit(own, ITSELF, "host-1"),
        )
    for what, (median, late) in zip(
        ("checked", "read from its file", "signed", "own page"), found, strict=True
    ):
        print(f"{what:<20} p50 {median:8.1f} us   p99 {late:8.1f} us")
    verdict = "kept" if found[0][0] <= BOUND else "MISSED"
    print(f"bundle of {len(packed)} bytes; bound of a check {BOUND:.0f} us: {verdict}")


if __name__ == "__main__":
    main()
