/* Who may speak to this controller: MAVLink 2 signatures with a key that no other controller has. Unsigned frames,
 * those with another key, and recordings are refused, also after a restart. (MAVLink's own check would not do: after
 * a restart it accepts every recording that is less than a minute old.) See robotree's decision 0035.
 * Include it after memory.h. No I/O: keys_wall is the robot's. Times count 10 us since the beginning of 2015. */
#ifndef ROBOTREE_KEYS_H
#define ROBOTREE_KEYS_H

#include "memory.h"

enum { KEY = 32, PASSPHRASE = 16, STREAMS = 64, SIGNATURE = MAVLINK_SIGNATURE_BLOCK_LEN, PROOF = 6 };
static const uint64_t UNITS = 100000, MINUTE = 60 * 100000, RESERVE = 20 * 100000;
static const uint64_t SET_FROM = (1767225600ULL - 1420070400) * 100000; /* a clock before 2026 was never set */

static uint64_t keys_wall(void); /* written by you: the time; 0: this robot has no clock */

static bool keys_on; /* false: this controller is open */
static uint8_t keys_secret[KEY];
static uint64_t keys_start, keys_last; /* no stream begins before the start; the last time that we signed */
static uint64_t keys_floor;            /* nor before the streams that were forgotten */
static struct {
    uint8_t sender[3]; /* system, component, link */
    uint64_t newest;
} streams[STREAMS];
static int streams_known;

/* -- the key of this controller, from that of the realm or the cell */

static void sha256_end(mavlink_sha256_ctx *sum, uint8_t digest[KEY]) {
    uint8_t first[PROOF];
    mavlink_sha256_final_48(sum, first); /* the library gives 48 bits; all are in its state */
    for (int i = 0; i < KEY; i++) digest[i] = (uint8_t)(sum->counter[i / 4] >> (24 - 8 * (i % 4)));
}

static void hmac(const uint8_t key[KEY], const void *text, size_t size, uint8_t digest[KEY]) { /* RFC 2104 */
    uint8_t inner[64], outer[64];
    mavlink_sha256_ctx sum;
    for (size_t i = 0; i < sizeof inner; i++) {
        inner[i] = 0x36 ^ (i < KEY ? key[i] : 0);
        outer[i] = 0x5c ^ (i < KEY ? key[i] : 0);
    }
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, inner, sizeof inner);
    mavlink_sha256_update(&sum, text, (uint32_t)size);
    sha256_end(&sum, digest);
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, outer, sizeof outer);
    mavlink_sha256_update(&sum, digest, KEY);
    sha256_end(&sum, digest);
}

static void keys_derive(const uint8_t shared[KEY], const char *name) { /* HKDF without salt, RFC 5869 */
    static const uint8_t zeros[KEY];
    uint8_t block[KEY], info[1024];
    char passphrase[2 * PASSPHRASE + 1];
    mavlink_sha256_ctx sum;
    int size = snprintf((char *)info, sizeof info - 1, "robotree controller %s", name);
    info[size] = 1;
    hmac(zeros, shared, KEY, block);
    hmac(block, info, (size_t)size + 1, block);
    for (int i = 0; i < PASSPHRASE; i++) snprintf(passphrase + 2 * i, 3, "%02x", block[i]);
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, passphrase, 2 * PASSPHRASE);
    sha256_end(&sum, keys_secret);
}

/* -- time */

static uint64_t keys_now(void) {
    uint64_t wall = keys_wall();
    return wall > keys_last ? wall : keys_last;
}

static bool keys_reserve(void) { /* false: what is reserved suffices */
    uint64_t latest = keys_now() > memory.heard ? keys_now() : memory.heard;
    if (latest + RESERVE / 2 < memory.reserve) return false;
    memory.reserve = latest + RESERVE;
    return true;
}

static void keys_tick(void) { /* now and then: a clock that is set back must not make a recording valid */
    if (keys_on && keys_reserve()) memory_write();
}

static void keys_begin(const char machine[BOOT_ID]) { /* after the memory was read, and the key is known */
    if (memcmp(memory.machine, machine, BOOT_ID)) memory.heard = memory.reserve; /* what was newer may be lost */
    memcpy(memory.machine, machine, BOOT_ID);
    keys_on = true;
    keys_start = keys_wall() > memory.heard ? keys_wall() : memory.heard + 1;
    keys_last = keys_wall() > memory.heard ? keys_wall() : memory.reserve;
    keys_reserve();
    memory_write();
}

