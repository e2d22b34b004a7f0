from collections.abc import Callable
from typing import Generic, TypeVar

_T = TypeVar("_T")

class Callback(Generic[_T]):
    def __init__(
        self,
        callback: Callable[[_T], object],
        drop: Callable[[], object] | None = None,
        *,
        indirect: bool = True,
    ) -> None: ...
