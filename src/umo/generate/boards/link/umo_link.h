/* umo_link.h: a part of a machine on this controller, and its host at the other end of a line (docs/split-protocol.md).
 *
 * The part runs while its host is heard. After LINK_HOST_TIMEOUT without a frame its axes brake; when they stand, and at
 * the latest after LINK_BRAKING_TIMEOUT more, every output goes to its default, and nothing runs until the host starts it
 * again. */
#ifndef UMO_LINK_H
#define UMO_LINK_H

#include "machine_link.h"
#include "umo_frames.h"

enum { LINK_VERSION = 2 };
enum link_kinds { LINK_HELLO = 1, LINK_WELCOME, LINK_START, LINK_EXCHANGE, LINK_STOP, LINK_STATE, LINK_REFUSED };
enum link_refusals { LINK_HAS_A_HOST = 1, LINK_NOT_OWN }; /* why a line to a host is closed at once */
enum link_items { LINK_FIELD = 1, LINK_COMMAND, LINK_REFERENCE, LINK_CLEAR, LINK_ACKNOWLEDGE, LINK_PLANNED, LINK_GIVEN };
enum { LINK_NUMBERS = 2 }; /* of what the host is asked to plan, at most */
enum link_modes { LINK_RESTING, LINK_RUNNING, LINK_FAULTED, LINK_HOST_GONE, LINK_BRAKING };

/* The board's line. link_begin: it is opened. link_get: the next byte, -1: none has come. link_put never waits for long: what does not fit is
 * left out, and the host asks again. link_end: a frame is whole. */
void link_begin(void);
int link_get(void);
void link_put(uint8_t byte);
void link_end(void);

typedef struct {
    umo_machine *machine;
    int32_t *raws_in, *raws_out;
    uint8_t *failed_in;
    umo_frame_reader reader;
    uint8_t in[LINK_LONGEST + UMO_CRC_BYTES], out[LINK_LONGEST + UMO_CRC_BYTES];
    uint16_t length;            /* of what is in out */
    uint16_t offered, session;  /* 0: none */
    uint16_t begun;             /* the last session that there was: each is begun once */
    uint8_t nonce[4];           /* of the greeting that offered was for */
    uint16_t heard;             /* the number of the last frame of the host */
    uint32_t silent;            /* periods since then */
    umo_fault fault;
    int16_t fault_object;
    uint8_t mode;
    bool asked;                 /* the host waits for an answer */
    uint16_t asks;              /* the number of what the host is asked to plan; it is `asking` */
    uint8_t call;
    bool asking;
    bool wanted[LINK_CALLS + 1]; /* by call: it is asked for, or will be */
    uint8_t count[LINK_CALLS + 1];
    umo_real numbers[LINK_CALLS + 1][LINK_NUMBERS];
    uint8_t inhibits[LINK_BITS(MACHINE_OUTPUTS)];
} umo_link;

void umo_link_begin(umo_link *l, umo_machine *m, int32_t *raws_in, uint8_t *failed_in, int32_t *raws_out);

/* Once a period, before the inputs are read: what the host has sent. */
void umo_link_receive(umo_link *l);

/* Once a period, `ticks` after the last one: whether the laws are to be called. */
bool umo_link_count(umo_link *l, int32_t ticks);

/* At the end of a period: the answer, if the host waits for one. */
void umo_link_answer(umo_link *l);

#endif
