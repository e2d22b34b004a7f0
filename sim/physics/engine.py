"""The only import of MuJoCo: `from robotree.sim.physics.engine import mujoco`.

MuJoCo chooses an OpenGL back end while it is being imported, by the variable MUJOCO_GL, and fails right there
when that back end's libraries are missing. The simulator never draws with OpenGL (see `camera`), so it asks
for none and then restores the variable for other users in the process.
"""

import os

_wanted = os.environ.get("MUJOCO_GL")
os.environ["MUJOCO_GL"] = "disable"
try:
    import mujoco
finally:
    if _wanted is None:
        del os.environ["MUJOCO_GL"]
    else:
        os.environ["MUJOCO_GL"] = _wanted

__all__ = ["mujoco"]
