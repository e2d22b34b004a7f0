/* What every controller must remember: who commands it, goals by their keys, epochs, times to live, the safe
 * stop, silence.
 * Keep it as it is and write the robot around it, as controller.c does. Include it in one file only.
 * No allocation, no clock, no I/O: times are milliseconds since the start and come from the caller. */
#ifndef ROBOTREE_RULES_H
#define ROBOTREE_RULES_H

#include <mavlink.h> /* generated from robotree.xml, see Makefile */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { SYSTEM = 1, COMPONENT = MAV_COMP_ID_AUTOPILOT1 }; /* where a proxy looks for a controller */
enum { GOALS = 256, CANCELS = 64, SILENCE = 2000, PROGRESS_PERIOD = 100, MODE_PERIOD = 500, HEARTBEAT_PERIOD = 1000 };
enum { CLAIM_PERIOD = 1000, SHORTEST_TERM = 100, LONGEST_TERM = 60000, GRACE = 500, RESERVED = 3000, AWAY = -1 };
static const uint64_t LAST_EPOCH = 4293918720; /* 2^32 - 2^20: none is given above it */
static const uint64_t LEASES = 1024;           /* how far ahead counting leads in one step */
static const uint64_t CLOCK_FROM = 1767225600, CLOCK_UNTIL = 4102444800, CLOCK_SKEW = 86400; /* 2026, 2100, a day */

/* -- the robot: written by you, and ROBOT_TYPE, one of MAV_TYPE, defined before this file is included */

static void say(const mavlink_message_t *message); /* to everybody who listens */
static int robot_objects(int verb, const float *args, const char **text); /* why it cannot; 0: it can */
static void robot_begins(int verb, const float *args);
static void robot_holds(void); /* here, whatever it did */
static uint64_t robot_clock(void); /* seconds since 1970; 0: this robot has no clock */
static void robot_remembers(void); /* keep `fence` for good before you return; memory.h does. A person at the machine
                                    * needs a way to clear it: a jumper, a button held while it starts. */

/* -- the rules' memory */

struct goal {
    mavlink_robotree_goal_t asked;         /* compared when the key comes again */
    mavlink_robotree_goal_status_t status; /* said again when the key comes again; its target is the sender */
    uint64_t deadline;
    int link;                              /* over which it is commanded */
    uint64_t holder;                       /* whose CLAIM keeps it alive; 0: whatever its sender says does */
};
static struct goal goals[GOALS];    /* a ring of the newest ones */
static struct goal never[CANCELS];  /* a ring of those cancelled before they came; anybody may fill it */
static struct goal *running;        /* at most one */
static bool stopped, silent;        /* safe stop in force; silence ended the last goal */
static uint32_t stops = 1;          /* one more with each safe stop that begins */
static int link_heard;              /* where the message came from that is being heard */
static uint64_t now, heard, progress_told, mode_due, heartbeat_due, claim_due;

/* Which leases were obeyed, and who holds the claim. This must outlive a restart, else a lease that is over could
 * command the robot again: see robot_remembers. */
static struct fence {
    uint64_t holder; /* 0: nobody */
    uint32_t epoch;  /* the highest one obeyed */
    uint16_t life;   /* names this life in MODE: another number after each start, never 0 */
    char name[25];   /* of the holder, for people */
} fence;

static struct {
    uint64_t holder; /* 0: nobody holds the claim */
    uint64_t until;  /* unless a CLAIM of the holder comes before */
    uint16_t term;
    int link;        /* over which the last one came; AWAY: its link has ended, or it has yet to come back */
    uint8_t system, component;
} claim;

static void set_fence(uint32_t epoch, uint64_t holder, const char *name) {
    fence.epoch = epoch;
    fence.holder = holder;
    if (name != fence.name) snprintf(fence.name, sizeof fence.name, "%.24s", name);
    robot_remembers();
}

/* -- how the controller is as a whole: MODE and HEARTBEAT */

static int mode(void) {
    if (stopped) return ROBOTREE_MODE_KIND_SAFE_STOP;
    if (running) return ROBOTREE_MODE_KIND_ACTIVE;
    return silent ? ROBOTREE_MODE_KIND_HOLD : ROBOTREE_MODE_KIND_READY;
}

static void say_mode(int refusal) {
    int reason = refusal                              ? refusal
                 : stopped                            ? ROBOTREE_REASON_OPERATOR
                 : mode() == ROBOTREE_MODE_KIND_HOLD ? ROBOTREE_REASON_LINK_SILENT
                                                      : ROBOTREE_REASON_NONE;
    mavlink_message_t message;
    mavlink_msg_robotree_mode_pack(SYSTEM, COMPONENT, &message, (uint32_t)now, fence.epoch, SILENCE,
                                   (uint8_t)mode(), (uint8_t)reason, stops, fence.life);
    say(&message);
    mode_due = now + MODE_PERIOD;
}

