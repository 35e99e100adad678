#include "normal_number.h"

#include <math.h>

#define PI 0x1.921fb54442d18p+1

/* The 64-bit finaliser of SplitMix64 (Steele, Lea and Flood 2014). */
static uint64_t splitmix64(uint64_t key)
{
    key = (key ^ key >> 30) * 0xbf58476d1ce4e5b9u;
    key = (key ^ key >> 27) * 0x94d049bb133111ebu;
    return key ^ key >> 31;
}

double normal_number(uint64_t seed, uint64_t tick, uint64_t channel)
{
    const uint64_t golden = 0x9e3779b97f4a7c15u;
    const uint64_t key = splitmix64(splitmix64(splitmix64(seed + golden) + tick) + channel);
    const double first = ((double)(key >> 11) + 0.5) / 0x1p53;
    const double second = (double)(splitmix64(key + golden) >> 11) / 0x1p53;
    return sqrt(-2 * log(first)) * cos(2 * PI * second);
}
