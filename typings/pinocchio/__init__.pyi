# Narrow stub of Pinocchio 4.1: what robotree uses of it.
# ruff: noqa: A002  the library's own names and flags

from collections.abc import Sequence
from enum import Enum
from typing import TypeAlias, overload

import coal
import numpy as np
from numpy.typing import NDArray

_Array: TypeAlias = NDArray[np.float64]

class ReferenceFrame(Enum):
    LOCAL = ...
    LOCAL_WORLD_ALIGNED = ...

LOCAL: ReferenceFrame
LOCAL_WORLD_ALIGNED: ReferenceFrame

class Motion:
    @property
    def vector(self) -> _Array: ...

class Quaternion:
    def __init__(self, rotation: _Array) -> None: ...
    def coeffs(self) -> _Array: ...

class SE3:
    translation: _Array
    rotation: _Array
    def __init__(self, rotation: _Array, translation: _Array) -> None: ...
    def actInv(self, other: SE3) -> SE3: ...

class Inertia:
    mass: float
    lever: _Array

class JointModel:
    idx_q: int

class Data:
    M: _Array
    nle: _Array
    oMi: Sequence[SE3]

class Model:
    nq: int
    lowerPositionLimit: _Array
    upperPositionLimit: _Array
    inertias: Sequence[Inertia]
    joints: Sequence[JointModel]
    def createData(self) -> Data: ...
    def getJointId(self, name: str) -> int: ...
    def getFrameId(self, name: str) -> int: ...

class GeometryType(Enum):
    COLLISION = ...

COLLISION: GeometryType

class GeometryObject:
    name: str
    placement: SE3
    def __init__(
        self, name: str, parent_joint: int, placement: SE3, collision_geometry: coal.CollisionGeometry
    ) -> None: ...

class CollisionPair:
    def __init__(self, first: int, second: int) -> None: ...

class GeometryData:
    collisionRequests: Sequence[coal.CollisionRequest]
    collisionResults: Sequence[coal.CollisionResult]

class GeometryModel:
    geometryObjects: Sequence[GeometryObject]
    def addGeometryObject(self, geometry_object: GeometryObject) -> int: ...
    def addCollisionPair(self, pair: CollisionPair) -> None: ...
    def getGeometryId(self, name: str) -> int: ...
    def createData(self) -> GeometryData: ...

def buildModelFromMJCF(filename: str) -> Model: ...
def buildGeomFromMJCF(model: Model, filename: str, type: GeometryType) -> GeometryModel: ...
@overload
def buildReducedModel(
    model: Model, list_of_joints_to_lock: Sequence[int], reference_configuration: _Array
) -> Model: ...
@overload
def buildReducedModel(
    model: Model,
    list_of_geom_models: Sequence[GeometryModel],
    list_of_joints_to_lock: Sequence[int],
    reference_configuration: _Array,
) -> tuple[Model, Sequence[GeometryModel]]: ...
def computeCollisions(
    model: Model,
    data: Data,
    geometry_model: GeometryModel,
    geometry_data: GeometryData,
    q: _Array,
    stop_at_first_collision: bool,
) -> bool: ...
def computeDistance(
    geometry_model: GeometryModel, geometry_data: GeometryData, pair_index: int
) -> coal.DistanceResult: ...
def centerOfMass(model: Model, data: Data, q: _Array) -> _Array: ...
def computeJointJacobians(model: Model, data: Data, q: _Array) -> _Array: ...
def exp3(w: _Array) -> _Array: ...
def forwardKinematics(model: Model, data: Data, q: _Array) -> None: ...
def updateFramePlacement(model: Model, data: Data, frame_id: int) -> SE3: ...
def computeAllTerms(model: Model, data: Data, q: _Array, v: _Array) -> None: ...
def computeMinverse(model: Model, data: Data, q: _Array) -> _Array: ...
def computeFrameJacobian(
    model: Model, data: Data, q: _Array, frame_id: int, reference_frame: ReferenceFrame
) -> _Array: ...
def getFrameJacobian(model: Model, data: Data, frame_id: int, reference_frame: ReferenceFrame) -> _Array: ...
def log3(R: _Array) -> _Array: ...
def log6(M: SE3) -> Motion: ...
