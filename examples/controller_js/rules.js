'use strict';
/* What every controller must remember: who commands it, goals by their keys, epochs, times to live, the safe
 * stop, silence. Keep it as it is and write the robot around it, as controller.js does.
 * No clock, no I/O: times are milliseconds since the start and come from the caller.
 *
 * The robot has three methods:
 *   objection(verb, args)   why it cannot, as [reason, sentence]; undefined: it can
 *   begin(verb, args)       start a movement; `args` are seven numbers
 *   hold()                  here, whatever it did */
const wire = require('./robotree.js'); // generated from robotree.xml, see Makefile

const {
  MAV_MODE_FLAG: FLAG, MAV_STATE, MAV_AUTOPILOT,
  ROBOTREE_CLAIM_WISH: WISH, ROBOTREE_GOAL_STATE: STATE, ROBOTREE_MODE_KIND: MODE, ROBOTREE_REASON: REASON,
  ROBOTREE_VERB: VERB,
} = wire;
const SYSTEM = 1, COMPONENT = 1; // where a proxy looks for a controller
const SILENCE = 2000, PROGRESS_PERIOD = 100, MODE_PERIOD = 500, HEARTBEAT_PERIOD = 1000, CLAIM_PERIOD = 1000;
const GOALS = 256, CANCELS = 64; // kept
const SHORTEST_TERM = 100, LONGEST_TERM = 60000, GRACE = 500, RESERVED = 3000;
const LAST_EPOCH = 2 ** 32 - 2 ** 20, LEASES = 2 ** 10; // how far ahead counting leads in one step
const CLOCK_FROM = 1767225600, CLOCK_UNTIL = 4102444800, CLOCK_SKEW = 86400; // [s] 2026, 2100, a day
const AWAY = null; // the link of a holder whose link has ended, or who has yet to come back

const SENTENCES = {
  [REASON.STALE_EPOCH]: 'A newer epoch was already obeyed.',
  [REASON.BAD_EPOCH]: 'No honest clock explains so late an epoch.',
  [REASON.OTHER_LIFE]: 'This controller has restarted since; it may have begun before.',
  [REASON.FAULT]: 'Its memory cannot be written, so it obeys no new lease.',
  [REASON.NOT_IN_CONTROL]: 'Another program holds this robot; end it, or take over.',
};
const CONTENT = (() => { // where the arguments and the verb of a goal lie: compared to the bit, so that NaN is NaN
  const [args, verb] = ['args', 'verb'].map((name) => wire.RobotreeGoal.FIELDS.find((each) => each.name === name));
  return [args.offset, verb.offset + verb.size];
})();

/** A number within limits that arrived as float: 0.01 comes as 0.0099999998. NaN means as usual, or as it is now. */
const within = (value, lowest, highest) =>
  Number.isNaN(value) || (value >= Math.fround(lowest) && value <= Math.fround(highest));

/** @typedef {{system: number, component: number, link: object}} Peer  who says something, and over which link */
const same = (a, b) => a.link === b.link && a.system === b.system && a.component === b.component;
const named = (peer, key) => `${peer.system}/${peer.component}/${key}`;

class Rules {
  /**
   * @param robot what moves, see above
   * @param say called with each message for everybody who listens
   * @param type its MAV_TYPE
   * @param fence what must outlive a restart: {life, epoch, holder, name}; life is that of this start, never 0
   * @param keep called with the fence before anything is obeyed under it; whether it was kept
   * @param clock [s] since 1970; 0: there is no clock
   */
  constructor(robot, { say, type, fence, keep, clock }) {
    Object.assign(this, { robot, say, type, fence, keep, clock });
    this.now = 0;
    this.goals = new Map(); // the newest ones, by sender and key
    this.never = new Map(); // those cancelled before they came, apart, so that no finished goal is forgotten for them
    this.running = undefined; // at most one
    this.stopped = this.silent = false; // a safe stop is in force; silence ended the last goal
    this.stops = 1;
    this.heard = this.progressTold = this.modeDue = this.heartbeatDue = this.claimDue = 0;
    this.told = '';
    // the last holder is waited for
    this.claim = { holder: fence.holder, peer: { link: AWAY }, until: RESERVED, term: RESERVED };
  }

  // -- how it is as a whole

  get mode() {
    if (this.stopped) return MODE.SAFE_STOP;
    if (this.running) return MODE.ACTIVE;
    return this.silent ? MODE.HOLD : MODE.READY;
  }

  greet() { // a new link: it learns at once who is here
    this.sayHeartbeat();
    this.sayMode();
    this.sayClaim();
  }

