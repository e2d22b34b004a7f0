/* The controller of a rover. It listens on TCP, does what a robotree proxy asks of it, and moves a point
 * where yours moves wheels: look for MOTOR. rules.h knows what to obey, keys.h whom, memory.h what of it outlives a
 * restart; this file is robot, socket and files. No allocation; one thread, and one that syncs the files.
 * Metres along the axes of W (x forward, y left), milliseconds since the start. */
#define _DEFAULT_SOURCE                  /* flock, beside POSIX */
#define ROBOT_TYPE MAV_TYPE_GROUND_ROVER /* what its HEARTBEAT says that it is */
#include "rules.h"

#include "keys.h"
#include "memory.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <fnmatch.h>
#include <math.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { CLIENTS = MAVLINK_COMM_NUM_BUFFERS, TICK = 20, LONGEST_STEP = 100 };
static const double ARENA = 1.5, USUAL_SPEED = 0.4, SLOWEST = 0.01, TOP_SPEED = 1.0;

/* -- the robot */

static double x, y, vx, vy;              /* where it is and how it moves */
static double to_x, to_y, speed, length; /* of the movement that runs */

static int robot_objects(int verb, const float *args, const char **text) {
    double dx = (double)args[0], dy = (double)args[1];
    if (verb == ROBOTREE_VERB_HOLD) return 0;
    if (verb != ROBOTREE_VERB_MOVE) {
        *text = "This rover knows MOVE and HOLD.";
        return ROBOTREE_REASON_UNKNOWN_VERB;
    }
    if (!isfinite(dx) || !isfinite(dy) || !rules_within(args[2], SLOWEST, TOP_SPEED)) {
        *text = "MOVE takes dx, dy in metres and a speed of 0.01 to 1 m/s.";
        return ROBOTREE_REASON_BAD_ARGUMENT;
    }
    if (fabs(x + dx) > ARENA || fabs(y + dy) > ARENA) {
        *text = "The floor ends 1.5 m from its middle.";
        return ROBOTREE_REASON_OUT_OF_REACH;
    }
    return 0;
}

static void robot_begins(int verb, const float *args) {
    bool moves = verb == ROBOTREE_VERB_MOVE;
    to_x = moves ? x + (double)args[0] : x;
    to_y = moves ? y + (double)args[1] : y;
    speed = moves && !isnan(args[2]) ? (double)args[2] : USUAL_SPEED;
    length = hypot(to_x - x, to_y - y);
}

static void robot_holds(void) { vx = vy = 0; } /* MOTOR: stand still */

static void robot_moves(double dt) { /* MOTOR: one step [s] straight towards the goal */
    double left = hypot(to_x - x, to_y - y);
    if (left <= speed * dt) {
        x = to_x;
        y = to_y;
        return finish(ROBOTREE_GOAL_STATE_SUCCEEDED, ROBOTREE_REASON_NONE, "");
    }
    vx = speed * (to_x - x) / left;
    vy = speed * (to_y - y) / left;
    x += vx * dt;
    y += vy * dt;
    rules_progress(1 - left / length);
}

static void say_position(void) { /* NED: y to the right, z down; 0 - y, since -0.0 would be told as -0 */
    mavlink_message_t message;
    mavlink_msg_local_position_ned_pack(SYSTEM, COMPONENT, &message, (uint32_t)now, (float)x,
                                        (float)(0 - y), 0, (float)vx, (float)(0 - vy), 0);
    say(&message);
}

/* -- its socket: several may listen; everything is said to everybody, and a status names its reader */

static struct {
    int fd;    /* -1: free */
    bool left; /* the rules have yet to be told */
    bool told; /* why its frames are refused */
    uint64_t heard;
} clients[CLIENTS];

static void hang_up(int i) {
    close(clients[i].fd);
    clients[i].fd = -1;
    clients[i].left = true;
}

static void see_who_left(void) {
    for (int i = 0; i < CLIENTS; i++) {
        if (!clients[i].left) continue;
        clients[i].left = false;
        rules_link_ended(i);
    }
}

static void say(const mavlink_message_t *message) {
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];
    size_t plain = mavlink_msg_to_send_buffer(frame, message);
    if (keys_on) keys_flag(frame, plain);
    for (int i = 0; i < CLIENTS; i++) {
        if (clients[i].fd < 0) continue;
        size_t size = keys_on ? keys_sign(frame, plain, (uint8_t)i) : plain;
        if (send(clients[i].fd, frame, size, MSG_NOSIGNAL | MSG_DONTWAIT) != (ssize_t)size)
            hang_up(i); /* it is gone, or it has not read for so long that its buffer is full */
    }
}

static void refuse_frame(const mavlink_message_t *message, int i, const char *why) { /* one line for each client */
    if (!clients[i].told)
        fprintf(stderr, "controller: refused: a frame of %d/%d %s\n", message->sysid, message->compid, why);
    clients[i].told = true;
}

