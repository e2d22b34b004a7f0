"""MAVSDK for a test: reads one request a line as JSON, does it with the real library, prints one answer.

Runs in the environment of the tools, not in ours:

    python mavsdk_client.py tcpout://127.0.0.1:5760 robotree.xml

A request is `[PLUGIN, METHOD, ARGUMENT, …]`. The answer, behind the word `answer`, is what the method
returned, or `{"error": NAME}` with the name of MAVSDK's result. The message methods of `direct` take a
message as an object: `{"name": …, "fields": {…}}`; `["direct", "next", NAME]` waits for the next one with
that name.
"""

from __future__ import annotations

import json
import os
import queue
import sys
from pathlib import Path
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk, MavsdkError, System, log_subscribe
from mavsdk.plugins.action import Action
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.gripper import Gripper
from mavsdk.plugins.info import Info
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param

PATIENCE = 10.0
"""[s] for the first heartbeat, and for a message."""


class Direct:
    """MAVSDK's way to messages that it does not know: by a dialect's XML.

    Args:
        system: the robot.
        xml: our dialect.
    """

    def __init__(self, system: System, xml: str) -> None:
        self._system, self._plugin = system, MavlinkDirect(system)
        self._plugin.load_custom_xml(xml)

    def next(self, name: str) -> dict[str, Any]:
        """The next message with a name."""
        heard: queue.Queue[dict[str, Any]] = queue.Queue()
        handle = self._plugin.subscribe_message(name, lambda told, _: heard.put(json.loads(told.fields_json)))
        try:
            return heard.get(timeout=PATIENCE)
        finally:
            self._plugin.unsubscribe_message(handle)

    def send_message(self, message: dict[str, Any]) -> None:
        """Send a message."""
        self._plugin.send_message(self._made(message))

    def send_command(self, message: dict[str, Any]) -> dict[str, Any]:
        """Send a command and wait for its end; returns the last COMMAND_ACK."""
        answer = self._plugin.send_command(self._made(message))
        return json.loads(answer.fields_json)

    def _made(self, message: dict[str, Any]) -> MavlinkMessage:
        target = {"target_system": self._system.get_system_id(), "target_component": 1}
        fields = {**target, **message["fields"]}
        return MavlinkMessage(message["name"], 0, 0, *target.values(), json.dumps(fields))


class Metadata:
    """What MAVSDK knows of a component, by its files.

    Args:
        system: the robot.
    """

    def __init__(self, system: System) -> None:
        self._plugin = ComponentMetadata(system)

    def parameters(self) -> dict[str, Any]:
        """The file of the parameters, which it fetches as a ground station does."""
        heard: queue.Queue[tuple[int, str]] = queue.Queue()
        self._plugin.subscribe_metadata_available(lambda told, _: heard.put((told.type, told.json_metadata)))
        self._plugin.request_autopilot_component()
        told: dict[int, str] = {}
        while MetadataType.ALL_COMPLETED not in told:
            told.update([heard.get(timeout=PATIENCE)])
        return json.loads(told[MetadataType.PARAMETER])


def plain(value: Any) -> Any:
    """A value of MAVSDK as JSON knows it."""
    if isinstance(value, list):
        return [plain(each) for each in value]
    if hasattr(value, "__dict__") and not isinstance(value, int):
        return {name: plain(each) for name, each in vars(value).items()}
    return value


def say(line: str) -> None:
    """Print a line in one piece: the library speaks in threads of its own."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def tell(answer: Any) -> None:
    """Answer a request."""
    say(f"answer {json.dumps(answer)}")


def log(_: object, message: str, *__: object) -> bool:
    """Print what the library has to say; True: it need not do so itself."""
    say(f"log {message}")
    return True


def main() -> None:
    """Connect, then do what is asked until the input ends."""
    log_subscribe(log)
    url, xml = sys.argv[1], Path(sys.argv[2]).read_text(encoding="utf-8")
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    tell({"connected": mavsdk.add_any_connection(url).name})
    system = mavsdk.first_autopilot(PATIENCE)
    if system is None:
        tell({"error": "NO_AUTOPILOT"})
        return
    plugins = {each.__name__.lower(): each(system) for each in (Action, Ftp, Gripper, Info, Param)}
    plugins["metadata"] = Metadata(system)
    plugins["direct"] = Direct(system, xml)
    tell({"system": system.get_system_id()})
    for line in sys.stdin:
        plugin, method, *arguments = json.loads(line)
        try:
            answer = plain(getattr(plugins[plugin], method)(*arguments))
        except MavsdkError as error:
            answer = {"error": error.result.name}
        except queue.Empty:
            answer = {"error": "NOTHING_HEARD"}
        tell(answer)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # the library's threads may crash a normal end
