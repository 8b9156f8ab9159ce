/* umo_frames.c: frames of the link, without a heap and byte by byte. */
#include "umo_frames.h"

enum { LONGEST_RUN = 254 };

uint32_t umo_crc32(const uint8_t *bytes, uint16_t length)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (uint16_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
    }
    return ~crc;
}

static void again(umo_frame_reader *r)
{
    r->length = 0;
    r->code = r->left = 0;
    r->begun = r->bad = false;
}

void umo_frame_begin(umo_frame_reader *r, uint8_t *bytes, uint16_t size)
{
    r->bytes = bytes;
    r->size = size;
    r->damaged = 0;
    again(r);
}

static void add(umo_frame_reader *r, uint8_t byte)
{
    if (r->length < r->size)
        r->bytes[r->length++] = byte;
    else
        r->bad = true;
}

static bool whole(umo_frame_reader *r)
{
    if (r->bad || r->left || r->length <= UMO_CRC_BYTES)
        return false;
    uint16_t body = (uint16_t)(r->length - UMO_CRC_BYTES);
    uint32_t crc = umo_crc32(r->bytes, body);
    for (uint8_t i = 0; i < UMO_CRC_BYTES; i++)
        if (r->bytes[body + i] != (uint8_t)(crc >> 8 * i))
            return false;
    return true;
}

bool umo_frame_take(umo_frame_reader *r, uint8_t byte)
{
    if (byte) {
        if (!r->begun)
            again(r);
        if (r->left) {
            add(r, byte);
            r->left--;
            return false;
        }
        if (r->begun && r->code <= LONGEST_RUN)
            add(r, 0);
        r->begun = true;
        r->code = byte;
        r->left = (uint8_t)(byte - 1);
        return false;
    }
    if (!r->begun)
        return false; /* two zeros in a row */
    r->begun = false; /* the body stays until the next byte */
    if (whole(r)) {
        r->length = (uint16_t)(r->length - UMO_CRC_BYTES);
        return true;
    }
    r->damaged++;
    return false;
}

void umo_frame_send(uint8_t *bytes, uint16_t length, void (*put)(uint8_t byte))
{
    uint32_t crc = umo_crc32(bytes, length);
    for (uint8_t i = 0; i < UMO_CRC_BYTES; i++)
        bytes[length++] = (uint8_t)(crc >> 8 * i);
    put(0);
    uint16_t at = 0;
    bool ends = false; /* whether the last code has said all */
    while (!ends) {
        uint16_t end = at;
        while (end < length && bytes[end] && end - at < LONGEST_RUN)
            end++;
        put((uint8_t)(end - at + 1));
        ends = end == length;
        bool jumps = end - at < LONGEST_RUN; /* over a zero */
        while (at < end)
            put(bytes[at++]);
        if (!ends && jumps)
            at++;
    }
    put(0);
}
