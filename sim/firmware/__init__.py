"""The program of a simulated controller: one file for each service, combined in `program`."""

from robotree.sim.firmware.outgoing import COMPONENT, Outgoing
from robotree.sim.firmware.program import MODE_PERIOD, SILENCE, Firmware
from robotree.sim.firmware.telemetry import Gauges, Identity

__all__ = ["COMPONENT", "MODE_PERIOD", "SILENCE", "Firmware", "Gauges", "Identity", "Outgoing"]
