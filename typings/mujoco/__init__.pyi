# Narrow stub of MuJoCo 4.0: what robotree uses of it.
# ruff: noqa: A002  the library's own names

from collections.abc import Sequence
from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_Array: TypeAlias = NDArray[np.float64]

class mjtGeom(IntEnum):
    mjGEOM_PLANE = ...
    mjGEOM_BOX = ...
    mjGEOM_CAPSULE = ...
    mjGEOM_CYLINDER = ...
    mjGEOM_SPHERE = ...

class mjtEnableBit(IntEnum):
    mjENBL_SLEEP = ...

class mjtEq(IntEnum):
    mjEQ_WELD = ...

class mjtObj(IntEnum):
    mjOBJ_BODY = ...

class mjtIntegrator(IntEnum):
    mjINT_IMPLICITFAST = ...

class mjtCone(IntEnum):
    mjCONE_ELLIPTIC = ...

class mjtOrientation(IntEnum):
    mjORIENTATION_XYAXES = ...

class mjtState(IntEnum):
    mjSTATE_INTEGRATION = ...

class MjsFrame: ...

class MjsGeom:
    contype: int
    conaffinity: int

class MjsOrientation:
    type: mjtOrientation
    xyaxes: Sequence[float]

class MjsCamera:
    alt: MjsOrientation

class MjsBody:
    def add_geom(
        self,
        *,
        name: str,
        type: mjtGeom,
        size: Sequence[float],
        rgba: Sequence[float],
        pos: Sequence[float] = ...,
        quat: Sequence[float] = ...,
        fromto: Sequence[float] = ...,
        mass: float = ...,
        condim: int = ...,
        contype: int = ...,
        conaffinity: int = ...,
        group: int = ...,
        friction: Sequence[float] = ...,
        solref: Sequence[float] = ...,
    ) -> MjsGeom: ...
    def add_body(self, *, name: str, pos: Sequence[float], mocap: bool = ...) -> MjsBody: ...
    def add_freejoint(self, *, name: str) -> object: ...
    def add_light(self, *, name: str, pos: Sequence[float], dir: Sequence[float]) -> object: ...
    def add_camera(self, *, name: str, pos: Sequence[float], fovy: float) -> MjsCamera: ...
    def add_frame(self, *, pos: Sequence[float]) -> MjsFrame: ...

class MjOption:
    timestep: float
    integrator: mjtIntegrator
    cone: mjtCone
    impratio: float
    enableflags: int

class MjSpec:
    option: MjOption
    worldbody: MjsBody
    @staticmethod
    def from_file(filename: str) -> MjSpec: ...
    def attach(self, child: MjSpec, *, prefix: str, frame: MjsFrame) -> MjsFrame: ...
    def body(self, name: str) -> MjsBody: ...
    def geom(self, name: str) -> MjsGeom: ...
    def add_equality(
        self,
        *,
        name: str,
        type: mjtEq,
        objtype: mjtObj,
        name1: str,
        name2: str,
        active: bool,
        solref: Sequence[float],
    ) -> object: ...
    def compile(self) -> MjModel: ...

class _Named:
    id: int
    name: str

class _Body(_Named):
    mocapid: NDArray[np.int32]

class _BodyData(_Named):
    xpos: _Array
    xquat: _Array

class _JointData(_Named):
    qpos: _Array

class _Contacts:
    geom: NDArray[np.int32]

class _Joint(_Named):
    qposadr: NDArray[np.int32]
    dofadr: NDArray[np.int32]

class _Sensor(_Named):
    adr: NDArray[np.int32]

class MjModel:
    opt: MjOption
    actuator_ctrladr: NDArray[np.int32]
    actuator_forcerange: _Array
    body_subtreemass: _Array
    cam_fovy: _Array
    dof_frictionloss: _Array
    geom_rgba: NDArray[np.float32]
    geom_size: _Array
    geom_type: NDArray[np.int32]
    light_pos: _Array
    ncam: int
    ngeom: int
    def actuator(self, name: str) -> _Named: ...
    eq_data: _Array
    def body(self, name: str) -> _Body: ...
    def equality(self, name: str) -> _Named: ...
    def geom(self, name: str | int) -> _Named: ...
    def camera(self, name: str) -> _Named: ...
    def joint(self, name: str) -> _Joint: ...
    def sensor(self, name: str) -> _Sensor: ...
    def site(self, name: str) -> _Named: ...

class MjData:
    actuator_force: _Array
    actuator_velocity: _Array
    contact: _Contacts
    eq_active: NDArray[np.uint8]
    mocap_pos: _Array
    mocap_quat: _Array
    ncon: int
    xpos: _Array
    def body(self, name: str) -> _BodyData: ...
    def joint(self, name: str) -> _JointData: ...
    cam_xmat: _Array
    geom_xmat: _Array
    geom_xpos: _Array
    cam_xpos: _Array
    cfrc_ext: _Array
    ctrl: _Array
    qacc: _Array
    qfrc_bias: _Array
    qpos: _Array
    qvel: _Array
    sensordata: _Array
    site_xmat: _Array
    site_xpos: _Array
    subtree_com: _Array
    time: float
    xfrc_applied: _Array
    def __init__(self, model: MjModel) -> None: ...

def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_step(m: MjModel, d: MjData) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_comPos(m: MjModel, d: MjData) -> None: ...
def mj_camlight(m: MjModel, d: MjData) -> None: ...
def mj_stateSize(m: MjModel, sig: int) -> int: ...
def mj_getState(m: MjModel, d: MjData, state: _Array, sig: int) -> None: ...
def mj_setState(m: MjModel, d: MjData, state: _Array, sig: int) -> None: ...
def mj_contactForce(m: MjModel, d: MjData, id: int, result: _Array) -> None: ...
def mju_negQuat(res: _Array, quat: _Array) -> None: ...
def mju_mat2Quat(quat: _Array, mat: _Array) -> None: ...
def mju_mulQuat(res: _Array, quat1: _Array, quat2: _Array) -> None: ...
def mju_rotVecQuat(res: _Array, vec: _Array, quat: _Array) -> None: ...
def mj_geomDistance(
    m: MjModel, d: MjData, geom1: int, geom2: int, distmax: float, fromto: _Array | None
) -> float: ...
def mj_ray(
    m: MjModel,
    d: MjData,
    pnt: _Array,
    vec: _Array,
    geomgroup: NDArray[np.uint8] | None,
    flg_static: int,
    bodyexclude: int,
    geomid: NDArray[np.int32] | None,
    normal: _Array | None,
) -> float: ...
def mj_multiRay(
    m: MjModel,
    d: MjData,
    pnt: _Array,
    vec: _Array,
    geomgroup: NDArray[np.uint8] | None,
    flg_static: int,
    bodyexclude: int,
    geomid: NDArray[np.int32],
    dist: _Array,
    normal: _Array | None,
    nray: int,
    cutoff: float,
) -> None: ...
