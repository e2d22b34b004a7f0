"""The figures that the wire promises, measured: `robotree wire bench`.

Nearly every figure is a ratio to something that does the same beside it, in turns and in one run, so that it
means the same on a fast machine, a slow one and a busy one. `figures` is the list of the promises.
"""

from robotree.protocol.tools.measure.figures import FIGURES, Figure, Promise

__all__ = ["FIGURES", "Figure", "Promise"]