static void read_from(int i) {
    uint8_t bytes[4096];
    ssize_t count = recv(clients[i].fd, bytes, sizeof bytes, MSG_DONTWAIT);
    if (count <= 0) return hang_up(i);
    if (!keys_on) clients[i].heard = now;
    for (ssize_t b = 0; b < count; b++) {
        mavlink_message_t message;
        mavlink_status_t status;
        if (!mavlink_parse_char((uint8_t)i, bytes[b], &message, &status)) continue;
        const char *why = keys_objection(&message);
        if (why) {
            refuse_frame(&message, i, why);
            continue;
        }
        clients[i].heard = now;
        rules_hear(&message, i);
    }
}

static void welcome(int listener) { /* in a free place, else in that of the one that is silent for longest */
    int fd = accept(listener, NULL, NULL), place = 0, yes = 1;
    if (fd < 0) return;
    for (int i = 1; i < CLIENTS && clients[place].fd >= 0; i++)
        if (clients[i].fd < 0 || clients[i].heard < clients[place].heard) place = i;
    if (clients[place].fd >= 0) hang_up(place);
    see_who_left(); /* before another one has its place */
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    clients[place].fd = fd;
    clients[place].heard = now;
    clients[place].told = false;
    mavlink_reset_channel_status((uint8_t)place);
    say_heartbeat(); /* at once: a proxy takes the robot for online when it hears one */
    say_mode(ROBOTREE_REASON_NONE);
    say_claim(NULL, ROBOTREE_REASON_NONE);
}

static int listen_on(int port, char url[64]) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    socklen_t size = sizeof here;
    int fd = socket(AF_INET, SOCK_STREAM, 0), yes = 1;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(fd, (struct sockaddr *)&here, size) || listen(fd, CLIENTS) || fcntl(fd, F_SETFL, O_NONBLOCK)
        || getsockname(fd, (struct sockaddr *)&here, &size)) {
        perror("controller");
        exit(1);
    }
    snprintf(url, 64, "tcp:127.0.0.1:%d", ntohs(here.sin_port));
    return fd;
}

/* -- its clock and its files; on a board without them: a key in flash, and the record of memory.h in FRAM */

static uint64_t robot_clock(void) { return (uint64_t)time(NULL); }

static uint64_t keys_wall(void) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    if (t.tv_sec < 1420070400) return 0;
    return (uint64_t)(t.tv_sec - 1420070400) * UNITS + (uint64_t)t.tv_nsec / 10000;
}

static uint16_t chance(void) { /* another number at each start; yours: of a random generator, or count starts */
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    return (uint16_t)(t.tv_nsec / 1000 ^ t.tv_sec ^ getpid());
}

static void fail(const char *file, const char *why) {
    fprintf(stderr, "controller: %s %s\n", file, why);
    exit(1);
}

static int copies[COPIES];

static bool memory_get(int copy, struct memory *record) {
    return pread(copies[copy], record, sizeof *record, 0) == (ssize_t)sizeof *record;
}

static void memory_put(int copy, const struct memory *record) { /* the system keeps it, whatever ends this program */
    static bool told;
    if (pwrite(copies[copy], record, sizeof *record, 0) == (ssize_t)sizeof *record || told) return;
    fprintf(stderr, "controller: its memory cannot be written (%s); a restart forgets what is new\n", strerror(errno));
    told = true; /* and it goes on: a full disk must not keep it from obeying a stop */
}

static void *sync_on(void *nothing) { /* in a thread: a disk may take long, and the robot moves */
    for (;; sleep(1))
        for (int i = 0; i < COPIES; i++) fdatasync(copies[i]);
    return nothing;
}

static void remember(const char *file, bool reset) {
    char names[COPIES][1024];
    bool intact[COPIES];
    pthread_t thread;
    for (int i = 0; i < COPIES; i++) {
        snprintf(names[i], sizeof names[i], i ? "%s.copy" : "%s", file);
        copies[i] = open(names[i], O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600);
        if (copies[i] < 0) fail(names[i], strerror(errno));
        if (flock(copies[i], LOCK_EX | LOCK_NB)) fail(names[i], "is the memory of another controller that runs");
    }
    enum memory_state state = memory_read(intact);
    for (int i = 0; i < COPIES; i++)
        if (!intact[i] && state == MEMORY_MENDED)
            fprintf(stderr, "controller: %s is damaged or missing; the other copy is intact, and is used\n", names[i]);
    if (state == MEMORY_LOST && !reset)
        fail(file, "and its copy are both damaged or missing, so nobody knows which leases were obeyed. Look at the "
                   "robot; then start it once with --reset-epoch, as at its very first start");
    if (reset) fence = (struct fence){.life = fence.life};
    if (reset) fprintf(stderr, "controller: it has forgotten which leases were obeyed, and obeys any now\n");
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is reported by memory_put */
    pthread_create(&thread, NULL, sync_on, NULL);
}