static void say_heartbeat(void) {
    int flags = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (stopped ? 0 : MAV_MODE_FLAG_SAFETY_ARMED);
    int state = stopped ? MAV_STATE_CRITICAL : running ? MAV_STATE_ACTIVE : MAV_STATE_STANDBY;
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(SYSTEM, COMPONENT, &message, ROBOT_TYPE, MAV_AUTOPILOT_GENERIC,
                               (uint8_t)flags, (uint32_t)mode(), (uint8_t)state);
    say(&message);
    heartbeat_due = now + HEARTBEAT_PERIOD;
}

static void say_claim(const mavlink_message_t *to, int reason) { /* NULL: it answers nobody */
    mavlink_message_t message;
    mavlink_robotree_claim_status_t told = {.epoch = fence.epoch, .life = fence.life, .reason = (uint8_t)reason};
    if (claim.holder) {
        told.holder = claim.holder;
        told.term_ms = claim.term;
        told.holder_system = claim.link == AWAY ? 0 : claim.system;
        told.holder_component = claim.link == AWAY ? 0 : claim.component;
        memcpy(told.name, fence.name, sizeof told.name);
    }
    if (to) {
        told.target_system = to->sysid;
        told.target_component = to->compid;
    }
    mavlink_msg_robotree_claim_status_encode(SYSTEM, COMPONENT, &message, &told);
    say(&message);
    if (!to) claim_due = now + CLAIM_PERIOD;
}

/* -- goals: one movement per key, whatever the wire repeats, delays or reorders */

static void say_status(struct goal *goal) {
    mavlink_message_t message;
    goal->status.epoch = fence.epoch;
    mavlink_msg_robotree_goal_status_encode(SYSTEM, COMPONENT, &message, &goal->status);
    say(&message);
}

static void change(struct goal *goal, int state, int reason, const char *text) {
    goal->status.state = (uint8_t)state;
    goal->status.reason = (uint16_t)reason;
    goal->status.sequence++;
    snprintf(goal->status.text, sizeof goal->status.text, "%s", text);
    progress_told = now;
    say_status(goal);
}

static void refuse(struct goal goal, int reason, const char *text) { /* a copy: it is not kept */
    change(&goal, ROBOTREE_GOAL_STATE_REFUSED, reason, text);
}

static void finish(int state, int reason, const char *text) { /* the goal that runs, if one does */
    struct goal *ended = running;
    if (!ended) return;
    robot_holds();
    running = NULL;
    if (state == ROBOTREE_GOAL_STATE_SUCCEEDED) ended->status.progress = 1;
    change(ended, state, reason, text);
}

static int epoch_objection(uint32_t asked) { /* why an epoch is not obeyed; 0: it is */
    uint64_t clock = robot_clock(), latest = clock >= CLOCK_FROM ? clock + CLOCK_SKEW : CLOCK_UNTIL;
    uint64_t limit = fence.epoch + LEASES > latest ? fence.epoch + LEASES : latest;
    if (limit > LAST_EPOCH) limit = LAST_EPOCH;
    if (asked < fence.epoch) return ROBOTREE_REASON_STALE_EPOCH;
    return asked > limit && asked > fence.epoch ? ROBOTREE_REASON_BAD_EPOCH : 0;
}

static const char *in_words(int reason) {
    if (reason == ROBOTREE_REASON_STALE_EPOCH) return "A newer epoch was already obeyed.";
    if (reason == ROBOTREE_REASON_BAD_EPOCH) return "No honest clock explains so late an epoch.";
    if (reason == ROBOTREE_REASON_OTHER_LIFE) return "This controller has restarted since; it may have begun before.";
    return reason ? "Another program holds this robot; end it, or take over." : "";
}

static int admit(uint32_t asked) { /* obeys an epoch from now on; else why not */
    int reason = epoch_objection(asked);
    if (!reason && asked != fence.epoch) set_fence(asked, fence.holder, fence.name);
    return reason;
}

static bool is_holder(const mavlink_message_t *from) { /* bound to the link, since others share its ids */
    return claim.holder && claim.link == link_heard && claim.system == from->sysid
           && claim.component == from->compid;
}

static int guard(const mavlink_message_t *from) { /* why somebody may not command; 0: may */
    return claim.holder && !is_holder(from) ? ROBOTREE_REASON_NOT_IN_CONTROL : 0;
}

