/* The order in which whole numbers ascend (mesh/edges.py): a radix sort, from the lowest digits on. */
#include "kernel.h"

#define DIGIT_BITS 11
#define DIGITS (1 << DIGIT_BITS)

typedef struct {
    int64_t number, place;
} Entry;

/* Bits that a number from 0 on takes. */
static int bits_of(int64_t number) {
    int bits = 0;
    while (number >> bits) bits++;
    return bits;
}

/* How often each digit occurs becomes where its entries begin. */
static void begin_after(int64_t *starts) {
    int64_t before = 0;
    for (int digit = 0; digit < DIGITS; digit++) {
        int64_t own = starts[digit];
        starts[digit] = before;
        before += own;
    }
}

/* Order numbers that fit into a word together with their places: half of what `Entry` takes is moved, and all digits are
 * counted at once. */
static Status order_words(const int64_t *numbers, int64_t count, int bits, int place_bits, int64_t *order) {
    int digits = (bits + DIGIT_BITS - 1) / DIGIT_BITS;
    uint64_t *memory = malloc(sizeof(uint64_t) * 2 * ((size_t)count + 1)), *from = memory, *to = memory + count;
    int64_t *starts = calloc((size_t)digits * DIGITS + 1, sizeof(int64_t));
    if (!memory || !starts) {
        free(memory), free(starts);
        return OUT_OF_MEMORY;
    }
    for (int64_t k = 0; k < count; k++) {
        uint64_t number = (uint64_t)numbers[k];
        from[k] = number << place_bits | (uint64_t)k;
        for (int d = 0; d < digits; d++) starts[d * DIGITS + ((number >> (d * DIGIT_BITS)) & (DIGITS - 1))]++;
    }
    for (int d = 0; d < digits; d++) {
        int64_t *own = starts + d * DIGITS;
        int shift = place_bits + d * DIGIT_BITS;
        begin_after(own);
        for (int64_t k = 0; k < count; k++) to[own[(from[k] >> shift) & (DIGITS - 1)]++] = from[k];
        uint64_t *other = from;
        from = to, to = other;
    }
    for (int64_t k = 0; k < count; k++) order[k] = (int64_t)(from[k] & (((uint64_t)1 << place_bits) - 1));
    free(memory), free(starts);
    return DONE;
}

/* Move entries to where they belong by one digit; equal ones keep their order. */
static void pass_over(const Entry *from, Entry *to, int64_t count, int shift) {
    int64_t starts[DIGITS] = {0};
    for (int64_t k = 0; k < count; k++) starts[(from[k].number >> shift) & (DIGITS - 1)]++;
    begin_after(starts);
    for (int64_t k = 0; k < count; k++) to[starts[(from[k].number >> shift) & (DIGITS - 1)]++] = from[k];
}

/* The places of `numbers` (count), none below 0, as they ascend: `order` (count). */
int ENTRY(stable_order)(const int64_t *numbers, int64_t count, int64_t *order) {
    int64_t largest = 0;
    for (int64_t k = 0; k < count; k++)
        if (numbers[k] > largest) largest = numbers[k];
    int bits = bits_of(largest), place_bits = bits_of(count);
    if (bits + place_bits <= 64) return order_words(numbers, count, bits, place_bits, order);
    Entry *from = malloc(sizeof(Entry) * 2 * ((size_t)count + 1));
    if (!from) return OUT_OF_MEMORY;
    Entry *memory = from, *to = from + count;
    for (int64_t k = 0; k < count; k++) from[k] = (Entry){numbers[k], k};
    for (int shift = 0; shift < bits; shift += DIGIT_BITS) {
        pass_over(from, to, count, shift);
        Entry *other = from;
        from = to, to = other;
    }
    for (int64_t k = 0; k < count; k++) order[k] = from[k].place;
    free(memory);
    return DONE;
}
