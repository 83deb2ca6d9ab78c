/* Whole numbers of a file, decoded one after the other (surface/format/entropy.py). */
#include "kernel.h"

enum { SCALE_BITS = 12, WORD_BITS = 16 };

/* Where reading stands.  solver/native/stored.py has the same fields in the same order. */
typedef struct {
    int64_t lanes, symbols;           /* how many there are: numbers take turns in the lanes; columns of the tables */
    int64_t words, bits;              /* how many there are */
    const uint8_t *symbol;            /* (contexts, 2^SCALE_BITS): what each slot of a context stands for */
    const uint64_t *frequency, *start; /* (contexts, symbols) */
    const uint64_t *word;             /* (words): what fills a state up */
    const uint8_t *bit;               /* the plain bits, and eight bytes more */
    uint64_t *state;                  /* (lanes) */
    int64_t taken, next_word, next_bit;
} StoredNumbers;

/* The next symbol of a context; -1 where the words are used up. */
static int64_t next_symbol(StoredNumbers *own, int64_t context) {
    uint64_t *state = own->state + own->taken++ % own->lanes, slot = *state & ((1u << SCALE_BITS) - 1);
    int64_t symbol = own->symbol[(context << SCALE_BITS) + (int64_t)slot], cell = context * own->symbols + symbol;
    *state = own->frequency[cell] * (*state >> SCALE_BITS) + slot - own->start[cell];
    if (*state >> WORD_BITS) return symbol;
    if (own->next_word == own->words) return -1;
    *state = *state << WORD_BITS | own->word[own->next_word++];
    return symbol;
}

/* The next number, of a context for which there is a table; false where there is none.  (Processors that the kernel is
 * built for have the lowest byte of a number first, as the file has.) */
static ONE_COPY bool next_number(StoredNumbers *own, int64_t context, int64_t *number) {
    int64_t symbol = next_symbol(own, context), bits = symbol < 4 ? 0 : (symbol >> 1) - 1;
    if (symbol < 0 || bits > own->bits - own->next_bit) return false;
    uint64_t window;
    memcpy(&window, own->bit + (own->next_bit >> 3), sizeof window);
    uint64_t plain = window >> (own->next_bit & 7) & (((uint64_t)1 << bits) - 1);
    uint64_t folded = symbol < 4 ? (uint64_t)symbol : (uint64_t)(2 + (symbol & 1)) << bits | plain;
    *number = (int64_t)(folded >> 1) ^ -(int64_t)(folded & 1);
    own->next_bit += bits;
    return true;
}

/* The next `count` numbers. */
int32_t ENTRY(next_numbers)(StoredNumbers *own, int64_t count, const int64_t *context, int64_t *number) {
    for (int64_t n = 0; n < count; n++)
        if (!next_number(own, context[n], number + n)) return CUT_SHORT;
    return DONE;
}
