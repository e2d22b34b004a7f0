"""How well ears understand a mouth: the share of sentences that are heard wrong.

    python bench/speech.py

Both are the services of examples/services; no sound leaves the machine. The baseline is the same sound
without the list of sentences that are expected: free speech, by PocketSphinx's own model of the language.
"""

from __future__ import annotations

import runpy
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SERVICES = Path(__file__).parents[1] / "examples/services"
ROUNDS = 3


def main() -> None:
    """Say each sentence a few times, and print how many were heard wrong."""
    from pocketsphinx import Decoder

    mouth, ears = (runpy.run_path(str(SERVICES / name)) for name in ("mouth.py", "ears.py"))
    sentences: list[str] = ears["SENTENCES"]
    free = Decoder(samprate=ears["RATE"], loglevel="FATAL")

    def freely(samples: bytes) -> str:
        free.start_utt()
        free.process_raw(ears["SILENCE"] + samples + ears["SILENCE"], full_utt=True)
        free.end_utt()
        best = free.hyp()
        return best.hypstr if best is not None else ""

    said = [(text, mouth["spoken"](text)) for text in sentences * ROUNDS]
    measure("of a list", said, lambda samples: ears["understood"](samples, sentences))
    measure("free", said, freely)


def measure(name: str, said: list[tuple[str, bytes]], hear: Callable[[bytes], Any]) -> None:
    """Print how many sentences were heard wrong, and how long that took beside their sound."""
    began = time.process_time()
    wrong = [(text, heard) for text, samples in said if (heard := hear(samples)) != text]
    took = time.process_time() - began
    sound = sum(len(samples) for _, samples in said) / 2 / 16000
    print(f"{name}: {len(wrong)} of {len(said)} wrong ({100 * len(wrong) / len(said):.0f} %), ", end="")
    print(f"{took / sound:.2f} s of processor for each second of sound; {sorted(set(wrong))[:5]}")


if __name__ == "__main__":
    main()