  sayMode(refusal = REASON.NONE) {
    const standing = { [MODE.SAFE_STOP]: REASON.OPERATOR, [MODE.HOLD]: REASON.LINK_SILENT }[this.mode] ?? REASON.NONE;
    this.say(new wire.RobotreeMode({
      timeBootMs: this.now >>> 0, epoch: this.fence.epoch, silenceMs: SILENCE, mode: this.mode,
      reason: refusal || standing, stops: this.stops, life: this.fence.life,
    }));
    this.modeDue = this.now + MODE_PERIOD;
  }

  sayHeartbeat() {
    this.say(new wire.Heartbeat({
      type: this.type, autopilot: MAV_AUTOPILOT.GENERIC, customMode: this.mode,
      baseMode: FLAG.CUSTOM_MODE_ENABLED | (this.stopped ? 0 : FLAG.SAFETY_ARMED),
      systemStatus: this.stopped ? MAV_STATE.CRITICAL : this.running ? MAV_STATE.ACTIVE : MAV_STATE.STANDBY,
    }));
    this.heartbeatDue = this.now + HEARTBEAT_PERIOD;
  }

  sayClaim(to, reason = REASON.NONE) { // without an asker: to everybody
    const { holder, peer, term } = this.claim, there = peer.link !== AWAY;
    const status = new wire.RobotreeClaimStatus({ epoch: this.fence.epoch, life: this.fence.life, reason });
    if (holder)
      Object.assign(status, {
        holder, termMs: term, name: this.fence.name,
        holderSystem: there ? peer.system : 0, holderComponent: there ? peer.component : 0,
      });
    if (to) Object.assign(status, { targetSystem: to.system, targetComponent: to.component });
    else this.claimDue = this.now + CLAIM_PERIOD;
    this.say(status);
  }

  // -- epochs, lives, and who may command

  objectionToEpoch(epoch) { // why it is not obeyed; 0: it is
    const clock = this.clock(), latest = clock >= CLOCK_FROM ? clock + CLOCK_SKEW : CLOCK_UNTIL;
    if (epoch < this.fence.epoch) return REASON.STALE_EPOCH;
    const limit = Math.max(this.fence.epoch, Math.min(Math.max(this.fence.epoch + LEASES, latest), LAST_EPOCH));
    return epoch > limit ? REASON.BAD_EPOCH : 0;
  }

  remember(changes) { // else nothing is obeyed under them
    const fence = { ...this.fence, ...changes }, kept = this.keep(fence);
    if (kept) this.fence = fence;
    return kept;
  }

  admit(epoch) { // obeys it from now on; else why not
    const reason = this.objectionToEpoch(epoch);
    return !reason && epoch !== this.fence.epoch && !this.remember({ epoch }) ? REASON.FAULT : reason;
  }

  isHolder(from) { // bound to the link, since others may have the same ids
    return this.claim.holder !== 0n && same(this.claim.peer, from);
  }

  denial(from) { // why somebody may not command; 0: may
    return this.claim.holder !== 0n && !this.isHolder(from) ? REASON.NOT_IN_CONTROL : 0;
  }

  ofOtherLife(life) {
    return life !== 0 && life !== this.fence.life;
  }

  // -- goals: one movement per key, whatever the wire repeats, delays or reorders

  unheardOf(from, key) {
    return { key, from, state: STATE.UNKNOWN, reason: REASON.NONE, text: '', progress: 0, sequence: 0, holder: 0n };
  }

  sayStatus(goal) {
    const { key, from, progress, sequence, reason, state, text } = goal;
    this.say(new wire.RobotreeGoalStatus({
      key, epoch: this.fence.epoch, progress, sequence, reason, state, text,
      targetSystem: from.system, targetComponent: from.component,
    }));
  }

  change(goal, state, reason, text = '') {
    Object.assign(goal, { state, reason, text, sequence: (goal.sequence + 1) & 0xffff });
    this.progressTold = this.now;
    this.sayStatus(goal);
  }

  refuse(goal, reason, text = SENTENCES[reason]) {
    this.change({ ...goal }, STATE.REFUSED, reason, text); // a copy: it is not kept
  }

  finish(state, reason = REASON.NONE, text = '') { // the goal that runs, if one does
    const ended = this.running;
    if (!ended) return;
    this.robot.hold();
    this.running = undefined;
    if (state === STATE.SUCCEEDED) ended.progress = 1;
    this.change(ended, state, reason, text);
  }

  find(from, key) {
    return key === 0n ? undefined : this.goals.get(named(from, key)) ?? this.never.get(named(from, key));
  }

  store(goals, goal, limit) { // and forget the oldest one that does not run
    goals.set(named(goal.from, goal.key), goal);
    if (goals.size <= limit) return;
    for (const [name, old] of goals) if (old !== this.running) return goals.delete(name);
  }

