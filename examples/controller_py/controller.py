"""The controller of a rover on one page: pymavlink has the messages, and these are the rules that matter.

robotree wire dialect --lang python rover_wire.py; python controller.py 5763     (ready tcp:127.0.0.1:5763)
One client at a time. Put your motors where it says MOTOR; metres along x (forward) and y (left), seconds.
keys.py decides who may speak, memory.py keeps what must outlive a restart.
"""
import argparse, contextlib, math, select, socket, struct, time
from types import SimpleNamespace as Record
from keys import Keys, key_of
from memory import Memory, complain
import rover_wire as m

SILENCE, UNKNOWN, TICK, ARENA, SLOWEST = 2.0, 5.0, 0.02, 1.5, 0.009999999  # a float32 of 0.01 is above it
LATEST, LAST_EPOCH, LEASES = 4102444800, 2**32 - 2**20, 2**10  # the year 2100: it takes no clock for granted
ACTIVE, SUCCEEDED, REFUSED, CANCELLED, EXPIRED = 2, 3, 4, 6, 7  # ROBOTREE_GOAL_STATE
wire, goals = m.MAVLink(None, srcSystem=1, srcComponent=1), {}  # goals by sender and key
me = Record(link=None, goal=None, stopped=False, silent=False, stops=1, heard=0.0)
rover = Record(at=(0.0, 0.0), v=(0.0, 0.0), to=(0.0, 0.0), speed=0.4)
now, boot_ms = time.monotonic, lambda: int(time.monotonic() * 1e3) & 0xFFFFFFFF
why = lambda name: getattr(m, "ROBOTREE_REASON_" + name)

def say(message):
    if keys: wire.signing.timestamp = keys.next()
    if me.link and me.link.fileno() >= 0: me.link.sendall(message.pack(wire))

def say_mode(refusal=""):
    mode = 4 if me.stopped else 2 if me.goal else 3 if me.silent else 1  # ROBOTREE_MODE_KIND
    reason = why(refusal or {4: "OPERATOR", 3: "LINK_SILENT"}.get(mode, "NONE"))
    say(m.MAVLink_heartbeat_message(m.MAV_TYPE_GROUND_ROVER, 0, 1 if me.stopped else 129, mode, 4, 3))
    say(m.MAVLink_robotree_mode_message(boot_ms(), memory.epoch, int(SILENCE * 1e3), mode, reason, me.stops))

def objection(epoch):
    late = epoch > max(memory.epoch, min(max(memory.epoch + LEASES, LATEST), LAST_EPOCH))  # later than an honest clock explains
    return "STALE_EPOCH" if epoch < memory.epoch else "BAD_EPOCH" if late else ""

def tell(g, state=None, reason=0):
    if state: g.state, g.reason, g.sequence = state, reason, g.sequence + 1 & 0xFFFF
    said = g.key, memory.epoch, g.progress if g.state == ACTIVE else float(g.state == SUCCEEDED), g.sequence, g.reason, *g.sender, g.state
    say(m.MAVLink_robotree_goal_status_message(*said))

def end(state, reason=0):
    goal, me.goal, rover.v = me.goal, None, (0.0, 0.0)  # MOTOR: stand still
    me.silent = me.silent or (goal is not None and reason == why("LINK_SILENT"))
    if goal: tell(goal, state, reason)

def on_goal(asked, sender):
    goal, content = goals.get((*sender, asked.key)), struct.pack("<H7f", asked.verb, *asked.args)  # to the bit
    fresh = Record(key=asked.key, sender=sender, content=content, state=0, reason=0, sequence=0, progress=0.0)
    if asked.verb == m.ROBOTREE_VERB_STATUS or (goal and goal.content in (content, "cancelled")):
        if goal and goal.content == content and not objection(asked.epoch): memory.obey(asked.epoch)
        return tell(goal or fresh)  # a question, a repetition, or cancelled before it came: nothing moves
    if denial := "KEY_REUSED" if goal else objection(asked.epoch) if asked.key else "BAD_ARGUMENT":
        return tell(fresh, REFUSED, why(denial))  # and not kept
    memory.obey(asked.epoch)
    goals[(*sender, asked.key)] = fresh
    dx, dy, speed = (0.0, 0.0, math.nan) if asked.verb == m.ROBOTREE_VERB_HOLD else asked.args[:3]
    to, known = (rover.at[0] + dx, rover.at[1] + dy), asked.verb in (m.ROBOTREE_VERB_MOVE, m.ROBOTREE_VERB_HOLD)
    bad = not math.isfinite(dx + dy) or speed < SLOWEST or speed > 1.0  # NaN, the usual speed, is neither
    for reason, holds in {"STOPPED": me.stopped, "UNKNOWN_VERB": not known, "BAD_ARGUMENT": bad,
                          "OUT_OF_REACH": max(map(abs, to)) > ARENA}.items():
        if holds: return tell(fresh, REFUSED, why(reason))
    end(CANCELLED, why("SUPERSEDED"))
    me.goal, me.silent, me.heard, fresh.deadline = fresh, False, now(), now() + (asked.ttl_ms / 1e3 or math.inf)
    rover.to, rover.speed, rover.way = to, 0.4 if math.isnan(speed) else speed, math.dist(to, rover.at)
    tell(fresh, ACTIVE)

