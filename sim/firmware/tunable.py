"""What can be tuned on a robot while it runs: one registry of parameters per kind, beside the kind's device.

A parameter names an attribute of the device's tuning, its limits and its unit; the wire, the documentation
and the tests read the same registry.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Tunable:
    """One number that can be tuned.

    Attributes:
        name: on the wire, at most 16 characters.
        attribute: of the object that owns the value.
        lower: smallest value that is allowed.
        upper: largest value that is allowed.
        text: its unit, and what it does.
    """

    name: str
    attribute: str
    lower: float
    upper: float
    text: str

    def read(self, owner: object) -> float:
        """The value now."""
        return float(getattr(owner, self.attribute))

    def write(self, owner: object, value: float) -> None:
        """Change the value."""
        setattr(owner, self.attribute, value)
