"""Ears: understand what a mouth says, of the sentences that they are told to expect.

    robotree service examples/services/ears.py ears
    robotree enslave ears.mouth mouth
    robotree call ears.listen --detach

They hear with PocketSphinx, whose model of English comes with it (`robotree[services]`). A short list of
sentences is understood far better than free speech; docs/services-of-robots.md says how well.
"""

from dataclasses import dataclass
from typing import Annotated, Any

from pocketsphinx import Decoder

from robotree.vr import CommandFailed, Range, Service, Stream, Unit, Watch, command, state

RATE = 16000
SILENCE = bytes(RATE // 5 * 2)
"""0.2 s before and after a sound: a recogniser wants to hear where speech begins and ends."""
SENTENCES = [
    *("please stop", "go on", "go and charge", "go to the table", "go to the sofa", "go to the door"),
    *("bring me the red cup", "bring me the green cup", "bring me the blue cup", "take the red cup"),
    *("where is the red cup", "where is the blue cup", "give it to anna", "who is there", "thank you"),
    *("what is your name", "good bye", "welcome", "yes", "no"),
]
"""What is expected unless somebody says otherwise."""


@dataclass(frozen=True)
class Understood:
    """One sentence; empty: it was none of those that are expected."""

    text: str
    number: Annotated[int, "grows by one with each"]


class Ears(Service):
    """Listens."""

    mouth = Watch("Mouth", "who speaks")
    words = Stream(Understood, "each sentence")
    sentences: list[str] = state(SENTENCES)
    heard: Understood = state(Understood("", 0))

    @command
    def expect(self, sentences: list[str]) -> None:
        """Understand these sentences from now on, and no others."""
        if not sentences:
            raise CommandFailed(robot=self.name, command="expect", detail="expect one sentence at least")
        missing = unknown_words(sentences)
        if missing:
            detail = f"the model knows no {', '.join(missing)}; use other words"
            raise CommandFailed(robot=self.name, command="expect", detail=detail)
        self.sentences = [sentence.lower() for sentence in sentences]

    @command(effect="read")
    def listen(self, seconds: Annotated[float, Unit("s"), Range(0.0, 86400.0)] = 86400.0) -> int:
        """Listen until the time is over; returns how many sentences there were."""
        end, count = self.now() + seconds, 0
        while (left := end - self.now()) > 0:
            try:
                sound = next(self.mouth.sound(within=min(left, 5.0)))
            except TimeoutError:
                continue
            count += 1
            self.heard = Understood(understood(sound.samples, self.sentences), self.heard.number + 1)
            self.words.send(self.heard)
        return count

    @command(effect="read")
    def latest(self) -> Understood:
        """Tell what was understood last."""
        return self.heard

    @command(effect="read")
    def next(
        self,
        after: Annotated[int, Range(0, 2**31), "number of the sentence that was heard last"],
        within: Annotated[float, Unit("s"), Range(0.0, 3600.0)] = 60.0,
    ) -> Understood:
        """Wait for a sentence that is newer than one."""
        end = self.now() + within
        while self.heard.number <= after:
            if self.now() >= end:
                raise CommandFailed(robot=self.name, command="next", detail="nobody said anything")
            self.sleep(0.05)
        return self.heard


_decoders: dict[tuple[str, ...], Any] = {}


def decoder_of(sentences: list[str]) -> Any:
    """Return a recogniser of these sentences; the one of the last list is kept."""
    key = tuple(sentences)
    if key not in _decoders:
        _decoders.clear()
        decoder = _decoders[key] = Decoder(samprate=RATE, loglevel="FATAL", lm=None)
        choice = " | ".join(sentences)
        decoder.add_jsgf_string("s", f"#JSGF V1.0;\ngrammar s;\npublic <s> = {choice};\n")
        decoder.activate_search("s")
    return _decoders[key]


def unknown_words(sentences: list[str]) -> list[str]:
    """Return the words that the model has no sound for."""
    decoder = Decoder(samprate=RATE, loglevel="FATAL", lm=None)
    words = {word for sentence in sentences for word in sentence.lower().split()}
    return sorted(word for word in words if decoder.lookup_word(word) is None)


def understood(samples: bytes, sentences: list[str]) -> str:
    """Return which sentence a sound is; empty: none."""
    decoder = decoder_of(sentences)
    decoder.start_utt()
    decoder.process_raw(SILENCE + samples + SILENCE, full_utt=True)
    decoder.end_utt()
    best = decoder.hyp()
    return best.hypstr if best is not None and best.hypstr in sentences else ""
