/* What the library says of itself: which of its instruction sets this processor has, and which sources it was built
 * from. */
#include "kernel.h"

#if defined(__x86_64__)
#include <cpuid.h>

/* What the operating system saves of the registers when it switches between threads. */
static uint64_t saved_registers(void) {
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return ((uint64_t)high << 32) | low;
}

/* 0: SSE2, 1: AVX2 with fused multiply-add (x86-64-v3), 2: AVX-512 (x86-64-v4). */
static int best_set(void) {
    enum { OSXSAVE = 1 << 27, AVX = 1 << 28, FMA = 1 << 12, MOVBE = 1 << 22, F16C = 1 << 29 };
    enum { AVX2 = 1 << 5, BMI = 1 << 3 | 1 << 8, SAVED_AVX = 0x6, SAVED_AVX512 = 0xe6, LZCNT = 1 << 5 };
    const unsigned first = OSXSAVE | AVX | FMA | MOVBE | F16C, second = AVX2 | BMI;
    const unsigned wide = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31; /* F, DQ, CD, BW, VL */
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & first) != first) return 0;
    uint64_t saved = saved_registers();
    if ((saved & SAVED_AVX) != SAVED_AVX) return 0;
    if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & LZCNT)) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & second) != second) return 0;
    return (b & wide) == wide && (saved & SAVED_AVX512) == SAVED_AVX512 ? 2 : 1;
}
#else
static int best_set(void) { return 0; }
#endif

EXPORTED int instruction_set(void) { return best_set(); }

/* STAMP comes from scripts/build_native.py; library.py compares it with the sources that lie beside it. */
EXPORTED const char *source_stamp(void) { return STAMP; }