  onGoal(asked, from, content) {
    const goal = this.find(from, asked.key), fresh = this.unheardOf(from, asked.key);
    const onlyAsks = asked.verb === VERB.STATUS;
    let denial = this.denial(from);
    if (!goal && this.ofOtherLife(asked.life)) // it may have begun before the restart
      return this.sayStatus({ ...fresh, reason: REASON.OTHER_LIFE });
    if (goal && !onlyAsks && goal.state !== STATE.UNKNOWN) {
      if (!goal.content.equals(content))
        return this.refuse(fresh, REASON.KEY_REUSED, 'The key was used before with other content.');
      if (!denial) this.admit(Math.max(asked.epoch, this.fence.epoch));
    }
    if (goal && !denial) { // who has dialled again asks for its goal there, and is heard there
      goal.from = from;
      goal.holder = this.isHolder(from) ? this.claim.holder : 0n;
    }
    if (goal || onlyAsks) return this.sayStatus(goal ?? fresh); // no movement
    if (asked.key === 0n) return this.refuse(fresh, REASON.BAD_ARGUMENT, 'The key of a goal must not be 0.');
    denial ||= this.admit(asked.epoch);
    if (denial) return this.refuse(fresh, denial);
    fresh.content = content;
    fresh.holder = this.isHolder(from) ? this.claim.holder : 0n;
    fresh.deadline = asked.ttlMs ? this.now + asked.ttlMs : Infinity;
    this.store(this.goals, fresh, GOALS);
    const stopped = [REASON.STOPPED, 'It is stopped; release the stop first.'];
    const objection = this.stopped ? stopped : this.robot.objection(asked.verb, asked.args);
    if (objection) return this.change(fresh, STATE.REFUSED, ...objection);
    this.finish(STATE.CANCELLED, REASON.SUPERSEDED, 'A newer goal took its place.');
    this.running = fresh;
    this.silent = false;
    this.heard = this.now;
    this.robot.begin(asked.verb, asked.args);
    this.change(fresh, STATE.ACTIVE, REASON.NONE);
  }

  onCancel(asked, from) {
    const goal = this.find(from, asked.key), fresh = this.unheardOf(from, asked.key);
    const other = this.ofOtherLife(asked.life);
    if (asked.key === 0n) {
      const denial = other ? REASON.OTHER_LIFE : this.objectionToEpoch(asked.epoch);
      if (denial) return this.refuse(fresh, denial);
      if (!this.denial(from)) this.admit(asked.epoch);
      return this.finish(STATE.CANCELLED, REASON.OPERATOR);
    }
    if (goal && goal === this.running) return this.finish(STATE.CANCELLED, REASON.OPERATOR);
    if (!goal) this.store(this.never, fresh, CANCELS); // the goal itself may still be on its way
    const known = goal && goal.state !== STATE.UNKNOWN;
    this.sayStatus(known || !other ? goal ?? fresh : { ...fresh, reason: REASON.OTHER_LIFE });
  }

  // -- the safe stop

  onSetMode(asked, from) {
    if (asked.mode === MODE.SAFE_STOP) { // from anyone, under any epoch
      this.stops += this.stopped ? 0 : 1;
      this.stopped = true;
      this.robot.hold();
      this.finish(STATE.CANCELLED, REASON.STOPPED, 'A safe stop was asked for.');
      return this.sayMode();
    }
    const refusal = this.objectionToRelease(asked, from);
    if (!refusal) this.stopped = this.silent = false;
    this.sayMode(refusal);
  }

  objectionToRelease(asked, from) {
    if (asked.mode !== MODE.READY) return REASON.BAD_ARGUMENT;
    if (this.denial(from)) return this.denial(from);
    const older = this.stopped && asked.stops && asked.stops !== this.stops; // its sender saw another stop
    if (older) return REASON.STOPPED;
    return this.ofOtherLife(asked.life) ? REASON.OTHER_LIFE : this.admit(asked.epoch);
  }

  // -- the claim: one holder commands, and keeps alive what moves at its word

  onClaim(asked, from) {
    let reason = this.objectionToClaim(asked);
    if (!reason && asked.wish !== WISH.RELEASE) reason = this.takeClaim(asked, from);
    else if (!reason && this.claim.holder === asked.holder) {
      this.loseClaim(REASON.LINK_SILENT, 'Who commands has released its claim.');
      this.remember({ holder: 0n, name: '' });
      this.sayClaim();
    }
    this.sayClaim(from, reason);
  }

