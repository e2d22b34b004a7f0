"""Recogniser: tells whom and what a companion's camera sees, and where, by the markers that they wear.

    robotree service examples/services/recogniser.py eyes
    robotree enslave eyes.head head
    robotree enslave eyes.base base
    robotree call eyes.watch --detach
    robotree call eyes.where what=anna

It needs OpenCV (`robotree[services]`). It takes no lease: the companion goes about its business meanwhile.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import cv2
import numpy as np

from robotree.vr import CommandFailed, Range, Service, Stream, Unit, Watch, command, state

MARKERS = {1: "red cup", 2: "green cup", 3: "blue cup", 11: "anna", 12: "bela", 13: "cleo"}
"""What wears which marker of ArUco's original dictionary."""
SIDE = {**dict.fromkeys((1, 2, 3), 0.0653), **dict.fromkeys((11, 12, 13), 0.1089)}
"""[m] of the black square: seven ninths of the printed plate."""
DEPTH = {**dict.fromkeys((1, 2, 3), 0.035), **dict.fromkeys((11, 12, 13), 0.134)}
"""[m] from the middle of what wears it to its plate."""
PEOPLE = frozenset({"anna", "bela", "cleo"})

FOVY = math.radians(64.0)
"""[rad] of the eye, from the upper to the lower edge of a picture."""
NECK, EYE = (-0.02, 0.0, 1.18), (0.12, 0.033, 0.105)
"""[m] where the neck turns, from the middle of the base on the floor, and the left eye from there."""
FARTHEST = 3.0
"""[m] beyond which a marker is too small for its place to be told."""
FINE = cv2.aruco.DetectorParameters()
FINE.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
"""How corners are found: between the pixels, too."""
STEADY = 0.02
"""[m, rad] by which base and neck may have moved between two pictures, else places are not told."""

Stand: TypeAlias = tuple[float, float, float, float, float]
"""Where the base stands, x, y [m] and heading [rad], and pan and tilt of the neck [rad]."""


@dataclass(frozen=True)
class Sighting:
    """Something that was seen."""

    what: str
    x: Annotated[float, Unit("m"), "of the flat"]
    y: Annotated[float, Unit("m"), "of the flat"]
    z: Annotated[float, Unit("m"), "above the floor"]
    at: Annotated[float, Unit("s"), "on the clock of the service"]


