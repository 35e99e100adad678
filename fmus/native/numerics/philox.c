#include "philox.h"

#include <string.h>

/* The 128 bits of a product, from products of halves. */
static void multiply_words(uint64_t a, uint64_t b, uint64_t *high, uint64_t *low)
{
    const uint64_t half = 0xffffffffu;
    const uint64_t lows = (a & half) * (b & half);
    const uint64_t middle = (a >> 32) * (b & half) + (lows >> 32);
    const uint64_t other = (a & half) * (b >> 32) + (middle & half);
    *high = (a >> 32) * (b >> 32) + (middle >> 32) + (other >> 32);
    *low = a * b;
}

void philox(uint64_t count, uint64_t low, uint64_t high, uint64_t words[4])
{
    uint64_t counter[4] = {count, 0, 0, 0};
    for (int round = 0; round < 10; round++) {
        uint64_t first_high;
        uint64_t first_low;
        uint64_t second_high;
        uint64_t second_low;
        multiply_words(0xd2e7470ee14c6c93u, counter[0], &first_high, &first_low);
        multiply_words(0xca5a826395121157u, counter[2], &second_high, &second_low);
        counter[0] = second_high ^ counter[1] ^ low;
        counter[1] = second_low;
        counter[2] = first_high ^ counter[3] ^ high;
        counter[3] = first_low;
        low += 0x9e3779b97f4a7c15u;
        high += 0xbb67ae8584caa73bu;
    }
    memcpy(words, counter, sizeof counter);
}