  objectionToClaim({ holder, wish, life, epoch }) {
    if (holder === 0n || ![WISH.KEEP, WISH.TAKE_OVER, WISH.RELEASE].includes(wish)) return REASON.BAD_ARGUMENT;
    if (this.ofOtherLife(life)) return REASON.OTHER_LIFE;
    if (wish === WISH.RELEASE) return 0;
    const held = this.claim.holder !== 0n && this.claim.holder !== holder;
    if (held && wish !== WISH.TAKE_OVER) return REASON.NOT_IN_CONTROL;
    if (this.claim.holder === holder && epoch <= this.fence.epoch) return 0;
    if (epoch === this.fence.epoch && holder !== this.fence.holder) return REASON.STALE_EPOCH; // of another holder
    return this.objectionToEpoch(epoch);
  }

  loseClaim(reason, text) {
    if (this.running && this.running.holder !== 0n && this.running.holder === this.claim.holder) {
      this.finish(STATE.CANCELLED, reason, text);
      this.silent = reason === REASON.LINK_SILENT;
    }
    this.claim.holder = 0n;
  }

  takeClaim({ holder, termMs, epoch, name }, from) { // else why not
    const fresh = this.claim.holder !== holder, highest = Math.max(epoch, this.fence.epoch);
    const news = fresh || highest !== this.fence.epoch;
    if (news && !this.remember({ epoch: highest, holder, name })) return REASON.FAULT;
    const taken = [REASON.NOT_IN_CONTROL, 'Another program took over.'];
    if (fresh && this.claim.holder !== 0n) this.loseClaim(...taken);
    if (fresh && this.running && !same(this.running.from, from)) this.finish(STATE.CANCELLED, ...taken);
    const term = Math.min(Math.max(termMs, SHORTEST_TERM), LONGEST_TERM);
    this.claim = { holder, term, peer: from, until: this.now + term };
    if (this.running && (this.running.holder === holder || same(this.running.from, from))) {
      Object.assign(this.running, { holder, from });
      this.heard = this.now;
    }
    if (fresh) this.sayClaim();
    return 0;
  }

  // -- called by the robot

  hear(message, from, payload) { // payload: of its frame
    // While a goal runs its sender must be heard: another voice must not hide its death. Under a claim it is the
    // holder, by its CLAIM: a ground station may have the same ids.
    const { running } = this;
    if (running && running.holder === 0n && same(running.from, from)) this.heard = this.now;
    const { targetSystem: system, targetComponent: component } = message;
    const forAll = system === 0 && message instanceof wire.RobotreeSetMode;
    if (!forAll && (system !== SYSTEM || (component !== 0 && component !== COMPONENT))) return;
    if (message instanceof wire.RobotreeGoal) this.onGoal(message, from, Buffer.from(payload.subarray(...CONTENT)));
    else if (message instanceof wire.RobotreeGoalCancel) this.onCancel(message, from);
    else if (message instanceof wire.RobotreeSetMode) this.onSetMode(message, from);
    else if (message instanceof wire.RobotreeClaim) this.onClaim(message, from);
  }

  linkEnded(link) { // what is commanded over it ends now; what others command goes on
    const { claim } = this;
    if (claim.holder !== 0n && claim.peer.link === link) { // the holder has a moment to come back
      claim.peer = { link: AWAY };
      claim.until = Math.min(claim.until, this.now + GRACE);
    }
    if (!this.running || this.running.from.link !== link) return;
    this.finish(STATE.CANCELLED, REASON.LINK_SILENT, 'The link to who commands has ended.');
    this.silent = true;
  }

  progress(fraction) { // of the goal that runs
    this.running.progress = fraction;
    if (this.now - this.progressTold >= PROGRESS_PERIOD) this.change(this.running, STATE.ACTIVE, REASON.NONE);
  }

  tick(now) { // before the robot moves, so that it does not move on after an end
    this.now = now;
    if (this.claim.holder !== 0n && now >= this.claim.until) {
      this.loseClaim(REASON.LINK_SILENT, 'Who commands was not heard any more.');
      this.sayClaim();
    }
    if (this.running && now - this.heard > SILENCE) {
      this.finish(STATE.CANCELLED, REASON.LINK_SILENT, 'Nobody was heard for 2 s.');
      this.silent = true;
    }
    if (this.running && now >= this.running.deadline)
      this.finish(STATE.EXPIRED, REASON.NONE, 'Its time to live was over.');
  }

  news() { // last: tell what has changed, and now and then what has not
    const state = `${this.mode} ${this.fence.epoch}`, fresh = state !== this.told;
    this.told = state;
    if (fresh || this.now >= this.modeDue) this.sayMode();
    if (fresh || this.now >= this.heartbeatDue) this.sayHeartbeat();
    if (this.now >= this.claimDue) this.sayClaim();
  }
}

module.exports = { Rules, SYSTEM, COMPONENT, within };