/* -- frames */

static void keys_proof(const void *head, const void *payload, size_t size, const void *ends, uint8_t proof[PROOF]) {
    mavlink_sha256_ctx sum; /* ends: checksum, link, time */
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, keys_secret, KEY);
    mavlink_sha256_update(&sum, head, MAVLINK_NUM_HEADER_BYTES);
    mavlink_sha256_update(&sum, payload, (uint32_t)size);
    mavlink_sha256_update(&sum, ends, 2 + SIGNATURE - PROOF);
    mavlink_sha256_final_48(&sum, proof);
}

static size_t keys_flag(uint8_t *frame, size_t size) { /* a whole frame, that it will be signed */
    const mavlink_msg_entry_t *entry =
        mavlink_get_msg_entry(frame[7] | (uint32_t)frame[8] << 8 | (uint32_t)frame[9] << 16);
    frame[2] |= MAVLINK_IFLAG_SIGNED;
    uint16_t sum = crc_calculate(frame + 1, (uint16_t)(size - 3));
    crc_accumulate(entry->crc_extra, &sum);
    frame[size - 2] = (uint8_t)sum;
    frame[size - 1] = (uint8_t)(sum >> 8);
    return size;
}

static size_t keys_sign(uint8_t *frame, size_t size, uint8_t link) { /* for one link; sent again: signed again */
    uint64_t wall = keys_wall();
    keys_last = wall > keys_last ? wall : keys_last + 1;
    frame[size] = link;
    for (int i = 0; i < 6; i++) frame[size + 1 + (size_t)i] = (uint8_t)(keys_last >> 8 * i);
    keys_proof(frame, frame + MAVLINK_NUM_HEADER_BYTES, size - MAVLINK_NUM_HEADER_BYTES - 2, frame + size - 2,
               frame + size + SIGNATURE - PROOF);
    return size + SIGNATURE;
}

static int keys_place(const uint8_t sender[3]) { /* of a stream; a new one takes the place of the oldest */
    int place = 0;
    for (int i = 0; i < streams_known; i++)
        if (!memcmp(streams[i].sender, sender, 3)) return i;
    if (streams_known < STREAMS) return streams_known;
    for (int i = 1; i < STREAMS; i++)
        if (streams[i].newest < streams[place].newest) place = i;
    return place;
}

static const char *keys_objection(const mavlink_message_t *m) { /* why a frame is not obeyed; NULL: it is */
    uint8_t ends[2 + SIGNATURE - PROOF], proof[PROOF], differs = 0;
    if (!keys_on) return NULL;
    if (m->magic != MAVLINK_STX || !(m->incompat_flags & MAVLINK_IFLAG_SIGNED)) return "is not signed";
    memcpy(ends, m->ck, 2);
    memcpy(ends + 2, m->signature, SIGNATURE - PROOF);
    keys_proof(&m->magic, _MAV_PAYLOAD(m), m->len, ends, proof);
    for (int i = 0; i < PROOF; i++) differs |= proof[i] ^ m->signature[SIGNATURE - PROOF + i];
    if (differs) return "is signed with another key"; /* before its time is believed */
    uint64_t time = 0, now_is = keys_now();
    for (int i = 5; i >= 0; i--) time = time << 8 | m->signature[1 + i];
    uint8_t sender[3] = {m->sysid, m->compid, m->signature[0]};
    int place = keys_place(sender);
    bool known = place < streams_known && !memcmp(streams[place].sender, sender, 3);
    if (known && time <= streams[place].newest) return "was heard before";
    if (!known && (time < keys_start || time <= keys_floor || time + MINUTE < now_is)) return "is too old";
    if (time > memory.heard + MINUTE && time > now_is + MINUTE && keys_wall() >= SET_FROM)
        return "is of a clock that is more than a minute ahead";
    if (!known && place < streams_known && streams[place].newest > keys_floor) keys_floor = streams[place].newest;
    if (place == streams_known) streams_known++;
    memcpy(streams[place].sender, sender, 3);
    streams[place].newest = time;
    if (time > memory.heard) { /* written before the frame is obeyed */
        memory.heard = time;
        if (!keys_wall() && time > keys_last) keys_last = time; /* without a clock others are our clock */
        keys_reserve();
        memory_write();
    }
    return NULL;
}

#endif
