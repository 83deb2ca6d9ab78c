/* The order in which whole numbers ascend (mesh/edges.py): a radix sort, from the lowest digits on. */
#include "kernel.h"

#define DIGIT_BITS 11
#define DIGITS (1 << DIGIT_BITS)

typedef struct {
    int64_t number, place;
} Entry;

/* Move entries to where they belong by one digit; equal ones keep their order. */
static void pass_over(const Entry *from, Entry *to, int64_t count, int shift) {
    int64_t starts[DIGITS + 1] = {0};
    for (int64_t k = 0; k < count; k++) starts[((from[k].number >> shift) & (DIGITS - 1)) + 1]++;
    for (int digit = 0; digit < DIGITS; digit++) starts[digit + 1] += starts[digit];
    for (int64_t k = 0; k < count; k++) to[starts[(from[k].number >> shift) & (DIGITS - 1)]++] = from[k];
}

/* The places of `numbers` (count), none below 0, as they ascend: `order` (count). */
int ENTRY(stable_order)(const int64_t *numbers, int64_t count, int64_t *order) {
    int64_t largest = 0;
    Entry *from = malloc(sizeof(Entry) * 2 * ((size_t)count + 1));
    if (!from) return OUT_OF_MEMORY;
    Entry *memory = from, *to = from + count;
    for (int64_t k = 0; k < count; k++) {
        from[k] = (Entry){numbers[k], k};
        if (numbers[k] > largest) largest = numbers[k];
    }
    for (int shift = 0; shift < 63 && largest >> shift; shift += DIGIT_BITS) {
        pass_over(from, to, count, shift);
        Entry *other = from;
        from = to;
        to = other;
    }
    for (int64_t k = 0; k < count; k++) order[k] = from[k].place;
    free(memory);
    return DONE;
}
