supportedLanguages: list[str]

class Opts:
    def __init__(
        self,
        output: str,
        wire_protocol: str = ...,
        language: str = ...,
        validate: bool = ...,
        strict_units: bool = ...,
    ) -> None: ...

def mavgen(opts: Opts, args: list[str]) -> bool: ...