static bool of_other_life(uint16_t life) { return life && life != fence.life; }

static struct goal unheard_of(const mavlink_message_t *from, uint64_t key) { /* UNKNOWN is 0 */
    struct goal goal = {.asked = {.key = key}, .status = {.key = key}, .link = link_heard};
    goal.status.target_system = from->sysid;
    goal.status.target_component = from->compid;
    return goal;
}

static struct goal *find(const mavlink_message_t *from, uint64_t key) {
    for (size_t i = 0; key && i < GOALS + CANCELS; i++) {
        struct goal *g = i < GOALS ? &goals[i] : &never[i - GOALS];
        if (g->asked.key == key && g->status.target_system == from->sysid
            && g->status.target_component == from->compid)
            return g;
    }
    return NULL;
}

static struct goal *keep(struct goal goal) { /* in the place of the oldest one that does not run */
    static size_t next;
    if (&goals[next] == running) next = (next + 1) % GOALS;
    struct goal *place = &goals[next];
    next = (next + 1) % GOALS;
    *place = goal;
    return place;
}

static struct goal *keep_cancelled(struct goal goal) { /* apart, so that no finished goal is forgotten for it */
    static size_t next;
    struct goal *place = &never[next];
    next = (next + 1) % CANCELS;
    *place = goal;
    return place;
}

static bool same(const mavlink_robotree_goal_t *a, const mavlink_robotree_goal_t *b) {
    /* To the bit, so that NaN is NaN; who asks again, later, may have a newer lease and less time left. */
    return a->verb == b->verb && !memcmp(a->args, b->args, sizeof a->args);
}

static void on_goal(const mavlink_message_t *from, const mavlink_robotree_goal_t *asked) {
    struct goal *goal = find(from, asked->key), fresh = unheard_of(from, asked->key);
    const char *text = "";
    bool only_asks = asked->verb == ROBOTREE_VERB_STATUS;
    int denial = guard(from);
    if (!goal && of_other_life(asked->life)) { /* it may have begun before the restart */
        fresh.status.state = ROBOTREE_GOAL_STATE_UNKNOWN;
        fresh.status.reason = ROBOTREE_REASON_OTHER_LIFE;
        return say_status(&fresh);
    }
    if (goal && !only_asks && goal->status.state != ROBOTREE_GOAL_STATE_UNKNOWN) {
        if (!same(&goal->asked, asked))
            return refuse(fresh, ROBOTREE_REASON_KEY_REUSED, "The key was used before with other content.");
        if (!denial && asked->epoch > fence.epoch) admit(asked->epoch);
    }
    if (goal && !denial) { /* who has dialled again asks for its goal there, and is heard there */
        goal->link = link_heard;
        goal->holder = is_holder(from) ? claim.holder : 0;
    }
    if (goal || only_asks) return say_status(goal ? goal : &fresh); /* no movement */
    if (!asked->key) return refuse(fresh, ROBOTREE_REASON_BAD_ARGUMENT, "The key of a goal must not be 0.");
    if (denial || (denial = admit(asked->epoch))) return refuse(fresh, denial, in_words(denial));
    fresh.holder = is_holder(from) ? claim.holder : 0;
    fresh.asked = *asked;
    fresh.deadline = asked->ttl_ms ? now + asked->ttl_ms : UINT64_MAX;
    goal = keep(fresh);
    int reason = stopped ? ROBOTREE_REASON_STOPPED : robot_objects(asked->verb, asked->args, &text);
    if (reason) return change(goal, ROBOTREE_GOAL_STATE_REFUSED, reason, text);
    finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_SUPERSEDED, "A newer goal took its place.");
    running = goal;
    silent = false;
    heard = now;
    robot_begins(asked->verb, asked->args);
    change(goal, ROBOTREE_GOAL_STATE_ACTIVE, ROBOTREE_REASON_NONE, "");
}

static void on_cancel(const mavlink_message_t *from, const mavlink_robotree_goal_cancel_t *asked) {
    struct goal *goal = find(from, asked->key), fresh = unheard_of(from, asked->key);
    int denial = of_other_life(asked->life) ? ROBOTREE_REASON_OTHER_LIFE : epoch_objection(asked->epoch);
    if (!asked->key && denial) return refuse(fresh, denial, in_words(denial));
    if (!asked->key && !guard(from)) admit(asked->epoch);
    if (running && (!asked->key || goal == running))
        return finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_OPERATOR, "");
    if (!asked->key) return;
    if (!goal) goal = keep_cancelled(fresh); /* kept: the goal itself may still be on its way */
    if (goal->status.state == ROBOTREE_GOAL_STATE_UNKNOWN && of_other_life(asked->life)) {
        fresh.status.reason = ROBOTREE_REASON_OTHER_LIFE; /* it may have begun before the restart */
        goal = &fresh;
    }
    say_status(goal);
}

