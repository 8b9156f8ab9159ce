/* umo_frames.h: frames on the line between host and controller: a body, its CRC-32, made free of zeros (COBS), between
 * two zeros. The same is in Python in umo.generate.split.link_frames; docs/split-protocol.md describes it. */
#ifndef UMO_FRAMES_H
#define UMO_FRAMES_H

#include <stdbool.h>
#include <stdint.h>

enum { UMO_CRC_BYTES = 4 };

/* What comes in, byte by byte. `bytes` has room for the longest body and its CRC-32. */
typedef struct {
    uint8_t *bytes;
    uint16_t size;   /* of bytes */
    uint16_t length; /* of the body, once it is whole */
    uint16_t damaged; /* frames that were not whole, or whose CRC-32 was wrong */
    uint8_t code, left;
    bool begun, bad;
} umo_frame_reader;

void umo_frame_begin(umo_frame_reader *r, uint8_t *bytes, uint16_t size);

/* One byte from the line. True: a whole body is in bytes, length of them; it stays until the next call. */
bool umo_frame_take(umo_frame_reader *r, uint8_t byte);

/* Sends a body as a frame. `bytes` has room for UMO_CRC_BYTES more, which are changed. */
void umo_frame_send(uint8_t *bytes, uint16_t length, void (*put)(uint8_t byte));

uint32_t umo_crc32(const uint8_t *bytes, uint16_t length);

#endif
