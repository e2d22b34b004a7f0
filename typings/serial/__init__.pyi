# What robotree uses of pyserial, which has no types of its own.

class SerialException(OSError): ...

class Serial:
    def __init__(
        self,
        port: str | None = None,
        baudrate: int = 9600,
        *,
        timeout: float | None = None,
        write_timeout: float | None = None,
        rtscts: bool = False,
        exclusive: bool | None = None,
    ) -> None: ...
    @property
    def out_waiting(self) -> int: ...
    def fileno(self) -> int: ...
    def close(self) -> None: ...
