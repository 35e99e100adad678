#include "processor_level.h"

#if defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>

static bool has_all(unsigned value, unsigned bits)
{
    return (value & bits) == bits;
}

int processor_level(void)
{
    const unsigned third[] = {bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C, bit_LZCNT,
                              bit_BMI | bit_AVX2 | bit_BMI2};
    const unsigned fourth = bit_AVX512F | bit_AVX512DQ | bit_AVX512CD | bit_AVX512BW | bit_AVX512VL;
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !has_all(c, third[0]))
        return 1;
    unsigned saved, high;
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0)); /* registers that the system saves */
    if (!has_all(saved, 0x06) || !__get_cpuid(0x80000001, &a, &b, &c, &d) || !has_all(c, third[1]))
        return 1;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !has_all(b, third[2]))
        return 1;
    return has_all(b, fourth) && has_all(saved, 0xe6) ? 4 : 3;
}
#else
int processor_level(void)
{
    return 1;
}
#endif