static void on_set_mode(const mavlink_message_t *from, const mavlink_robotree_set_mode_t *asked) {
    int refusal = ROBOTREE_REASON_NONE;
    if (asked->mode == ROBOTREE_MODE_KIND_SAFE_STOP) { /* from anyone, under any epoch */
        stops += !stopped;
        stopped = true;
        robot_holds();
        finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_STOPPED, "A safe stop was asked for.");
    } else if (asked->mode != ROBOTREE_MODE_KIND_READY) {
        refusal = ROBOTREE_REASON_BAD_ARGUMENT;
    } else if ((refusal = guard(from))) {
        /* somebody else holds the claim */
    } else if (stopped && asked->stops && asked->stops != stops) { /* it is meant for an older stop */
        refusal = ROBOTREE_REASON_STOPPED;
    } else if (of_other_life(asked->life)) {
        refusal = ROBOTREE_REASON_OTHER_LIFE;
    } else if (!(refusal = admit(asked->epoch))) {
        stopped = silent = false;
    }
    say_mode(refusal);
}

/* -- the claim: one holder commands, and keeps alive what moves at its word */

static bool is_asked_by(const struct goal *goal, const mavlink_message_t *from) {
    return goal->link == link_heard && goal->status.target_system == from->sysid
           && goal->status.target_component == from->compid;
}

static void lose_claim(int reason, const char *text) {
    if (running && running->holder && running->holder == claim.holder) {
        finish(ROBOTREE_GOAL_STATE_CANCELLED, reason, text);
        silent = reason == ROBOTREE_REASON_LINK_SILENT;
    }
    claim.holder = 0;
}

static void take_claim(const mavlink_message_t *from, const mavlink_robotree_claim_t *asked) {
    bool fresh = claim.holder != asked->holder;
    if (fresh && claim.holder) lose_claim(ROBOTREE_REASON_NOT_IN_CONTROL, "Another program took over.");
    if (fresh && running && !is_asked_by(running, from)) /* what the holder itself had begun before goes on */
        finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_NOT_IN_CONTROL, "Another program took over.");
    claim.holder = asked->holder;
    claim.link = link_heard;
    claim.system = from->sysid;
    claim.component = from->compid;
    claim.term = asked->term_ms < SHORTEST_TERM  ? SHORTEST_TERM
                 : asked->term_ms > LONGEST_TERM ? LONGEST_TERM
                                                 : asked->term_ms;
    claim.until = now + claim.term;
    char name[25] = {0};
    memcpy(name, asked->name, sizeof asked->name);
    uint32_t epoch = asked->epoch > fence.epoch ? asked->epoch : fence.epoch;
    if (fresh || epoch != fence.epoch) set_fence(epoch, asked->holder, name);
    if (running && (running->holder == asked->holder || is_asked_by(running, from))) {
        running->holder = asked->holder;
        running->link = link_heard;
        heard = now;
    }
    if (fresh) say_claim(NULL, 0);
}

static int claim_objection(const mavlink_robotree_claim_t *asked) { /* an epoch belongs to one holder */
    if (claim.holder == asked->holder && asked->epoch <= fence.epoch) return 0;
    if (asked->epoch == fence.epoch && asked->holder != fence.holder) return ROBOTREE_REASON_STALE_EPOCH;
    return epoch_objection(asked->epoch);
}

static void on_claim(const mavlink_message_t *from, const mavlink_robotree_claim_t *asked) {
    bool held = claim.holder && claim.holder != asked->holder;
    bool takes = asked->wish == ROBOTREE_CLAIM_WISH_TAKE_OVER;
    int reason = 0;
    if (!asked->holder || (!takes && asked->wish != ROBOTREE_CLAIM_WISH_KEEP
                           && asked->wish != ROBOTREE_CLAIM_WISH_RELEASE)) {
        reason = ROBOTREE_REASON_BAD_ARGUMENT;
    } else if (of_other_life(asked->life)) {
        reason = ROBOTREE_REASON_OTHER_LIFE;
    } else if (asked->wish == ROBOTREE_CLAIM_WISH_RELEASE) {
        if (claim.holder == asked->holder) {
            lose_claim(ROBOTREE_REASON_LINK_SILENT, "Who commands has released its claim.");
            set_fence(fence.epoch, 0, "");
            say_claim(NULL, 0);
        }
    } else if (held && !takes) {
        reason = ROBOTREE_REASON_NOT_IN_CONTROL;
    } else if (!(reason = claim_objection(asked))) {
        take_claim(from, asked);
    }
    say_claim(from, reason);
}

