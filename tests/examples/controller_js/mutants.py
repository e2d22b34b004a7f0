"""Controllers that break one rule each: the example in JavaScript with a few words of its source replaced.

Each line is a rule, what the mutant does instead, and the replacements: text, which stands exactly once in
rules.js or controller.js, and what stands there instead.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class Mutant(NamedTuple):
    """One broken controller."""

    rule: str
    """Its id; `wire conform` must find that it is broken."""
    does: str
    changes: tuple[tuple[str, str], ...]

    def write(self, source: Path, folder: Path) -> None:
        """Write the two files of the mutant.

        Raises:
            AssertionError: a text to be replaced is not there exactly once.
        """
        texts = {name: (source / name).read_text() for name in ("rules.js", "controller.js")}
        for old, new in self.changes:
            (name,) = [name for name, text in texts.items() for _ in range(text.count(old))]
            texts[name] = texts[name].replace(old, new)
        for name, text in texts.items():
            (folder / name).write_text(text)


def _mutant(rule: str, does: str, *changes: str) -> Mutant:
    return Mutant(rule, does, tuple(zip(changes[::2], changes[1::2], strict=True)))


QUICK = ("const SILENCE = 2000,", "const SILENCE = 800,")
"""So that no test waits for long."""
UNHEARD = ("  function say(message) {\n", "  function say(message) {\n    if (!clients.size) return;\n")
"""So that a controller that nobody tries costs nothing."""
RUNS_ON = (
    "    this.robot.hold();\n    this.running = undefined;",
    "    this.running = undefined;",
    "    if (rules.running) {\n",
    "    if (!rules.running) arm.move(passed / 1000);\n    if (rules.running) {\n",
)
"""The arm goes on after the end of its goal."""
ENDS_BEFORE_IT_CHECKS = (
    "    const objection = this.stopped",
    "    this.finish(STATE.CANCELLED, REASON.SUPERSEDED);\n    const objection = this.stopped",
)
STALE = "    if (epoch < this.fence.epoch) return REASON.STALE_EPOCH;\n"
STOPS = "    if (asked.mode === MODE.SAFE_STOP) {"
HEARD = "    if (running && running.holder === 0n && same(running.from, from)) this.heard = this.now;"
GONE = "    if (!this.running || this.running.from.link !== link) return;"
SILENT = "    if (this.running && now - this.heard > SILENCE) {"
KNOWN = "    if (goal || onlyAsks) return this.sayStatus(goal ?? fresh); // no movement"
ADMITS = "    denial ||= this.admit(asked.epoch);"
BY_KEY = "    if (goal && goal === this.running) return this.finish(STATE.CANCELLED, REASON.OPERATOR);"
CANCEL_0 = "other ? REASON.OTHER_LIFE : this.objectionToEpoch(asked.epoch)"
RELEASES = "    return this.ofOtherLife(asked.life) ? REASON.OTHER_LIFE : this.admit(asked.epoch);"
LOWER = "Math.min(asked.epoch, this.fence.epoch)"
CLAIM_EPOCH = "    return this.objectionToEpoch(epoch);\n"
TERM_OVER = "      this.loseClaim(REASON.LINK_SILENT, 'Who commands was not heard any more.');"
RELEASED = "      this.loseClaim(REASON.LINK_SILENT, 'Who commands has released its claim.');"
FREED = "      claim.until = Math.min(claim.until, this.now + GRACE);"
TAKEN = (
    "    if (fresh && this.claim.holder !== 0n) this.loseClaim(...taken);\n",
    "",
    "    if (fresh && this.running && !same(this.running.from, from)) this.finish(STATE.CANCELLED, ...taken);\n",
    "",
)
REACHED = "    if (state === STATE.SUCCEEDED) ended.progress = 1;\n"

MUTANTS = (
    _mutant("introduction", "does not greet", "    rules.greet();\n", ""),
    _mutant("introduction", "greets without MODE", "    this.sayMode();\n    this.sayClaim();\n", ""),
    _mutant("heartbeat", "beats every 2.5 s", "HEARTBEAT_PERIOD = 1000", "HEARTBEAT_PERIOD = 2500"),
    _mutant("mode", "sends MODE every 1.5 s", "MODE_PERIOD = 500", "MODE_PERIOD = 1500"),
    _mutant("mode", "names no silence", "silenceMs: SILENCE", "silenceMs: 0"),
    _mutant(
        "telemetry", "sends it while it moves", "    arm.telemetry(", "    if (rules.running) arm.telemetry("
    ),
    _mutant("life", "sends none", "stops: this.stops, life: this.fence.life", "stops: this.stops"),
    _mutant("claim-status", "sends it every 5 s", "CLAIM_PERIOD = 1000", "CLAIM_PERIOD = 5000"),
    _mutant(
        "several-clients",
        "serves the newest alone",
        "    clients.add(client);",
        "    for (const each of clients) each.destroy();\n    clients.add(client);",
    ),
    _mutant("reaches", "ends with less than 1", REACHED, ""),
    _mutant("reaches", "does not move", "    this.tool = this.from.map(", "    this.from.map("),
    _mutant("reaches", "fails", "rules.finish(STATE.SUCCEEDED)", "rules.finish(STATE.FAILED)"),
    _mutant("progress", "reports none", "PROGRESS_PERIOD = 100", "PROGRESS_PERIOD = 9000"),
    _mutant("progress", "counts nothing", "sequence: (goal.sequence + 1) & 0xffff", "sequence: 1"),
    _mutant("cancel", "answers and goes on", BY_KEY, ""),
    _mutant("cancel", "says so and moves on", *RUNS_ON),
    _mutant("cancel", "gives another reason", BY_KEY, BY_KEY.replace("REASON.OPERATOR", "REASON.NONE")),
    _mutant("hold", "does not know it", "    if (verb === VERB.HOLD) return undefined;\n", ""),
    _mutant(
        "hold",
        "never reaches it",
        "    if (verb !== VERB.GO_TO) return undefined;",
        "    if (verb !== VERB.GO_TO) return (this.seconds = this.left = 1e6);",
    ),
    _mutant(
        "newest",
        "goes on with the older",
        "    const objection = this.stopped",
        "    if (this.running) return this.change(fresh, STATE.REFUSED, REASON.BLOCKED, 'It is busy.');\n"
        "    const objection = this.stopped",
    ),
    _mutant("newest", "gives another reason", "REASON.SUPERSEDED,", "REASON.OPERATOR,"),
    _mutant("unknown-verb", "gives another reason", "[REASON.UNKNOWN_VERB,", "[REASON.BAD_ARGUMENT,"),
    _mutant("unknown-verb", "ends the goal first", *ENDS_BEFORE_IT_CHECKS),
    _mutant(
        "bad-argument",
        "goes there",
        ".every((value) => within(value, -1e3, 1e3))",
        ".every(() => true)",
        "    if (!inside || Math.hypot(",
        "    if (false && Math.hypot(",
    ),
    _mutant("bad-argument", "ends the goal first", *ENDS_BEFORE_IT_CHECKS),
    _mutant(
        "sentence", "gives none", "goal, { state, reason, text, sequence", "goal, { state, reason, sequence"
    ),
    _mutant("time-to-live", "has no end", "? this.now + asked.ttlMs : Infinity", "? Infinity : Infinity"),
    _mutant("time-to-live", "ends at once", "? this.now + asked.ttlMs :", "? this.now :"),
    _mutant("time-to-live", "moves on", *RUNS_ON),
    _mutant(
        "key-repeat", "begins again", KNOWN, KNOWN.replace("goal ||", "(goal && goal === this.running) ||")
    ),
    _mutant(
        "key-nan",
        "compares numbers",
        "    fresh.content = content;",
        "    fresh.content = { equals: (_, args) => args.every((value, i) => value === asked.args[i]) };",
        "goal.content.equals(content)",
        "goal.content.equals(content, asked.args)",
    ),
    _mutant(
        "key-larger-epoch",
        "ignores it",
        "      if (!denial) this.admit(Math.max(",
        "      if (false) this.admit(Math.max(",
    ),
    _mutant(
        "key-reused", "repeats the status", "      if (!goal.content.equals(content))", "      if (false)"
    ),
    _mutant(
        "key-reused",
        "ends its movement",
        "        return this.refuse(fresh, REASON.KEY_REUSED,",
        "        this.finish(STATE.CANCELLED), this.refuse(fresh, REASON.KEY_REUSED,",
    ),
    _mutant(
        "key-question",
        "keeps its key",
        KNOWN,
        "    if (onlyAsks) this.store(this.never, fresh, CANCELS);\n" + KNOWN,
    ),
    _mutant("key-question", "refuses it", KNOWN, KNOWN.replace("goal || onlyAsks", "goal")),
    _mutant(
        "key-cancelled",
        "forgets it",
        "    if (!goal) this.store(this.never, fresh, CANCELS);",
        "    if (!goal);",
    ),
    _mutant("key-of-sender", "knows keys alone", "`${peer.system}/${peer.component}/${key}`", "`${key}`"),
    _mutant(
        "key-zero",
        "begins it",
        "    if (asked.key === 0n) return this.refuse(",
        "    if (false) return this.refuse(",
    ),
    _mutant("keys-kept", "keeps 200", "const GOALS = 256", "const GOALS = 200"),
    _mutant(
        "keys-kept",
        "keeps no refused ones",
        "    this.store(this.goals, fresh, GOALS);\n",
        "",
        "    this.running = fresh;\n",
        "    this.store(this.goals, fresh, GOALS);\n    this.running = fresh;\n",
    ),
    _mutant("epoch-stale", "obeys it", STALE, ""),
    _mutant(
        "epoch-stale",
        "keeps its key",
        ADMITS,
        f"{ADMITS}\n    if (denial) this.store(this.never, fresh, CANCELS);",
    ),
    _mutant("epoch-late", "obeys it", "    return epoch > limit ? REASON.BAD_EPOCH : 0;", "    return 0;"),
    _mutant("epoch-late", "obeys it in a goal", ADMITS, ADMITS.replace("asked.epoch", LOWER)),
    _mutant("epoch-late", "obeys it in a cancel", CANCEL_0, CANCEL_0.replace("asked.epoch", LOWER)),
    _mutant("epoch-late", "obeys it in a release", RELEASES, RELEASES.replace("asked.epoch", LOWER)),
    _mutant(
        "epoch-late",
        "obeys it in a claim",
        CLAIM_EPOCH,
        "    return epoch < this.fence.epoch ? REASON.STALE_EPOCH : 0;\n",
    ),
    _mutant(
        "epoch-of-cancel",
        "wants one that is not stale",
        BY_KEY,
        BY_KEY.replace("if (goal", "if (!this.objectionToEpoch(asked.epoch) && goal"),
    ),
    _mutant(
        "epoch-of-cancel",
        "refuses a stale repetition",
        KNOWN,
        "    if (goal && this.objectionToEpoch(asked.epoch)) return this.refuse(fresh, REASON.STALE_EPOCH);\n"
        + KNOWN,
    ),
    _mutant("epoch-of-cancel-0", "obeys any", CANCEL_0, "other ? REASON.OTHER_LIFE : 0"),
    _mutant(
        "epoch-told",
        "not in MODE",
        "timeBootMs: this.now >>> 0, epoch: this.fence.epoch,",
        "timeBootMs: this.now >>> 0,",
    ),
    _mutant("epoch-told", "not in a status", "key, epoch: this.fence.epoch, progress", "key, progress"),
    _mutant(
        "stop",
        "wants an epoch",
        STOPS,
        "    if (asked.mode === MODE.SAFE_STOP && !this.objectionToEpoch(asked.epoch)) {",
    ),
    _mutant(
        "stop",
        "wants the commander",
        STOPS,
        "    if (asked.mode === MODE.SAFE_STOP && (!this.running || same(this.running.from, from))) {",
    ),
    _mutant("stop", "gives another reason", "REASON.STOPPED, 'A safe", "REASON.OPERATOR, 'A safe"),
    _mutant(
        "stop", "moves on", *RUNS_ON, "      this.robot.hold();\n      this.finish(", "      this.finish("
    ),
    _mutant("stop-broadcast", "does not listen", "const forAll = system === 0 &&", "const forAll = false &&"),
    _mutant(
        "stop-goals",
        "begins them",
        "const objection = this.stopped ? stopped :",
        "const objection = false ? stopped :",
    ),
    _mutant(
        "stop-goals",
        "goes on after the release",
        "      this.stopped = true;\n      this.robot.hold();\n",
        "      this.stopped = true;\n      this.paused = this.running;\n",
        "    this.robot.hold();\n    this.running = undefined;",
        "    this.running = undefined;",
        "    if (!refusal) this.stopped = this.silent = false;",
        "    if (!refusal) [this.stopped, this.running, this.paused] = [false, this.paused, undefined];",
    ),
    _mutant("stop-release", "obeys any", RELEASES, "    return 0;"),
    _mutant(
        "stop-other-mode",
        "takes each for READY",
        "    if (asked.mode !== MODE.READY) return REASON.BAD_ARGUMENT;\n",
        "",
    ),
    _mutant("stops-counted", "counts nothing", "      this.stops += this.stopped ? 0 : 1;\n", ""),
    _mutant("stop-later", "ends any stop", "    if (older) return REASON.STOPPED;\n", ""),
    _mutant("silence", "does not watch", SILENT, "    if (false) {"),
    _mutant("silence", "hears anybody", HEARD, "    if (running) this.heard = this.now;"),
    _mutant("silence", "holds too early", SILENT, SILENT.replace("SILENCE", "SILENCE / 2")),
    _mutant("silence", "moves on", *RUNS_ON),
    _mutant(
        "silence",
        "stays READY",
        "      this.finish(STATE.CANCELLED, REASON.LINK_SILENT, 'Nobody was heard for 2 s.');\n      this.silent = true;",
        "      this.finish(STATE.CANCELLED, REASON.LINK_SILENT, 'Nobody was heard for 2 s.');",
    ),
    _mutant("silence-ended", "stays in HOLD", "    this.silent = false;\n    this.heard", "    this.heard"),
    _mutant("silence-heard", "counts goals alone", HEARD, ""),
    _mutant("silence-idle", "watches always", SILENT, "    if (now - this.heard > SILENCE) {"),
    _mutant("link-end", "waits for the silence", GONE, "    return;"),
    _mutant("link-other", "ends with any", GONE, "    if (!this.running) return;"),
    _mutant("link-namesake", "knows ids alone", "a.link === b.link && a.system", "a.system"),
    _mutant("link-namesake", "goes on hearing the first link", "      goal.from = from;\n", ""),
    _mutant("life-of-goal", "begins it", "    if (!goal && this.ofOtherLife(asked.life))", "    if (false)"),
    _mutant(
        "life-of-goal",
        "keeps its key",
        "      return this.sayStatus({ ...fresh, reason: REASON.OTHER_LIFE });",
        "      return this.store(this.never, fresh, CANCELS), this.sayStatus({ ...fresh, reason: REASON.OTHER_LIFE });",
    ),
    _mutant("life-of-release", "obeys the release", RELEASES, "    return this.admit(asked.epoch);"),
    _mutant(
        "life-of-release",
        "obeys the claim",
        "    if (this.ofOtherLife(life)) return REASON.OTHER_LIFE;\n",
        "",
    ),
    _mutant("life-of-release", "obeys the cancel", CANCEL_0, "this.objectionToEpoch(asked.epoch)"),
    _mutant(
        "life-of-cancel", "obeys its own alone", BY_KEY, BY_KEY.replace("if (goal", "if (!other && goal")
    ),
    _mutant("claim", "grants none", CLAIM_EPOCH, "    return REASON.NOT_IN_CONTROL;\n"),
    _mutant(
        "claim",
        "obeys no larger epoch",
        "highest = Math.max(epoch, this.fence.epoch)",
        "highest = this.fence.epoch",
    ),
    _mutant("claim", "names no ids", "holderSystem: there ? peer.system : 0", "holderSystem: 0"),
    _mutant(
        "claim",
        "wants a larger one each time",
        "    if (this.claim.holder === holder && epoch <= this.fence.epoch) return 0;\n",
        "",
        "epoch === this.fence.epoch && holder !== this.fence.holder",
        "epoch === this.fence.epoch",
    ),
    _mutant(
        "claim-second",
        "grants it",
        "    if (held && wish !== WISH.TAKE_OVER) return REASON.NOT_IN_CONTROL;\n",
        "",
    ),
    _mutant("claim-second", "names nobody", "        holder, termMs: term,", "        termMs: term,"),
    _mutant("claim-goals", "obeys all goals", "    let denial = this.denial(from);", "    let denial = 0;"),
    _mutant(
        "claim-goals", "obeys all releases", "    if (this.denial(from)) return this.denial(from);\n", ""
    ),
    _mutant("claim-goals", "counts their epochs", ADMITS, "    denial = this.admit(asked.epoch) || denial;"),
    _mutant(
        "claim-stop",
        "obeys the holder's",
        STOPS,
        "    if (asked.mode === MODE.SAFE_STOP && !this.denial(from)) {",
    ),
    _mutant(
        "claim-epoch", "grants it", "epoch === this.fence.epoch && holder !== this.fence.holder", "false"
    ),
    _mutant("claim-take-over", "refuses it", "    if (held && wish !== WISH.TAKE_OVER)", "    if (held)"),
    _mutant(
        "claim-take-over",
        "grants it with an old epoch",
        "epoch === this.fence.epoch && holder !== this.fence.holder",
        "wish !== WISH.TAKE_OVER && epoch === this.fence.epoch && holder !== this.fence.holder",
    ),
    _mutant("claim-take-over", "goes on with the movement", *TAKEN),
    _mutant("claim-release", "stays held", f"{RELEASED}\n", ""),
    _mutant("claim-release", "goes on with the movement", RELEASED, "      this.claim.holder = 0n;"),
    _mutant("claim-term", "has no end", "until: this.now + term }", "until: Infinity }"),
    _mutant("claim-term", "goes on with the movement", TERM_OVER, "      this.claim.holder = 0n;"),
    _mutant("claim-heard", "hears any message", HEARD, HEARD.replace("running.holder === 0n && ", "")),
    _mutant(
        "claim-heard",
        "does not hear the claim",
        "      Object.assign(this.running, { holder, from });\n      this.heard = this.now;",
        "      Object.assign(this.running, { holder, from });",
    ),
    _mutant("claim-malformed", "takes holder 0", "if (holder === 0n || !", "if (!"),
    _mutant(
        "claim-malformed",
        "takes any wish",
        "[WISH.KEEP, WISH.TAKE_OVER, WISH.RELEASE].includes(wish)",
        "true",
    ),
    _mutant("claim-link", "frees it at once", FREED, "      claim.until = this.now;"),
    _mutant("claim-link", "frees it with its term", FREED, ""),
    _mutant(
        "target",
        "hears all",
        "    if (!forAll && (system !== SYSTEM ||",
        "    if (false && (system !== SYSTEM ||",
    ),
    _mutant(
        "noise",
        "checks no checksum",
        "client.pipe(new MavLinkPacketSplitter(",
        "client.pipe(new (class extends MavLinkPacketSplitter { validatePacket() { return 0; } })(",
    ),
    _mutant(
        "noise",
        "hangs up",
        "{ magicNumbers: wire.MAGIC_NUMBERS }",
        "{ magicNumbers: wire.MAGIC_NUMBERS, onCrcError: () => client.destroy() }",
    ),
)
"""All of them, in the order of the rules."""
