'use strict';
/* The controller of a small arm with a gripper. It listens on TCP, does what a robotree proxy asks of it, and moves a
 * point where yours moves joints: look for MOTOR. rules.js knows what to obey; this file is robot, memory and sockets.
 *
 *     node controller.js 5765      (ready tcp:127.0.0.1:5765)
 *
 * Metres, radians, seconds; x forward, y left, z up. */
const crypto = require('node:crypto');
const fs = require('node:fs');
const net = require('node:net');
const { parseArgs } = require('node:util');
const { MavLinkPacketParser, MavLinkPacketSplitter, MavLinkProtocolV2 } = require('node-mavlink');
const wire = require('./robotree.js');
const { COMPONENT, Rules, SYSTEM, within } = require('./rules.js');

const { ROBOTREE_GOAL_STATE: STATE, ROBOTREE_GRIPPER_STATE: GRIPPER } = wire;
const { ROBOTREE_REASON: REASON, ROBOTREE_VERB: VERB } = wire;
const TICK = 20, LONGEST_STEP = 100, LAZIEST = 1 << 18; // [ms], [ms], [bytes] that a client may leave unread
const BOX = [[-0.65, 0.65], [-0.65, 0.65], [0.025, 0.8]], REACH = 0.85, SHOULDER = [0, 0, 0.3];
const SLOWEST = 0.005, FASTEST = 0.25, USUAL_SPEED = 0.15, TURNING = 1.0, FINGERS = 0.1, WIDEST = 0.08;

class Arm {
  constructor() {
    this.tool = [0.4, 0, 0.4, 0]; // x, y, z, twist
    this.width = this.wished = 0;
    this.hold();
  }

  objection(verb, args) {
    if (verb === VERB.HOLD) return undefined;
    if (verb === VERB.GRIP)
      return within(args[0], 0, WIDEST) ? undefined : [REASON.BAD_ARGUMENT, 'GRIP takes a width of 0 to 0.08 m.'];
    if (verb !== VERB.GO_TO) return [REASON.UNKNOWN_VERB, 'This arm knows GO_TO, GRIP and HOLD.'];
    const speed = args[4] === 0 || within(args[4], SLOWEST, FASTEST);
    if (!speed || !within(args[3], -Math.PI, Math.PI) || !args.slice(0, 3).every((value) => within(value, -1e3, 1e3)))
      return [REASON.BAD_ARGUMENT, 'GO_TO takes x, y, z in metres, a twist and a speed of 0.005 to 0.25 m/s.'];
    const to = this.whither(args);
    const inside = BOX.every(([lowest, highest], axis) => within(to[axis], lowest, highest));
    if (!inside || Math.hypot(...SHOULDER.map((value, axis) => to[axis] - value)) > REACH)
      return [REASON.OUT_OF_REACH, 'The tool does not reach there.'];
    return undefined;
  }

  whither(args) { // NaN: as it is now
    return this.tool.map((value, axis) => (Number.isNaN(args[axis]) ? value : args[axis]));
  }

  begin(verb, args) {
    this.hold();
    if (verb === VERB.GRIP && !Number.isNaN(args[0])) this.wished = args[0];
    if (verb === VERB.GRIP) return (this.seconds = this.left = Math.abs(this.wished - this.width) / FINGERS);
    if (verb !== VERB.GO_TO) return undefined;
    this.from = this.tool;
    this.to = this.whither(args);
    const way = Math.hypot(...[0, 1, 2].map((axis) => this.to[axis] - this.from[axis]));
    this.seconds = Math.max(way / (args[4] || USUAL_SPEED), Math.abs(this.to[3] - this.from[3]) / TURNING);
    return (this.left = this.seconds);
  }

  hold() { // MOTOR: stand still
    this.from = this.to = this.tool;
    this.wished = this.width;
    this.seconds = this.left = 0;
  }

  move(dt) { // MOTOR: one step [s] straight towards the goal; the fraction that is done
    this.left = Math.max(this.left - dt, 0);
    const done = this.seconds ? 1 - this.left / this.seconds : 1;
    this.tool = this.from.map((value, axis) => value + (this.to[axis] - value) * done);
    const step = Math.min(Math.max(this.wished - this.width, -FINGERS * dt), FINGERS * dt);
    this.width = done === 1 ? this.wished : this.width + step;
    return done;
  }

  telemetry(now, busy) {
    const [x, y, z, twist] = this.tool, timeBootMs = now >>> 0, unit = (value) => Math.round(32767 * value);
    const q = [0, -Math.sin(twist / 2), Math.cos(twist / 2), 0].map(unit); // pointing down, turned by twist
    const { width, wished: commanded } = this, state = width === commanded ? GRIPPER.AT_WIDTH : GRIPPER.MOVING;
    return [
      new wire.RobotreeTool({ timeBootMs, x, y, z, q, busy: busy ? 1 : 0 }),
      new wire.RobotreeGripper({ timeBootMs, width, commanded, state }),
    ];
  }
}

