/* The partner of `pter hil`, for little-endian processors. After `pter export residual --c c`:
       cc -std=c99 -I c examples/serial_loop.c c/pter.c -o loop && pter hil residual ./loop */
#include <stdint.h>
#include <string.h>
#include "pter.h"
#if __STDC_HOSTED__ /* the line is standard input and output */
#include <stdio.h>
#define serial_get getchar
#define serial_put(bytes, n) (fwrite(bytes, 1, n, stdout), fflush(stdout))
#else /* a board brings its own; serial_get returns the next byte, or -1 at the end */
int serial_get(void); void serial_put(const unsigned char *bytes, int n);
#endif
enum { MOST_ARCS = 64, LARGEST = 20 + 56 * MOST_ARCS, READING = 84, ANSWER = 20 }; /* bytes */
static const uint32_t version = 1; /* of the protocol */
static uint32_t crc32(const unsigned char *bytes, int n) {
    uint32_t crc = ~UINT32_C(0);
    for (int k = 0; k < 8 * n; k++)
        crc = (crc >> 1) ^ (((crc ^ (uint32_t)bytes[k / 8] >> k % 8) & 1) * UINT32_C(0xEDB88320));
    return ~crc;
}
static int unstuff(unsigned char *frame, int size) { /* undo COBS in place */
    int n = 0, left = 0, code = 255;
    for (int at = 0; at < size; at++, left--)
        if (left > 0) frame[n++] = frame[at];
        else n += code < 255 ? (frame[n] = 0, 1) : 0, code = left = frame[at];
    return n;
}
static void answer(uint32_t number, const void *rest, int n) {
    unsigned char frame[ANSWER + 6], *data = frame + 1, *block = frame;
    memcpy(data, &number, 4), memcpy(data + 4, rest, (size_t)n), n += 4;
    number = crc32(data, n), memcpy(data + n, &number, 4), data[n + 4] = 0;
    for (unsigned char *at = data; at <= data + n + 4; at++) /* COBS: zeros become distances */
        if (*at == 0) *block = (unsigned char)(at - block), block = at;
    serial_put(frame, n + 6);
}
static void take(pter_real *to, const unsigned char *from, int n) {
    for (double x; n-- > 0; from += 8) memcpy(&x, from, 8), *to++ = (pter_real)x;
}
int main(void) {
    static unsigned char in[LARGEST + 32];
    static pter_real arcs[7 * MOST_ARCS];
    static pter_state state;
    pter_path path = {arcs, 0, 0};
    pter_reading reading;
    for (int n = 0, byte; (byte = serial_get()) >= 0; n = byte ? n : 0) {
        uint32_t number, crc;
        float observation[PTER_ENTRIES], volts[4];
        if (byte) in[n] = (unsigned char)byte, n += n < (int)sizeof in - 1;
        if (byte || (n = unstuff(in, n) - 4) < 4) continue;
        if (memcpy(&crc, in + n, 4), crc != crc32(in, n)) continue;
        memcpy(&number, in, 4);
        if (number == 0) { /* an episode begins: version, pace and path */
            if (n >= 16 && n <= LARGEST - 4 && !memcmp(in + 4, &version, 4))
                take(&path.pace, in + 8, 1), take(arcs, in + 16, 7 * (path.count = (n - 16) / 56));
            pter_reset(&state);
            answer(0, &version, 4);
        } else if (n == READING) {
            take((pter_real *)&reading, in + 4, 10);
            pter_observe(&state, &reading, &path, observation);
            pter_act(&state, observation, volts);
            answer(number, volts, 16);
        }
    }
    return 0;
}
