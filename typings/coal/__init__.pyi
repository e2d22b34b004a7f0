# Narrow stub of Coal 3.0, the collision library of Pinocchio: what robotree uses of it.

class CollisionGeometry: ...

class Box(CollisionGeometry):
    def __init__(self, x: float, y: float, z: float) -> None: ...

class Capsule(CollisionGeometry):
    def __init__(self, radius: float, lz: float) -> None: ...

class Sphere(CollisionGeometry):
    def __init__(self, radius: float) -> None: ...

class CollisionRequest:
    security_margin: float

class CollisionResult:
    def isCollision(self) -> bool: ...

class DistanceResult:
    min_distance: float
