"""Mouth: turns texts into sound, and streams it to whoever listens.

    robotree service examples/services/mouth.py mouth
    robotree call mouth.say text="please stop"

It speaks with eSpeak NG: the library of the system, or the one that `robotree[services]` brings.
"""

import ctypes
import ctypes.util
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from robotree.vr import CommandFailed, Range, Service, Stream, Unit, command

RATE = 16000
"""[1/s] samples of the sound: 16 bit, one channel."""
VOICE, PACE = "en-us+f3", 130
"""Which voice, and how many words in a minute."""
RETRIEVE, END_PAUSE_OFF, UTF8, RATE_PARAMETER = 2, 0x1000, 1, 1
"""Of speak_lib.h: sound goes to a callback; plain UTF-8; the parameter of the pace."""
CUT = 7200.0
"""[Hz] above which nothing is kept before there are fewer samples."""


@dataclass(frozen=True)
class Sound:
    """Something that was said."""

    samples: bytes
    number: Annotated[int, "grows by one with each"]


class Mouth(Service):
    """Speaks."""

    sound = Stream(Sound, "what it says")
    spoken: int = 0

    @command
    def say(
        self, text: Annotated[str, "up to 200 characters"]
    ) -> Annotated[float, Unit("s"), Range(0.0, 60.0)]:
        """Say a text; returns how long it takes to hear."""
        if not text.strip() or len(text) > 200:
            raise CommandFailed(robot=self.name, command="say", detail="say 1 to 200 characters at a time")
        samples = spoken(text)
        self.spoken += 1
        self.sound.send(Sound(samples, self.spoken))
        return len(samples) / 2 / RATE


def spoken(text: str) -> bytes:
    """Return the sound of a text, at `RATE`."""
    sound = bytearray()

    def take(wave: Any, count: int, _: Any) -> int:
        if wave and count > 0:
            sound.extend(ctypes.string_at(wave, 2 * count))
        return 0

    library, rate = synthesiser()
    callback = CALLBACK(take)  # kept until the sound is there
    library.espeak_SetSynthCallback(callback)
    written = text.encode() + b"\0"
    library.espeak_Synth(written, ctypes.c_size_t(len(written)), 0, 0, 0, UTF8, None, None)
    library.espeak_Synchronize()
    return resampled(bytes(sound), rate)


CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.c_void_p)
_opened: list[tuple[Any, int]] = []


def synthesiser() -> tuple[Any, int]:
    """Return the library, and the rate of its samples [1/s]."""
    if not _opened:
        try:
            import espeakng_loader

            path, voices = espeakng_loader.get_library_path(), espeakng_loader.get_data_path().encode()
        except ImportError:
            path, voices = ctypes.util.find_library("espeak-ng"), None
        if path is None:
            raise OSError("eSpeak NG is not installed: install robotree[services], or the package espeak-ng")
        library = ctypes.CDLL(path)
        rate = library.espeak_Initialize(RETRIEVE, 0, voices, 0)
        library.espeak_SetVoiceByName(VOICE.encode())
        library.espeak_SetParameter(RATE_PARAMETER, PACE, 0)
        _opened.append((library, rate))
    return _opened[0]


def resampled(sound: bytes, rate: int) -> bytes:
    """Bring 16-bit samples from one rate to `RATE`; what the new rate cannot carry is taken out first."""
    wave = np.frombuffer(sound, np.int16).astype(float)
    if rate == RATE or not wave.size:
        return sound
    taps = np.arange(-32, 33)
    kernel = np.sinc(2.0 * CUT / rate * taps) * np.hamming(taps.size)
    smooth = np.convolve(wave, kernel / kernel.sum(), "same")
    count = int(wave.size * RATE / rate)
    return np.interp(np.arange(count) * rate / RATE, np.arange(wave.size), smooth).astype(np.int16).tobytes()
