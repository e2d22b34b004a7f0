"""Square markers that cameras recognise: ArUco's original dictionary, computed from its definition.

A marker is a black frame around five rows of five modules. Each row is a word of a Hamming code that stands
for two bits of the marker's number, the most significant first (Garrido-Jurado et al., "Automatic generation
and detection of highly reliable fiducial markers under occlusion", 2014; OpenCV's `DICT_ARUCO_ORIGINAL`).
"""

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Modules: TypeAlias = NDArray[np.bool_]
NUMBERS: Final = 1024
"""Markers of the dictionary, from 0 on."""
PREFIX: Final = "tag_"
"""A geom of this name and a number shows that marker on its side towards its x, upright along its z."""
ACROSS: Final = 9
"""Modules across a printed marker: five, the black frame, and the white rim that a detector needs."""
MARKED: Final = 7 / ACROSS
"""Share of a plate's side that the marker takes; the rest is rim."""
_WORDS: Final = ("10000", "10111", "01001", "01110")


def printed(number: int) -> Modules:
    """(9, 9) whether each module is white, from the upper left one on.

    Raises:
        ValueError: there is no such marker.
    """
    if not 0 <= number < NUMBERS:
        raise ValueError(f"there is no marker {number}; there are 0 to {NUMBERS - 1}")
    white = np.ones((ACROSS, ACROSS), np.bool_)
    white[1:-1, 1:-1] = False
    for row in range(5):
        word = _WORDS[number >> 2 * (4 - row) & 3]
        white[2 + row, 2:-2] = [bit == "1" for bit in word]
    return white


def number_of(name: str) -> int | None:
    """The marker that a geom of this name shows; None: it shows none."""
    digits = name.removeprefix(PREFIX)
    return int(digits) if digits != name and digits.isdigit() else None
