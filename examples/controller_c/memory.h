/* What must outlive a restart: the fence of rules.h, and the newest signing time of keys.h. One record in two
 * copies, each with a checksum. A damaged or missing copy is replaced by the other one. If neither is left, the
 * controller must not start: only a person can know which leases were obeyed, and that nobody is near the robot.
 * Include it after rules.h. No I/O: memory_get and memory_put are the robot's. */
#ifndef ROBOTREE_MEMORY_H
#define ROBOTREE_MEMORY_H

#include "rules.h"
#include <mavlink_sha256.h>
#include <stddef.h>

enum { COPIES = 2, BOOT_ID = 36 };

static struct memory {
    uint8_t form[8];      /* names this layout */
    uint64_t count;       /* how often it was written; of two copies the newer one counts */
    uint64_t heard;       /* the newest signing time that was accepted */
    uint64_t reserve;     /* nothing accepted or signed is later, until it is written again */
    char machine[BOOT_ID]; /* names the machine's life; in another one the last writes may have been lost */
    struct fence fence;
    uint8_t check[6];     /* of all before it */
} memory;
static bool memory_used; /* false: this robot remembers nothing, and each start is its first one */

/* -- written by you */

static bool memory_get(int copy, struct memory *record);       /* false: it is not there, or cannot be read */
static void memory_put(int copy, const struct memory *record); /* returns when `kill -9` cannot undo it */

/* -- */

enum memory_state { MEMORY_INTACT, MEMORY_MENDED, MEMORY_LOST };
static const uint8_t MEMORY_FORM[8] = "tree  1";

static void memory_check(const struct memory *record, uint8_t check[6]) {
    mavlink_sha256_ctx sum;
    mavlink_sha256_init(&sum);
    mavlink_sha256_update(&sum, record, offsetof(struct memory, check));
    mavlink_sha256_final_48(&sum, check);
}

static bool memory_is_intact(const struct memory *record) {
    uint8_t check[6];
    memory_check(record, check);
    return !memcmp(record->form, MEMORY_FORM, sizeof MEMORY_FORM) && !memcmp(record->check, check, sizeof check);
}

static void memory_write(void) {
    if (!memory_used) return;
    memcpy(memory.form, MEMORY_FORM, sizeof MEMORY_FORM);
    memory.count++;
    memory_check(&memory, memory.check);
    for (int i = 0; i < COPIES; i++) memory_put(i, &memory);
}

static enum memory_state memory_read(bool intact[COPIES]) { /* the newer one of the intact copies */
    memory_used = true;
    memory.count = 0;
    for (int i = 0; i < COPIES; i++) {
        struct memory copy;
        intact[i] = memory_get(i, &copy) && memory_is_intact(&copy);
        if (intact[i] && copy.count > memory.count) memory = copy;
    }
    fence = memory.fence;
    return intact[0] && intact[1] ? MEMORY_INTACT : intact[0] || intact[1] ? MEMORY_MENDED : MEMORY_LOST;
}

static void robot_remembers(void) { /* called by rules.h before a new epoch is obeyed */
    memory.fence = fence;
    memory_write();
}

#endif