/* -- called by the robot */

static void rules_start(uint16_t chance) { /* when `fence` is what was remembered; chance: any number that varies */
    if (!fence.life) fence.life = chance; /* nothing was */
    if (!++fence.life) fence.life = 1;
    set_fence(fence.epoch, fence.holder, fence.name);
    claim.holder = fence.holder; /* the last holder is waited for */
    claim.link = AWAY;
    claim.until = now + RESERVED;
}

static bool for_us(int system, int component) {
    return system == SYSTEM && (component == 0 || component == COMPONENT);
}

static void rules_hear(const mavlink_message_t *m, int link) { /* link: a number of yours */
    link_heard = link;
    /* While a goal runs, it is its sender who must be heard: another voice must not hide its death. Under a
     * claim it is the holder, by its CLAIM: a ground station may have the same ids. */
    if (running && !running->holder && running->link == link && running->status.target_system == m->sysid
        && running->status.target_component == m->compid)
        heard = now;
    if (m->msgid == MAVLINK_MSG_ID_ROBOTREE_GOAL) {
        mavlink_robotree_goal_t goal;
        mavlink_msg_robotree_goal_decode(m, &goal);
        if (for_us(goal.target_system, goal.target_component)) on_goal(m, &goal);
    } else if (m->msgid == MAVLINK_MSG_ID_ROBOTREE_GOAL_CANCEL) {
        mavlink_robotree_goal_cancel_t cancel;
        mavlink_msg_robotree_goal_cancel_decode(m, &cancel);
        if (for_us(cancel.target_system, cancel.target_component)) on_cancel(m, &cancel);
    } else if (m->msgid == MAVLINK_MSG_ID_ROBOTREE_SET_MODE) {
        mavlink_robotree_set_mode_t wish;
        mavlink_msg_robotree_set_mode_decode(m, &wish);
        if (!wish.target_system || for_us(wish.target_system, wish.target_component)) on_set_mode(m, &wish);
    } else if (m->msgid == MAVLINK_MSG_ID_ROBOTREE_CLAIM) {
        mavlink_robotree_claim_t wish;
        mavlink_msg_robotree_claim_decode(m, &wish);
        if (for_us(wish.target_system, wish.target_component)) on_claim(m, &wish);
    }
}

static void rules_link_ended(int link) { /* what is commanded over it ends now; what others command goes on */
    if (claim.holder && claim.link == link) { /* the holder has a moment to come back */
        claim.link = AWAY;
        if (claim.until > now + GRACE) claim.until = now + GRACE;
    }
    if (!running || running->link != link) return;
    finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_LINK_SILENT, "The link to who commands has ended.");
    silent = true;
}

static bool rules_within(float value, double lowest, double highest) {
    /* The wire has floats: 0.01 arrives as 0.0099999998, so limits are compared as floats. NaN, which asks for
     * what is usual or as it is now, is within; an infinite value is not. */
    return value != value || (value >= (float)lowest && value <= (float)highest);
}

static void rules_progress(double fraction) { /* of the goal that runs */
    if (!running) return;
    running->status.progress = (float)fraction;
    if (now - progress_told >= PROGRESS_PERIOD)
        change(running, ROBOTREE_GOAL_STATE_ACTIVE, ROBOTREE_REASON_NONE, "");
}

static void rules_tick(void) { /* before the robot moves, so that it does not move on after an end */
    if (claim.holder && now >= claim.until) {
        lose_claim(ROBOTREE_REASON_LINK_SILENT, "Who commands was not heard any more.");
        say_claim(NULL, 0);
    }
    if (running && now - heard > SILENCE) {
        finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_LINK_SILENT, "Nobody was heard for 2 s.");
        silent = true;
    }
    if (running && now >= running->deadline)
        finish(ROBOTREE_GOAL_STATE_EXPIRED, ROBOTREE_REASON_NONE, "Its time to live was over.");
}

static void rules_news(void) { /* last: tell what has changed, and now and then what has not */
    static int told_mode = -1;
    static uint32_t told_epoch;
    bool news = told_mode != mode() || told_epoch != fence.epoch;
    told_mode = mode();
    told_epoch = fence.epoch;
    if (news || now >= mode_due) say_mode(ROBOTREE_REASON_NONE);
    if (news || now >= heartbeat_due) say_heartbeat();
    if (now >= claim_due) say_claim(NULL, 0);
}

#endif