/** What must outlive a restart: the fence of rules.js, in a file that is replaced as a whole, with a checksum. */
class Memory {
  constructor(path) { // without one it remembers nothing, and each start is its first one
    this.path = path;
  }

  static sum(text) {
    return crypto.createHash('sha256').update(text).digest('hex');
  }

  load(reset) { // that of the life before; a lost one must never become a lower epoch in silence
    const first = { life: crypto.randomInt(1, 0x10000), epoch: 0, holder: 0n, name: '' };
    if (!this.path) return first;
    const [text, sum] = fs.existsSync(this.path) ? fs.readFileSync(this.path, 'utf8').split('\n') : [''];
    const intact = Memory.sum(text) === sum;
    if (!intact && !reset)
      fail(`${this.path} is damaged or missing, so nobody knows which leases were obeyed. Look at the robot; then`
        + ' start it once with --reset-epoch, as at its very first start');
    if (!intact) return first;
    const { life, epoch, holder, name } = JSON.parse(text), next = (life % 0xffff) + 1;
    return reset ? { ...first, life: next } : { life: next, epoch, holder: BigInt(holder), name };
  }

  save(fence) { // whether it was kept
    const text = JSON.stringify({ ...fence, holder: fence.holder.toString() }), fresh = `${this.path}.new`;
    try {
      if (this.path) {
        fs.writeFileSync(fresh, `${text}\n${Memory.sum(text)}\n`, { flush: true, mode: 0o600 });
        fs.renameSync(fresh, this.path);
      }
      this.told = false;
      return true;
    } catch (error) { // such as a full disk; stops are obeyed all the same
      if (!this.told) console.error(`controller: its memory cannot be written: ${error.message}`);
      this.told = true;
      return false;
    }
  }
}

/** Its sockets: several may listen; everything is said to everybody, and a status names its reader. */
function serve(port, path, reset) {
  const clients = new Set(), arm = new Arm(), memory = new Memory(path), fence = memory.load(reset);
  const protocol = new MavLinkProtocolV2(SYSTEM, COMPONENT), began = performance.now();
  const elapsed = () => performance.now() - began;
  let sequence = 0, last = 0;

  function say(message) {
    const frame = protocol.serialize(message, sequence);
    sequence = (sequence + 1) & 0xff;
    for (const client of clients)
      if (client.writableLength > LAZIEST) client.destroy(); // it has not read for too long
      else client.write(frame);
  }

  const rules = new Rules(arm, {
    say, fence, type: wire.MAV_TYPE.GENERIC, keep: (news) => memory.save(news), clock: () => Date.now() / 1000,
  });
  if (!memory.save(fence)) process.exit(1); // else the next start would have the same life

  const listener = net.createServer((client) => {
    client.setNoDelay(true);
    client.on('error', () => {}); // 'close' follows
    client.on('close', () => {
      clients.delete(client);
      rules.now = elapsed();
      rules.linkEnded(client);
    });
    clients.add(client);
    rules.greet();
    const packets = client.pipe(new MavLinkPacketSplitter({}, { magicNumbers: wire.MAGIC_NUMBERS }));
    packets.pipe(new MavLinkPacketParser()).on('data', ({ header, payload, protocol: spoken }) => {
      const kind = wire.REGISTRY[header.msgid];
      const from = { system: header.sysid, component: header.compid, link: client };
      rules.now = elapsed();
      if (kind) rules.hear(spoken.data(payload, kind), from, payload);
    });
  });

  setInterval(() => {
    const now = elapsed(), passed = Math.min(now - last, LONGEST_STEP); // no jump after a pause
    last = now;
    rules.tick(now);
    if (rules.running) {
      const done = arm.move(passed / 1000);
      if (done === 1) rules.finish(STATE.SUCCEEDED);
      else rules.progress(done);
    }
    arm.telemetry(now, rules.running !== undefined).forEach(say);
    rules.news();
  }, TICK);

  listener.on('error', (error) => fail(error.message));
  listener.listen(port, '127.0.0.1', () => console.log(`ready tcp:127.0.0.1:${listener.address().port}`));
}

function fail(sentence) {
  console.error(`controller: ${sentence}`);
  process.exit(1);
}

let given;
try {
  given = parseArgs({
    allowPositionals: true, options: { memory: { type: 'string' }, 'reset-epoch': { type: 'boolean' } },
  });
} catch {} // a wrong option
const [port = '', ...rest] = given?.positionals ?? [];
if (!/^\d{1,5}$/.test(port) || Number(port) > 65535 || rest.length || given.values.memory === '') {
  console.error('usage: node controller.js PORT [--memory FILE [--reset-epoch]]     (0: any port that is free)\n'
    + '  --memory FILE  remembers there which leases were obeyed\n'
    + '  --reset-epoch  forget the leases; needed at the first start');
  process.exit(2);
}
serve(Number(port), given.values.memory, given.values['reset-epoch']);
