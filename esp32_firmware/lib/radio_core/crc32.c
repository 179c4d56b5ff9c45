#include "crc32.h"

#include "bytes.h"

/* Eight bytes at a time, by tables (Kounavis and Berry 2005). A table is linear: the entry of a byte is the
 * sum modulo 2 of the entries of its bits, so these are written down and the compiler adds the others up. */
#define BIT(i, bit, entry) (((i) & (1 << (bit))) != 0 ? (entry) : 0u)
#define ENTRY(i, b0, b1, b2, b3, b4, b5, b6, b7)                                                             \
    (BIT(i, 0, b0) ^ BIT(i, 1, b1) ^ BIT(i, 2, b2) ^ BIT(i, 3, b3) ^ BIT(i, 4, b4) ^ BIT(i, 5, b5) ^         \
     BIT(i, 6, b6) ^ BIT(i, 7, b7))

/* Of a byte that leaves the register, and of one that does so 1 .. 7 bytes later. */
#define LATER_0(i)                                                                                           \
    ENTRY(i, 0x77073096, 0xee0e612c, 0x076dc419, 0x0edb8832, 0x1db71064, 0x3b6e20c8, 0x76dc4190, 0xedb88320)
#define LATER_1(i)                                                                                           \
    ENTRY(i, 0x191b3141, 0x32366282, 0x646cc504, 0xc8d98a08, 0x4ac21251, 0x958424a2, 0xf0794f05, 0x3b83984b)
#define LATER_2(i)                                                                                           \
    ENTRY(i, 0x01c26a37, 0x0384d46e, 0x0709a8dc, 0x0e1351b8, 0x1c26a370, 0x384d46e0, 0x709a8dc0, 0xe1351b80)
#define LATER_3(i)                                                                                           \
    ENTRY(i, 0xb8bc6765, 0xaa09c88b, 0x8f629757, 0xc5b428ef, 0x5019579f, 0xa032af3e, 0x9b14583d, 0xed59b63b)
#define LATER_4(i)                                                                                           \
    ENTRY(i, 0x3d6029b0, 0x7ac05360, 0xf580a6c0, 0x30704bc1, 0x60e09782, 0xc1c12f04, 0x58f35849, 0xb1e6b092)
#define LATER_5(i)                                                                                           \
    ENTRY(i, 0xcb5cd3a5, 0x4dc8a10b, 0x9b914216, 0xec53826d, 0x03d6029b, 0x07ac0536, 0x0f580a6c, 0x1eb014d8)
#define LATER_6(i)                                                                                           \
    ENTRY(i, 0xa6770bb4, 0x979f1129, 0xf44f2413, 0x33ef4e67, 0x67de9cce, 0xcfbd399c, 0x440b7579, 0x8816eaf2)
#define LATER_7(i)                                                                                           \
    ENTRY(i, 0xccaa009e, 0x4225077d, 0x844a0efa, 0xd3e51bb5, 0x7cbb312b, 0xf9766256, 0x299dc2ed, 0x533b85da)

#define FOUR(entry, i) entry(i), entry((i) + 1), entry((i) + 2), entry((i) + 3)
#define SIXTEEN(entry, i) FOUR(entry, i), FOUR(entry, (i) + 4), FOUR(entry, (i) + 8), FOUR(entry, (i) + 12)
#define HALF(entry, i)                                                                                       \
    SIXTEEN(entry, i), SIXTEEN(entry, (i) + 16), SIXTEEN(entry, (i) + 32), SIXTEEN(entry, (i) + 48),         \
        SIXTEEN(entry, (i) + 64), SIXTEEN(entry, (i) + 80), SIXTEEN(entry, (i) + 96),                        \
        SIXTEEN(entry, (i) + 112)
#define TABLE(entry) {HALF(entry, 0), HALF(entry, 128)}

static const uint32_t later[8][256] = {
    TABLE(LATER_0), TABLE(LATER_1), TABLE(LATER_2), TABLE(LATER_3),
    TABLE(LATER_4), TABLE(LATER_5), TABLE(LATER_6), TABLE(LATER_7),
};

/* Four of the bytes meet the register, the others have tables of their own. */
static inline uint32_t with_eight(uint32_t crc, const uint8_t *eight) {
    crc ^= rc_take32(&eight);
    return later[7][crc & 255] ^ later[6][(crc >> 8) & 255] ^ later[5][(crc >> 16) & 255] ^
           later[4][crc >> 24] ^ later[3][eight[0]] ^ later[2][eight[1]] ^ later[1][eight[2]] ^
           later[0][eight[3]];
}

static inline uint32_t with_sixteen(uint32_t crc, const uint8_t *sixteen) {
    return with_eight(with_eight(crc, sixteen), sixteen + 8);
}

uint32_t rc_crc32(const uint8_t *bytes, size_t n) {
    uint32_t crc = 0xffffffffu;
    for (; n >= 32; n -= 32, bytes += 32)
        crc = with_sixteen(with_sixteen(crc, bytes), bytes + 16);
    for (; n >= 8; n -= 8, bytes += 8)
        crc = with_eight(crc, bytes);
    for (; n > 0; n--)
        crc = (crc >> 8) ^ later[0][(crc ^ *bytes++) & 255];
    return ~crc;
}