class Recogniser(Service):
    """Recognises who and what wears a marker."""

    head = Watch("Head", "whose pictures are looked at")
    base = Watch("Base", "on which the head stands")
    seen = Stream(Sighting, "each thing in each picture")
    known: dict[str, Sighting] = state({})
    """Where each was seen last."""
    met: list[str] = state([])
    """Who was told as a newcomer already."""

    def readings(self) -> dict[str, float]:
        """See `Robot.readings`."""
        return {"known": float(len(self.known))}

    @command(effect="read")
    def watch(self, seconds: Annotated[float, Unit("s"), Range(0.0, 86400.0)] = 86400.0) -> int:
        """Look at the pictures until the time is over; returns how many there were."""
        return sum(1 for _ in self.looked(self.now() + seconds))

    @command(effect="read")
    def where(self, what: str) -> Sighting:
        """Tell where something was seen last."""
        if what not in self.known:
            raise self.unknown(what)
        return self.known[what]

    @command
    def newcomer(
        self,
        within: Annotated[float, Unit("s"), Range(0.0, 3600.0)] = 600.0,
        nearer: Annotated[float, Unit("m"), Range(0.0, 3.0), "to the base"] = 1.3,
    ) -> str:
        """Look until a person is near who was not told before, and tell the name."""
        for sightings, stand in self.looked(self.now() + within):
            for one in sightings:
                near = math.dist((one.x, one.y), stand[:2]) < nearer
                if one.what in PEOPLE and one.what not in self.met and near:
                    self.met = [*self.met, one.what]
                    return one.what
        raise CommandFailed(robot=self.name, command="newcomer", detail="nobody new came")

    @command
    def forget(self) -> None:
        """Forget who was here: everybody is a newcomer again."""
        self.known, self.met = {}, []

    # -- how it is done

    def looked(self, end: float) -> Iterator[tuple[list[Sighting], Stand]]:
        """Look at the pictures until a time [s]; gives what is in each, and how the robot stood."""
        before = self.stand()
        while self.now() < end:
            try:
                picture = self.head.pictures.next(min(5.0, end - self.now()))
            except TimeoutError:
                continue
            after = self.stand()
            moved = max(abs(a - b) for a, b in zip(before, after, strict=True))
            found = self.recognised(picture.jpeg, after, self.now()) if moved < STEADY else []
            for sighting in found:
                self.known = {**self.known, sighting.what: sighting}
                self.seen.send(sighting)
            yield found, after
            before = after

    def unknown(self, what: str) -> CommandFailed:
        """What to raise for something that nobody has seen."""
        known = ", ".join(sorted(MARKERS.values()))
        detail = (
            f"{what} was not seen yet" if what in MARKERS.values() else f"nothing is called {what!r}: {known}"
        )
        return CommandFailed(robot=self.name, command="where", detail=detail)

    def stand(self) -> Stand:
        """Where the base stands, its heading, and how the neck is turned [m, rad]."""
        place, gaze = self.base.place.latest, self.head.gaze.latest
        return place.x, place.y, place.heading, gaze.pan, gaze.tilt

    def recognised(self, jpeg: bytes, stand: Stand, now: float) -> list[Sighting]:
        """Find the markers in a picture, and where in the flat they are."""
        grey = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        if grey is None:  # no picture at all
            return []
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
        detector = cv2.aruco.ArucoDetector(dictionary, FINE)
        squares, numbers, _ = detector.detectMarkers(grey)
        found = []
        for square, number in zip(squares, [] if numbers is None else numbers.ravel().tolist(), strict=True):
            if number in MARKERS and (at := self.place_of(square[0], number, grey.shape, stand)) is not None:
                x, y, z = at
                found.append(Sighting(what=MARKERS[number], x=x, y=y, z=z, at=now))
        return found

    def place_of(self, corners, number, shape, stand):  # noqa: ANN001, ANN201 # arrays
        """Where the middle of what wears a marker is in the flat [m]; None: it is too far to tell."""
        height, width = shape
        focal = height / 2.0 / math.tan(FOVY / 2.0)
        lens = np.array([[focal, 0, width / 2.0], [0, focal, height / 2.0], [0, 0, 1.0]])
        half = SIDE[number] / 2.0
        square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        good, _, moved = cv2.solvePnP(
            square, corners.astype(float), lens, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        if not good or float(np.linalg.norm(moved)) > FARTHEST:
            return None
        right, down, ahead = moved.ravel().tolist()
        x, y, z = in_flat((ahead, -right, -down), stand)
        # What wears it is behind the plate, away from the eye. How the plate is turned is told by a few
        # pixels, and would be the greater error.
        eye = in_flat((0.0, 0.0, 0.0), stand)
        away = DEPTH[number] / math.dist((x, y), eye[:2])
        return x + away * (x - eye[0]), y + away * (y - eye[1]), z


def in_flat(at, stand):  # noqa: ANN001, ANN201 # three and five numbers
    """Turn a point before the eye (ahead, left, up) into the flat's frame [m]."""
    x, y, heading, pan, tilt = stand
    point = np.array(at) + EYE
    c, s = math.cos(tilt), math.sin(tilt)
    point = np.array([c * point[0] + s * point[2], point[1], c * point[2] - s * point[0]])
    c, s = math.cos(pan), math.sin(pan)
    point = np.array([c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]]) + NECK
    c, s = math.cos(heading), math.sin(heading)
    return x + c * point[0] - s * point[1], y + s * point[0] + c * point[1], float(point[2])
