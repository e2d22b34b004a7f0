"""The figures that the wire promises, measured: `python -m bench.wire`.

Nearly every figure is a ratio to something that does the same beside it, in turns and in one run, so that it
means the same on a fast machine, a slow one and a busy one. `figures` is the list of the promises.
"""
