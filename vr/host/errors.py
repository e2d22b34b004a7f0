"""What can go wrong before an agent has a network at all.

TransportError
  RealmUnusable    the meeting place of the realm cannot be made, trusted or entered
"""

from __future__ import annotations

from robotree.vr.errors import TransportError


class RealmUnusable(TransportError):
    """The directory in which the processes of a realm meet cannot be used."""

    sentence = "realm {realm!r} cannot be entered: {reason}"
