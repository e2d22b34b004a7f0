/* The controller of a rover. It listens on TCP, does what a robotree proxy asks of it, and moves a point
 * where yours moves wheels: look for MOTOR. rules.h knows what to obey; this file is robot and socket.
 * One thread, no allocation. Metres along the axes of W (x forward, y left), milliseconds since the start. */
#define _POSIX_C_SOURCE 200809L
#define ROBOT_TYPE MAV_TYPE_GROUND_ROVER /* what its HEARTBEAT says that it is */
#include "rules.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <math.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
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
    ssize_t size = mavlink_msg_to_send_buffer(frame, message);
    for (int i = 0; i < CLIENTS; i++) {
        if (clients[i].fd < 0) continue;
        if (send(clients[i].fd, frame, (size_t)size, MSG_NOSIGNAL | MSG_DONTWAIT) != size)
            hang_up(i); /* it is gone, or it has not read for so long that its buffer is full */
    }
}

static void read_from(int i) {
    uint8_t bytes[4096];
    ssize_t count = recv(clients[i].fd, bytes, sizeof bytes, MSG_DONTWAIT);
    if (count <= 0) return hang_up(i);
    clients[i].heard = now;
    for (ssize_t b = 0; b < count; b++) {
        mavlink_message_t message;
        mavlink_status_t status;
        if (mavlink_parse_char((uint8_t)i, bytes[b], &message, &status)) rules_hear(&message, i);
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
    mavlink_reset_channel_status((uint8_t)place);
    say_heartbeat(); /* at once: a proxy takes the robot for online when it hears one */
    say_mode(ROBOTREE_REASON_NONE);
    say_claim(NULL, ROBOTREE_REASON_NONE);
}

static int listen_on(int port) {
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
    printf("ready tcp:127.0.0.1:%d\n", ntohs(here.sin_port));
    fflush(stdout);
    return fd;
}

static uint64_t robot_clock(void) { return (uint64_t)time(NULL); }

static uint16_t chance(void) { /* another number at each start; yours: of a random generator, or count starts */
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    return (uint16_t)(t.tv_nsec / 1000 ^ t.tv_sec ^ getpid());
}

static uint64_t clock_ms(void) {
    static time_t start;
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    if (!start) start = t.tv_sec;
    return (uint64_t)(t.tv_sec - start) * 1000 + (uint64_t)t.tv_nsec / 1000000;
}

int main(int count, char **words) {
    char *rest = "";
    long port = count == 2 ? strtol(words[1], &rest, 10) : -1;
    if (port < 0 || port > 65535 || *rest || rest == words[1]) {
        fprintf(stderr, "usage: controller PORT     (0: any that is free)\n");
        return 2;
    }
    int listener = listen_on((int)port);
    for (int i = 0; i < CLIENTS; i++) clients[i].fd = -1;
    rules_start(chance());
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
        }
        rules_news();
    }
}
