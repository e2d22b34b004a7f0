"""The program of a simulated controller: one file for each service, combined in `program`."""

from robotree.sim.firmware.description import Gauges, Identity
from robotree.sim.firmware.outgoing import COMPONENT, Outgoing
from robotree.sim.firmware.program import MODE_PERIOD, SILENCE, Firmware

__all__ = ["COMPONENT", "MODE_PERIOD", "SILENCE", "Firmware", "Gauges", "Identity", "Outgoing"]
