from collections.abc import Collection

PROTOCOL_1_0: str
PROTOCOL_2_0: str

class MAVParseError(Exception): ...

class MAVField:
    name: str
    type: str
    array_length: int
    wire_offset: int
    wire_length: int
    enum: str
    units: str
    description: str
    invalid: str
    const_value: int | None

class MAVType:
    name: str
    id: int
    description: str
    fields: list[MAVField]
    ordered_fields: list[MAVField]
    extensions_start: int | None
    crc_extra: int
    wire_length: int
    wire_min_length: int
    message_flags: int
    target_system_ofs: int
    target_component_ofs: int

class MAVEnumParam:
    index: str | int
    label: str
    units: str
    description: str

class MAVEnumEntry:
    name: str
    value: int
    description: str
    end_marker: bool
    param: Collection[MAVEnumParam]

class MAVEnum:
    name: str
    description: str
    entry: list[MAVEnumEntry]
    bitmask: bool

class MAVXML:
    def __init__(self, filename: str, wire_protocol_version: str = ...) -> None: ...
    filename: str
    include: list[str]
    message: list[MAVType]
    enum: list[MAVEnum]

def check_duplicates(xml: list[MAVXML]) -> bool: ...
def check_missing_enum(xml: list[MAVXML]) -> bool: ...
