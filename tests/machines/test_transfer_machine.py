"""Two hosts, a robot that moves between them, and everything that a network and a power supply can do."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, precondition, rule

from robotree.vr.core import transfer as of

HOSTS = ("here", "there")


class Host:
    """One host: what its log says, and what its present process knows."""

    def __init__(self) -> None:
        self.owns = False
        self.out = ""
        """The transfer under which it has let the robot go, and waits for word."""
        self.target = ""
        self.taken: dict[str, None] = {}
        self.never: dict[str, None] = {}
        self.start()

    def start(self) -> None:
        """Begin another process, which knows what the log says."""
        self.lives = True
        self.destination = of.Destination(self.taken, self.never)
        self.leaving = of.Departing("out") if self.out else None
        self.transfer = self.out
        self.asks: list[of.SourceEffect] = list(self.leaving.begins) if self.leaving else []

    @property
    def acts(self) -> bool:
        """Whether the robot's code may run in it."""
        leaves = self.leaving is not None and self.leaving.phase == "out"
        return self.lives and self.owns and not leaves


class Transfers(RuleBasedStateMachine):
    """Messages are lost, come twice, late and in any order; each process may end between any two acts."""

    messages = Bundle("messages")

    def __init__(self) -> None:
        super().__init__()
        self.hosts = {name: Host() for name in HOSTS}
        self.hosts["here"].owns = True
        self.sent: list[tuple[str, str, str, str, Any]] = []
        self.number = 0

    def post(self, sender: str, to: str, what: str, transfer: str, value: Any = None) -> None:
        self.sent.append((sender, to, what, transfer, value))

    def do(self, name: str, effects: list[of.SourceEffect]) -> None:
        """Carry out what a source decides; the log is written before anything leaves."""
        host = self.hosts[name]
        for effect in effects:
            match effect:
                case of.WriteOut():
                    host.out = host.transfer
                case of.Send():
                    self.post(name, host.target, "take", host.transfer)
                case of.AskOther():
                    self.post(name, host.target, "ask", host.transfer)
                case of.WriteBack():
                    host.out = ""
                case of.Thaw():
                    host.leaving = None
                case of.LeaveHere():
                    host.out, host.owns, host.leaving = "", False, None
                case _:
                    pass

    @rule(name=st.sampled_from(HOSTS), stops=st.booleans())
    def begin(self, name: str, *, stops: bool) -> None:
        host = self.hosts[name]
        if not host.acts or host.leaving is not None:
            return
        self.number += 1
        host.transfer, host.target = f"t{self.number}", HOSTS[name == "here"]
        host.leaving = of.Departing()
        self.post(name, host.target, "prepare", host.transfer)
        if stops:
            self.do(name, host.leaving.handle(of.StopCame(reason="test")))

    @rule(name=st.sampled_from(HOSTS))
    def send(self, name: str) -> None:
        """Nothing is in the way until the robot is on its way."""
        before = len(self.sent)
        self.begin(name, stops=False)
        while len(self.sent) > before:
            self.deliver(self.sent.pop())
        self.go_on_leaving(name)
        self.go_on_leaving(name)

    @precondition(lambda self: self.sent)
    @rule(data=st.data(), keep=st.booleans())
    def arrive(self, data: st.DataObject, *, keep: bool) -> None:
        at = data.draw(st.integers(0, len(self.sent) - 1))
        message = self.sent[at] if keep else self.sent.pop(at)
        self.deliver(message)

    def deliver(self, message: tuple[str, str, str, str, Any]) -> None:  # noqa: C901 # one for each
        sender, to, what, transfer, value = message
        host = self.hosts[to]
        if not host.lives:
            return
        if what == "prepare":
            if not host.owns and host.destination.prepare(transfer):
                self.post(to, sender, "ready", transfer)
        elif what in {"take", "ask"}:
            for effect in getattr(host.destination, what)(transfer):
                match effect:
                    case of.WriteTaken():
                        assert not host.owns, "it had the robot already"
                        host.taken[transfer], host.owns = None, True
                    case of.WriteNever():
                        host.never[transfer] = None
                    case of.SayDecision(taken=taken):
                        self.post(to, sender, "decided", transfer, taken)
                    case _:
                        pass
        elif host.leaving is not None and host.transfer == transfer:
            if what == "ready":
                self.do(to, host.leaving.handle(of.DestinationReady(log="log")))
            else:
                self.do(to, host.leaving.handle(of.WordCame(taken=value)))

    @precondition(lambda self: self.sent)
    @rule(data=st.data())
    def lose(self, data: st.DataObject) -> None:
        self.sent.pop(data.draw(st.integers(0, len(self.sent) - 1)))

    @rule(name=st.sampled_from(HOSTS))
    def hear_nothing(self, name: str) -> None:
        host = self.hosts[name]
        if host.lives and host.leaving is not None:
            if host.leaving.phase == "preparing":
                self.do(name, host.leaving.handle(of.Refused(reason="no answer")))
            else:
                self.do(name, host.leaving.handle(of.NoWord()))

    @rule(name=st.sampled_from(HOSTS))
    def go_on_leaving(self, name: str) -> None:
        """It is written, and then still."""
        host = self.hosts[name]
        if host.lives and host.leaving is not None:
            events = {"writing": of.OutWritten(), "freezing": of.Still()}
            if host.leaving.phase in events:
                self.do(name, host.leaving.handle(events[host.leaving.phase]))

    @rule(name=st.sampled_from(HOSTS))
    def stop(self, name: str) -> None:
        host = self.hosts[name]
        if host.lives and host.leaving is not None:
            self.do(name, host.leaving.handle(of.StopCame(reason="test")))

    @rule(name=st.sampled_from(HOSTS))
    def kill(self, name: str) -> None:
        self.hosts[name].lives = False

    @rule(name=st.sampled_from(HOSTS))
    def start(self, name: str) -> None:
        if not self.hosts[name].lives:
            self.hosts[name].start()

    @invariant()
    def at_most_one_acts(self) -> None:
        assert sum(host.acts for host in self.hosts.values()) <= 1

    @invariant()
    def nothing_is_forgotten(self) -> None:
        """Somebody has it: by its log, or waits for word of it."""
        assert any(host.owns for host in self.hosts.values())

    def teardown(self) -> None:
        """Let everything live and every message arrive: then exactly one has it."""
        for host in self.hosts.values():
            if not host.lives:
                host.start()
        for _ in range(20):
            for name in HOSTS:
                self.go_on_leaving(name)
                self.hear_nothing(name)
            messages, self.sent = self.sent, []
            for message in messages:
                self.deliver(message)
        assert sum(host.acts for host in self.hosts.values()) == 1
        assert not any(host.out for host in self.hosts.values())


Transfers.TestCase.settings = settings(max_examples=80, stateful_step_count=60, deadline=None)
test_of_two_hosts_exactly_one_has_the_robot = Transfers.TestCase
