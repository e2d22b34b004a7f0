/* A ground station that signs as QGroundControl does: with MAVLink's C library, and the SHA-256 of a passphrase.
 * station PORT PASSPHRASE: sends a command until it is answered; prints `answered RESULT` or `silence`. */
#define _DEFAULT_SOURCE
#include <mavlink.h>
#include <mavlink_sha256.h>

#include <arpa/inet.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static mavlink_signing_t signing;
static mavlink_signing_streams_t streams;

int main(int count, char **words) {
    if (count != 3) return 2;
    struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(words[1]))};
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    if (connect(fd, (struct sockaddr *)&there, sizeof there)) return 1;

    mavlink_sha256_ctx sum;
    uint8_t first[6];
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, words[2], (uint32_t)strlen(words[2]));
    mavlink_sha256_final_48(&sum, first);
    for (int i = 0; i < 32; i++) signing.secret_key[i] = (uint8_t)(sum.counter[i / 4] >> (24 - 8 * (i % 4)));
    signing.flags = MAVLINK_SIGNING_FLAG_SIGN_OUTGOING;
    signing.timestamp = ((uint64_t)time(NULL) - 1420070400) * 100000; /* once, as it does; frames then add 1 */
    mavlink_get_channel_status(MAVLINK_COMM_0)->signing = &signing;
    mavlink_get_channel_status(MAVLINK_COMM_0)->signing_streams = &streams;

    for (int tries = 0; tries < 40; tries++) {
        uint8_t bytes[4096];
        mavlink_message_t message;
        mavlink_status_t status;
        mavlink_msg_command_long_pack(255, 190, &message, 1, 1, MAV_CMD_DO_GRIPPER, (uint8_t)tries, 1, 0, 0, 0, 0, 0, 0);
        uint16_t size = mavlink_msg_to_send_buffer(bytes, &message);
        if (write(fd, bytes, size) != size) return 1;
        struct pollfd watched = {fd, POLLIN, 0};
        for (int turn = 0; turn < 20 && poll(&watched, 1, 10) >= 0; turn++) {
            ssize_t got = watched.revents ? recv(fd, bytes, sizeof bytes, MSG_DONTWAIT) : 0;
            for (ssize_t i = 0; i < got; i++)
                if (mavlink_parse_char(MAVLINK_COMM_0, bytes[i], &message, &status)
                    && message.msgid == MAVLINK_MSG_ID_COMMAND_ACK) {
                    printf("answered %d\n", mavlink_msg_command_ack_get_result(&message));
                    return 0;
                }
        }
    }
    puts("silence");
    return 0;
}