def hear(said, sender, kind):
    if me.goal and sender == me.goal.sender: me.heard = now()  # only who commands keeps its movement alive
    if kind == "ROBOTREE_GOAL" and said.target_system == 1: on_goal(said, sender)
    if kind == "ROBOTREE_GOAL_CANCEL" and said.target_system == 1:
        early = Record(key=said.key, sender=sender, content="cancelled", state=0, reason=0, sequence=0, progress=0.0)
        goal = goals.setdefault((*sender, said.key), early) if said.key else me.goal
        if not said.key and objection(said.epoch): return tell(early, REFUSED, why(objection(said.epoch)))
        end(CANCELLED, why("OPERATOR")) if goal and goal is me.goal else tell(goal or early)
    if kind == "ROBOTREE_SET_MODE" and said.target_system in (0, 1):
        older = me.stopped and said.stops not in (0, me.stops)  # its sender saw an older stop
        wrong = "" if said.mode == m.ROBOTREE_MODE_KIND_READY else "BAD_ARGUMENT"
        refusal = wrong or ("STOPPED" if older else objection(said.epoch))
        if stop := said.mode == m.ROBOTREE_MODE_KIND_SAFE_STOP:  # from anyone, under any epoch
            me.stops, me.stopped = me.stops + (not me.stopped), True
            end(CANCELLED, why("STOPPED"))
        elif not refusal: me.stopped, me.silent = False, bool(memory.obey(said.epoch))
        say_mode("" if stop else refusal)

def tick(dt):
    if me.goal and now() - me.heard > SILENCE: end(CANCELLED, why("LINK_SILENT"))
    if me.goal and now() >= me.goal.deadline: end(EXPIRED)
    if me.goal:  # MOTOR: one step straight towards the goal
        part = min(rover.speed * dt / (math.dist(rover.to, rover.at) or math.inf), 1.0)
        rover.v = tuple(part * (b - a) / dt for a, b in zip(rover.at, rover.to))
        rover.at = tuple(a + v * dt for a, v in zip(rover.at, rover.v))
        me.goal.progress = 1 - math.dist(rover.to, rover.at) / (rover.way or math.inf)
        if math.dist(rover.to, rover.at) < 1e-9: end(SUCCEEDED)
    say(m.MAVLink_local_position_ned_message(boot_ms(), rover.at[0], -rover.at[1], 0, rover.v[0], -rover.v[1], 0))

def refuse(said, reason, told):
    return told or complain(f"refused: a frame of {said.get_srcSystem()} {reason}") or True

def serve(last=0.0, due=0.0, refused=False):
    me.link.settimeout(TICK)
    known = now()
    parser = m.MAVLink(None); parser.robust_parsing = True
    while (data := me.link.recv(4096) if select.select([me.link], [], [], TICK)[0] else None) != b"":
        for said in parser.parse_buffer(data or b"") or []:
            if keys and (reason := keys.objection(bytes(said.get_msgbuf()))): refused = refuse(said, reason, refused)
            else: known = hear(said, (said.get_srcSystem(), said.get_srcComponent()), said.get_type()) or now()
        if keys and now() - known > UNKNOWN: return  # who has no key must not occupy its only place
        if now() - last >= TICK: last = tick(min(now() - last, 0.1)) or now()  # no jump after a pause
        if now() >= due:
            if me.goal: tell(me.goal, ACTIVE)
            if keys: keys.tick()
            due = say_mode() or now() + 0.1

line = argparse.ArgumentParser(prog="controller.py", description="The controller of a rover.")
line.add_argument("port", type=int, help="of 127.0.0.1; 0: any that is free")
line.add_argument("--memory", default="", help="a file; it remembers there, and in FILE.copy, what must outlive a restart")
line.add_argument("--reset-epoch", action="store_true", help="forget the leases; needed at the first start")
line.add_argument("--key", help="a key file: obey only who has the key; needs --memory, or a restart would make recordings valid")
line.add_argument("--name", help="of the controller, which its key is derived from; else tcp:127.0.0.1:PORT")
given = line.parse_args()
if given.key and not given.memory: line.error("--key needs --memory")
listener = socket.create_server(("127.0.0.1", given.port))
url, memory, keys = f"tcp:127.0.0.1:{listener.getsockname()[1]}", Memory(given.memory, given.reset_epoch), None
if given.key:
    keys = Keys(key_of(given.key, given.name or url), memory)
    wire.signing.secret_key, wire.signing.sign_outgoing = keys.secret, True
print("ready", url, flush=True)
while True:
    with contextlib.suppress(OSError), listener.accept()[0] as me.link: serve()  # until it is gone
    me.link = end(CANCELLED, why("LINK_SILENT"))  # what was commanded over a link ends with it
