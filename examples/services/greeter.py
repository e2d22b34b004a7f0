"""Greeter: the simplest service. It counts words; its behaviour greets visitors.

Start: `robotree service examples/services/greeter.py greeter`.
"""

from typing import ClassVar

from robotree.vr import Service, Stream, Watch, command, state

GREET = """
script: greet
start: {itself: yes}
partners:
  robot: {kind: Companion, needs: [say]}
hears: {visitor: {who: text}}
rules:
  - rule: greet
    when:
      - visitor: {who: $who}
    then:
      - do: robot.say
        with: {text: "Welcome, $who"}
"""


class Greeter(Service):
    """Counts words, and greets."""

    companion = Watch("Companion", "who is listened to", optional=True)
    counted = Stream(int, "words so far")
    behaviours: ClassVar = {"greet": GREET}
    lends: ClassVar = {"porter": "role: porter\ninherits: butler\nwords: {Welcome: Welcome to our house}\n"}
    words: int = state(0)

    @command
    def count(self, text: str) -> int:
        """Count the words of a text, and tell those who listen."""
        self.words += len(text.split())
        self.counted.send(self.words)
        return self.words
