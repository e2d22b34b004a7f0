"""The proxy of a companion's head: it looks, sees tags, speaks and listens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import msgspec

from robotree.protocol.messages import Joints, MavComponent, Speech, Tags, Verb
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion
from robotree.proxy.robot_proxy import CarriedCamera, RobotProxy, Streamed
from robotree.proxy.translate import READERS, MessageReaders, goal_key
from robotree.proxy.view import OFTEN, PICTURES, CameraPicture, Gaze
from robotree.vr.author.command import command
from robotree.vr.author.stream import Stream
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.units import Range, Unit

LIMITS: Limits = {
    "pan": Span(-1.7, 1.7, "rad"),
    "tilt": Span(-0.6, 0.8, "rad"),
    "rate": Span(0.05, 3.0, "rad/s"),
    "number": Span(1, 2**24 - 1, ""),
}
"""How far the neck turns, how fast, and what a text can be numbered with: a goal's argument is a float."""
USUAL_RATE = 1.5
"""[rad/s] when the caller names none."""
LONGEST = 200
"""[bytes] of UTF-8 in one text."""
HEARD = "heard"
"""Attribute of a head that has heard something: number, tag of the speaker, and the text."""
NEVER = 1e6
"""[s] age of a tag that was not seen."""

Pan = Annotated[float, Unit("rad"), LIMITS["pan"].range, "to the left"]
Tilt = Annotated[float, Unit("rad"), LIMITS["tilt"].range, "downward"]
Rate = Annotated[float, Unit("rad/s"), LIMITS["rate"].range, "of the neck"]
Tag = Annotated[int, Range(1, 255), "number of the tag"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LookAt(Motion):
    """Turn the neck to pan and tilt [rad] at rate [rad/s]."""

    effect = "repeat"
    verb = Verb.LOOK

    pan: float
    tilt: float
    rate: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Say(Motion):
    """Speak the text that was sent under a number."""

    verb = Verb.SAY

    number: int


class HeadInfo(msgspec.Struct, frozen=True, kw_only=True):
    """How the head looks, what it heard last, and how many tags it knows."""

    pan: Pan
    tilt: Tilt
    heard: Annotated[int, "how many texts were heard so far"]
    tags: Annotated[int, "how many tags were seen in the last 2 s"]


class Heard(msgspec.Struct, frozen=True, kw_only=True):
    """One text that was heard."""

    number: Annotated[int, "grows by one with each text; 0: nothing was heard yet"]
    speaker: Annotated[int, "tag of who spoke; 0: unknown"]
    text: str


class Sight(msgspec.Struct, frozen=True, kw_only=True):
    """Where a tag was seen last."""

    x: Annotated[float, Unit("m"), "of the flat"]
    y: Annotated[float, Unit("m"), "of the flat"]
    z: Annotated[float, Unit("m"), "above the floor"]
    age: Annotated[float, Unit("s"), "since it was seen"]
    seen: Annotated[bool, "whether it ever was"]


def _tags(m: Tags) -> dict[str, float]:
    return {"tags": float(sum(1 for age in m.age[: m.count] if age < 200))}


def _gaze(m: Joints) -> Gaze:
    return Gaze(m.position[0], m.position[1])


HEAD_READERS: MessageReaders = {**READERS, Tags: _tags, Speech: lambda _: {}}
"""How the telemetry of a head reads."""


class Head(RobotProxy):
    """A head: it looks, sees tags with two cameras, speaks and listens."""

    limits = LIMITS
    readers = HEAD_READERS
    reading_units: ClassVar[Mapping[str, str]] = {"tags": "count"}
    camera = CarriedCamera("left", MavComponent.CAMERA2)
    gaze: Stream[Gaze] = Stream(Gaze, "how the neck is turned", rate=OFTEN)
    pictures: Stream[CameraPicture] = Stream(CameraPicture, "of the left eye", rate=PICTURES)
    streamed = (Streamed("gaze", Joints, _gaze),)

    def readings(self) -> dict[str, float]:
        """Return the last known readings; the last utterance heard is beside them, as an attribute."""
        latest = self._session.twin.latest(Speech)
        if latest is not None:
            self.attributes[HEARD] = f"{latest.number} {latest.speaker} {latest.text}"
        return super().readings()

    @command(effect="repeat", offline="queue")
    def look(self, pan: Pan, tilt: Tilt, rate: Rate = USUAL_RATE) -> None:
        """Turn the head."""
        self.carry_out(LookAt(pan=pan, tilt=tilt, rate=rate))

    @command(offline="queue")
    def say(self, text: Annotated[str, "what to say, up to 200 bytes"]) -> None:
        """Say something aloud."""
        size = len(text.encode())
        if not text.strip() or size > LONGEST:
            reason = f"has {size} bytes; say 1 to {LONGEST} at a time"
            raise BadArgument(command=f"{self.name}.say", parameter="text", reason=reason)
        number = goal_key(self.context.key) % int(LIMITS["number"].upper) + 1
        system, component = self._session.controller
        self.tell(Speech(0, number, system, component, 0, text))
        self.carry_out(Say(number=number))

    @command(effect="read")
    def heard(self) -> Heard:
        """Tell what was heard last."""
        latest = self._session.twin.latest(Speech)
        if latest is None:
            return Heard(number=0, speaker=0, text="")
        return Heard(number=latest.number, speaker=latest.speaker, text=latest.text)

    @command(effect="read")
    def listen(
        self,
        after: Annotated[int, Range(0, 2**31), "number of the text that was heard last"],
        within: Annotated[float, Unit("s"), Range(0.0, 600.0), "how long to wait"] = 10.0,
    ) -> Heard:
        """Wait for a text that is newer than one; the same one again if none comes in time."""
        waited = 0.0
        while (latest := self.heard()).number <= after and waited < within:
            self.sleep(0.05)
            waited += 0.05
        return latest

    @command(effect="read")
    def see(self, tag: Tag) -> Sight:
        """Tell where a tag was seen last."""
        tags = self._session.twin.latest(Tags)
        if tags is not None:
            for i in range(tags.count):
                if tags.tag[i] == tag:
                    return Sight(x=tags.x[i], y=tags.y[i], z=tags.z[i], age=tags.age[i] / 100.0, seen=True)
        return Sight(x=0.0, y=0.0, z=0.0, age=NEVER, seen=False)

    @command(effect="read", offline="memory")
    def get_info(self) -> HeadInfo:
        """Tell how it looks, and what it knows."""
        readings = self.readings()
        return HeadInfo(
            pan=readings.get("j1", 0.0),
            tilt=readings.get("j2", 0.0),
            heard=self.heard().number,
            tags=int(readings.get("tags", 0)),
        )
