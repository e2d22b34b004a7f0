"""Figure 4 of the NBSA paper as one story: script, service interface, robot and user.

"Coordinator agents receive messages …, the engine checks the rules inside the script and sends back the
corresponding message or invokes the native commands. … With the same coordination script, behaviours of each
partner may be changed by accessing the service interface agent. … After changing the role of each partner,
the system will behave differently without changing the main coordination script."
"""

from __future__ import annotations

from robotree.vr import Robot, command
from robotree.vr.scripts.roles.profile import Profile, read_profile
from tests.vr.scripts.stage import Stage

COORDINATION = """
script: coordination
doc: Greets whoever the service recognises in a picture, and tells the service how.
partners:
  robot: {kind: Companion, needs: [say, go_to]}
  service: {kind: Recognition, needs: [identify, remember]}
hears:
  picture: {shows: text}
rules:
  - rule: ask-the-service
    when: [picture: {shows: $what}]
    then:
      - do: service.identify
        with: {picture: $what}
  - rule: somebody-is-known
    when: [done: {partner: service, act: identify, result: $who}]
    then:
      - do: robot.say
        with: {text: "Welcome, $who"}
        as: $who
  - rule: nobody-is-known
    when: [failed: {partner: service, act: identify, reason: $why}]
    then: [do: [robot, go_to, hall]]
  - rule: tell-the-service
    when: [done: {partner: robot, act: say, result: $said, conversation: $who}]
    then:
      - do: service.remember
        with: {who: $who, greeted: $said}
"""
WAITER = "role: waiter\nmanner: {voice: man-2}\nwords:\n  Welcome: Your table is ready\n"


class Recognition(Robot):
    """A service on another machine, as far as a script sees it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.knows, self.remembered = {"face-1": "Anna"}, list[tuple[str, str]]()

    @command(effect="read")
    def identify(self, picture: str) -> str:
        """Say who is in a picture."""
        if picture not in self.knows:
            raise ValueError("nobody whom I know")
        return self.knows[picture]

    @command
    def remember(self, who: str, greeted: str) -> None:
        """Learn how somebody was greeted."""
        self.remembered.append((who, greeted))


async def test_one_script_coordinates_robot_and_service_and_a_role_changes_what_it_does(stage: Stage) -> None:
    robot, service = await stage.companion(), Recognition("recognition")
    await stage.start(service)
    script = await stage.script(COORDINATION, "coordination")
    await stage.enslave("coordination", "robot", "c1")
    await stage.enslave("coordination", "service", "recognition")
    before = script.program.hash
    running = stage.begin("coordination")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 3)

    # a message comes in; the rules ask the service, and its answer becomes a native command of the robot
    await stage.call("coordination", "picture", shows="face-1")
    await stage.until(lambda: service.remembered == [("Anna", "Welcome, Anna")])
    assert robot.done == ["say Welcome, Anna [plain]"]

    # a failure of the service is another message, and another rule acts
    await stage.call("coordination", "picture", shows="face-9")
    await stage.until(lambda: robot.done[1:] == ["go_to hall at 0.5"])

    # the user chooses a role at the interface of the script: the script is the same, what happens is not
    role: Profile = read_profile(WAITER, "waiter.yaml")
    assert role.name == "waiter"
    await stage.call("coordination", "learn_role", source=WAITER, at="robot")
    await stage.call("coordination", "play", role="waiter", at="robot")
    await stage.call("coordination", "picture", shows="face-1")
    await stage.until(lambda: len(service.remembered) == 2)
    assert robot.done[2] == "say Your table is ready, Anna [man-2]"
    assert service.remembered[1] == ("Anna", "Your table is ready, Anna")
    assert script.program.hash == before

    # what has happened can be asked for: which rule, because of which fact
    assert "somebody-is-known" in await stage.call("coordination", "why")
    await stage.call("coordination", "finish")
    assert await running == "finished on request"