static int digit(char c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1; }

static bool from_hex(const char *text, uint8_t key[KEY]) {
    for (int i = 0; i < KEY; i++) {
        int high = digit(text[2 * i]), low = high < 0 ? -1 : digit(text[2 * i + 1]);
        if (low < 0) return false;
        key[i] = (uint8_t)(high << 4 | low);
    }
    return !text[2 * KEY];
}

static void unlock(const char *file, const char *name) { /* a key file of robotree; the first line that fits counts */
    char line[1200], pattern[1000], digits[2 * KEY + 2], machine[BOOT_ID] = {0};
    uint8_t key[KEY];
    bool found = false;
    struct stat status;
    FILE *lines = fopen(file, "r"), *boot = fopen("/proc/sys/kernel/random/boot_id", "r");
    if (!lines || fstat(fileno(lines), &status)) fail(file, strerror(errno));
    if (status.st_mode & 077 || status.st_uid != geteuid()) fail(file, "can be read by others; run chmod 600 on it");
    while (!found && fgets(line, sizeof line, lines)) {
        int words = sscanf(line, " %999s %65s", pattern, digits);
        if (words < 1 || *pattern == '#') continue;
        if (words < 2 || !from_hex(digits, key)) fail(file, "has a line that is no pattern and key of 64 digits");
        found = !strcmp(pattern, name) || !fnmatch(pattern, name, FNM_NOESCAPE);
    }
    fclose(lines);
    if (!found) fail(name, "has no line in the key file");
    if (!strcmp(pattern, name)) memcpy(keys_secret, key, KEY); /* its own, as it is */
    else keys_derive(key, name);
    if (boot && fread(machine, 1, sizeof machine, boot) < sizeof machine) memset(machine, 0, sizeof machine);
    if (boot) fclose(boot);
    keys_begin(machine);
}

static uint64_t clock_ms(void) {
    static time_t start;
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    if (!start) start = t.tv_sec;
    return (uint64_t)(t.tv_sec - start) * 1000 + (uint64_t)t.tv_nsec / 1000000;
}

static const char *option(int count, char **words, const char *name, bool takes) { /* NULL: it is not there */
    for (int i = 2; i < count; i++) {
        if (!strcmp(words[i], name)) return !takes ? words[i] : i + 1 < count ? words[i + 1] : NULL;
        if (strcmp(words[i], "--reset-epoch")) i++; /* the other options take a word */
    }
    return NULL;
}

static int misused(void) {
    fputs("usage: controller PORT [--memory FILE [--reset-epoch] [--key FILE [--name NAME]]]\n"
          "  PORT           of 127.0.0.1; 0: any that is free\n"
          "  --memory FILE  remembers there, and in FILE.copy, which leases were obeyed and what was heard\n"
          "  --reset-epoch  forget the leases; needed at the first start\n"
          "  --key FILE     obey only who has the key; needs --memory, or a restart would make recordings valid\n"
          "  --name NAME    of the controller, which its key is derived from; else tcp:127.0.0.1:PORT\n",
          stderr);
    return 2;
}

int main(int count, char **words) {
    char *rest = "", url[64];
    long port = count > 1 ? strtol(words[1], &rest, 10) : -1;
    if (port < 0 || port > 65535 || *rest || rest == words[1]) return misused();
    const char *file = option(count, words, "--memory", true), *key = option(count, words, "--key", true);
    const char *name = option(count, words, "--name", true), *reset = option(count, words, "--reset-epoch", false);
    if (2 + 2 * (!!file + !!key + !!name) + !!reset != count || (!file && (key || reset)) || (name && !key))
        return misused();
    int listener = listen_on((int)port, url);
    for (int i = 0; i < CLIENTS; i++) clients[i].fd = -1;
    if (file) remember(file, reset);
    if (key) unlock(key, name ? name : url);
    rules_start(chance());
    printf("ready %s\n", url);
    fflush(stdout);
    for (uint64_t last = now = clock_ms();;) {
        struct pollfd watched[CLIENTS + 1] = {{.fd = listener, .events = POLLIN}};
        for (int i = 0; i < CLIENTS; i++) watched[i + 1] = (struct pollfd){clients[i].fd, POLLIN, 0};
        poll(watched, CLIENTS + 1, now < last + TICK ? (int)(last + TICK - now) : 0);
        now = clock_ms();
        for (int i = 0; i < CLIENTS; i++)
            if (watched[i + 1].revents && clients[i].fd >= 0) read_from(i);
        see_who_left();
        if (watched[0].revents) welcome(listener);
        if (now >= last + TICK) {
            uint64_t passed = now - last;
            if (passed > LONGEST_STEP) passed = LONGEST_STEP; /* no jump after a pause */
            last = now;
            rules_tick();
            if (running) robot_moves((double)passed / 1000);
            say_position();
            keys_tick();
        }
        rules_news();
    }
}
