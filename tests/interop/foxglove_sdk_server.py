"""A server of Foxglove's own SDK with one channel and one service; run in the environment of other tools."""

from __future__ import annotations

import json
import sys
import time

import foxglove  # type: ignore[import-not-found] # pyright: ignore[reportMissingImports]

SCHEMA = foxglove.MessageSchema(
    encoding="json", schema=foxglove.Schema(name="any", encoding="jsonschema", data=b'{"type": "object"}')
)


def main() -> None:
    """Serve, print the port, and say something ten times a second until standard input ends."""
    about = foxglove.ServiceSchema(name="any", request=SCHEMA, response=SCHEMA)
    service = foxglove.Service(
        name="/echo",
        schema=about,
        handler=lambda request: json.dumps({"heard": json.loads(request.payload)}).encode(),
    )
    server = foxglove.start_server(
        port=0,
        capabilities=[foxglove.Capability.Services],
        supported_encodings=["json"],
        services=[service],
    )
    channel = foxglove.Channel("/count", schema={"type": "object"})
    sys.stdout.write(f"{server.port}\n")
    sys.stdout.flush()
    for number in range(600):
        channel.log({"number": number})
        time.sleep(0.1)
    server.stop()


if __name__ == "__main__":
    main()
