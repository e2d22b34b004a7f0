/* What every controller must remember: goals by their keys, epochs, times to live, the safe stop, silence.
 * Keep it as it is and write the robot around it, as controller.c does. Include it in one file only.
 * No allocation, no clock, no I/O: times are milliseconds since the start and come from the caller. */
#ifndef ROBOTREE_RULES_H
#define ROBOTREE_RULES_H

#include <mavlink.h> /* generated from robotree.xml, see Makefile */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { SYSTEM = 1, COMPONENT = MAV_COMP_ID_AUTOPILOT1 }; /* where a proxy looks for a controller */
enum { GOALS = 256, SILENCE = 2000, PROGRESS_PERIOD = 100, MODE_PERIOD = 500, HEARTBEAT_PERIOD = 1000 };

/* -- the robot: written by you, and ROBOT_TYPE, one of MAV_TYPE, defined before this file is included */

static void say(const mavlink_message_t *message); /* to everybody who listens */
static int robot_objects(int verb, const float *args, const char **text); /* why it cannot; 0: it can */
static void robot_begins(int verb, const float *args);
static void robot_holds(void); /* here, whatever it did */

/* -- the rules' memory */

struct goal {
    mavlink_robotree_goal_t asked;         /* compared when the key comes again */
    mavlink_robotree_goal_status_t status; /* said again when the key comes again; its target is the sender */
    uint64_t deadline;
    int link;                              /* over which it is commanded */
};
static struct goal goals[GOALS];    /* a ring of the newest ones */
static struct goal *running;        /* at most one */
static bool stopped, silent;        /* safe stop in force; silence ended the last goal */
static uint32_t epoch;              /* the highest one obeyed */
static uint32_t stops = 1;          /* one more with each safe stop that begins */
static int link_heard;              /* where the message came from that is being heard */
static uint64_t now, heard, progress_told, mode_due, heartbeat_due;

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
    mavlink_msg_robotree_mode_pack(SYSTEM, COMPONENT, &message, (uint32_t)now, epoch, SILENCE,
                                   (uint8_t)mode(), (uint8_t)reason, stops);
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

/* -- goals: one movement per key, whatever the wire repeats, delays or reorders */

static void say_status(struct goal *goal) {
    mavlink_message_t message;
    goal->status.epoch = epoch;
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

static bool fence(uint32_t asked) { /* false: a newer epoch was obeyed */
    if (asked < epoch) return false;
    epoch = asked;
    return true;
}

static struct goal unheard_of(const mavlink_message_t *from, uint64_t key) { /* UNKNOWN is 0 */
    struct goal goal = {.asked = {.key = key}, .status = {.key = key}, .link = link_heard};
    goal.status.target_system = from->sysid;
    goal.status.target_component = from->compid;
    return goal;
}

static struct goal *find(const mavlink_message_t *from, uint64_t key) {
    for (struct goal *g = goals; g < goals + GOALS; g++)
        if (key && g->asked.key == key && g->status.target_system == from->sysid
            && g->status.target_component == from->compid)
            return g;
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

static bool same(const mavlink_robotree_goal_t *a, const mavlink_robotree_goal_t *b) {
    /* To the bit, so that NaN is NaN; who asks again, later, may have a newer lease and less time left. */
    return a->verb == b->verb && !memcmp(a->args, b->args, sizeof a->args);
}

static void on_goal(const mavlink_message_t *from, const mavlink_robotree_goal_t *asked) {
    struct goal *goal = find(from, asked->key), fresh = unheard_of(from, asked->key);
    const char *text = "";
    bool only_asks = asked->verb == ROBOTREE_VERB_STATUS;
    if (goal && !only_asks && goal->status.state != ROBOTREE_GOAL_STATE_UNKNOWN) {
        if (!same(&goal->asked, asked))
            return refuse(fresh, ROBOTREE_REASON_KEY_REUSED, "The key was used before with other content.");
        fence(asked->epoch);
    }
    if (goal) goal->link = link_heard; /* who has dialled again asks for its goal there, and is heard there */
    if (goal || only_asks) return say_status(goal ? goal : &fresh); /* no movement */
    if (!asked->key) return refuse(fresh, ROBOTREE_REASON_BAD_ARGUMENT, "The key of a goal must not be 0.");
    if (!fence(asked->epoch))
        return refuse(fresh, ROBOTREE_REASON_STALE_EPOCH, "A newer epoch was already obeyed.");
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
    if (!asked->key && !fence(asked->epoch))
        return refuse(fresh, ROBOTREE_REASON_STALE_EPOCH, "A newer epoch was already obeyed.");
    if (running && (!asked->key || goal == running))
        return finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_OPERATOR, "");
    if (asked->key) say_status(goal ? goal : keep(fresh)); /* kept: the goal itself may still be on its way */
}

static void on_set_mode(const mavlink_robotree_set_mode_t *asked) {
    int refusal = ROBOTREE_REASON_NONE;
    if (asked->mode == ROBOTREE_MODE_KIND_SAFE_STOP) { /* from anyone, under any epoch */
        stops += !stopped;
        stopped = true;
        robot_holds();
        finish(ROBOTREE_GOAL_STATE_CANCELLED, ROBOTREE_REASON_STOPPED, "A safe stop was asked for.");
    } else if (asked->mode != ROBOTREE_MODE_KIND_READY) {
        refusal = ROBOTREE_REASON_BAD_ARGUMENT;
    } else if (stopped && asked->stops && asked->stops != stops) { /* it is meant for an older stop */
        refusal = ROBOTREE_REASON_STOPPED;
    } else if (!fence(asked->epoch)) {
        refusal = ROBOTREE_REASON_STALE_EPOCH;
    } else {
        stopped = silent = false;
    }
    say_mode(refusal);
}

/* -- called by the robot */

static bool for_us(int system, int component) {
    return system == SYSTEM && (component == 0 || component == COMPONENT);
}

static void rules_hear(const mavlink_message_t *m, int link) { /* link: a number of yours */
    link_heard = link;
    /* While a goal runs, it is its sender who must be heard: another voice must not hide its death. */
    if (running && running->link == link && running->status.target_system == m->sysid
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
        if (!wish.target_system || for_us(wish.target_system, wish.target_component)) on_set_mode(&wish);
    }
}

static void rules_link_ended(int link) { /* what is commanded over it ends now; what others command goes on */
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
    bool news = told_mode != mode() || told_epoch != epoch;
    told_mode = mode();
    told_epoch = epoch;
    if (news || now >= mode_due) say_mode(ROBOTREE_REASON_NONE);
    if (news || now >= heartbeat_due) say_heartbeat();
}

#endif
