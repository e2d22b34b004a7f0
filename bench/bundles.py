"""How quickly a bundle is checked, and what one's own page pays for that; prints microseconds.

python bench/bundles.py [REPETITIONS]

Checked: a page of 20 kB with ten files beside it, in memory: signature, key, trust, hash of each file, and
permissions. The bound is 1 ms. One's own page is compared with itself without the gate, both by turns.
"""

from __future__ import annotations

from statistics import median

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from measuring import apart, clock, count_given, quantile

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


def main() -> None:
    """Measure and print."""
    repetitions = count_given(1, 2000)
    source = PAGE + "# a line of the page, as long as a line is\n" * 450
    files = {f"lib/part{number}.py": b"x = 1\n" * 300 for number in range(10)}
    own = Bundle(source, "page.py", "", files)
    key = SigningKey(Ed25519PrivateKey.generate(), "anna")
    sent = signed(own, key, Permissions(("Arm.*",)))
    packed = file_of(sent).pack()
    with apart() as folder:
        trust = folder / "allowed_signers"
        trust.write_text(Signer(("anna",), key.key.public_key().public_bytes_raw()).line() + "\n")
        trust.chmod(0o600)
        gate = Gate(trust)
        work = {
            "checked": lambda: gate.admit(sent, ITSELF, "host-1"),
            "read from its file": lambda: BundleFile.unpack(packed, "page.bundle"),
            "signed": lambda: signed(own, key, Permissions(("Arm.*",))),
            "own page": lambda: gate.admit(own, ITSELF, "host-1"),
        }
        taken = {name: list[float]() for name in work}
        for _ in range(repetitions):
            for name, action in work.items():
                taken[name] += clock(action, 1)
    for name, times in taken.items():
        print(f"{name:<20} p50 {median(times):8.1f} us   p99 {quantile(times, 0.99):8.1f} us")
    verdict = "kept" if median(taken["checked"]) <= BOUND else "MISSED"
    print(f"bundle of {len(packed)} bytes; bound of a check {BOUND:.0f} us: {verdict}")


if __name__ == "__main__":
    main()
