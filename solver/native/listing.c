/* The order in which a mesh lists its faces or vertices (surface/format/listing.py says what moves and jumps are). */
#include "kernel.h"

enum { NOWHERE = -1 };

/* An order of n items, whose places are the corners of triangles.  solver/native/stored.py has the same fields in the
 * same order. */
typedef struct {
    int64_t items, backs, jumps;                  /* n, and the lengths of `back` and of `jump` and `turn` */
    const int64_t *opposite, *item, *first;       /* of each corner, and the first corner of each item */
    const int64_t *move, *back, *jump, *turn;     /* what a file says, in range each */
    int64_t *place;                               /* (n) */
} Listing;

static int64_t turned(int64_t place, int64_t turn) {
    return place - place % 3 + (place + turn) % 3;
}

/* Go over the sides of a path: three paths go over one, twice as many over two, and again over three. */
static int64_t over_sides(const int64_t *opposite, int64_t place, int64_t path) {
    if (path >= 4) {
        int64_t begin = path >= 10 ? 10 : 4, before = path >= 10 ? 4 : 1;
        place = over_sides(opposite, place, before + (path - begin) / 2);
        return place < 0 ? NOWHERE : opposite[turned(place, 1 + (path - begin) % 2)];
    }
    return path && place >= 0 ? opposite[turned(place, path - 1)] : place;
}

static int64_t moved(const int64_t *opposite, int64_t place, int64_t move) {
    int64_t end = over_sides(opposite, place, (move - 1) / 3);
    return end < 0 ? NOWHERE : turned(end, (move - 1) % 3);
}

/* Which of n numbers are left: a bit each, and sums of 64 bits each over ranges of words whose sizes are powers of two. */
typedef struct {
    int64_t words;
    uint64_t *bit; /* (words) */
    int64_t *sum;  /* (words + 1) */
} Left;

static bool all_left(Left *left, int64_t count) {
    left->words = count / 64 + 1;
    left->bit = malloc((size_t)left->words * sizeof *left->bit);
    left->sum = malloc(((size_t)left->words + 1) * sizeof *left->sum);
    if (!left->bit || !left->sum) return false;
    memset(left->bit, 0xff, (size_t)left->words * sizeof *left->bit);
    for (int64_t k = 0; k <= left->words; k++) left->sum[k] = 64 * (k & -k);
    return true;
}

/* The number that as many others that are left come before; there is one. */
static int64_t find_left(const Left *left, int64_t rank) {
    int64_t word = 0, size = 1;
    while (2 * size <= left->words) size *= 2;
    for (; size; size /= 2)
        if (word + size <= left->words && left->sum[word + size] <= rank) {
            word += size;
            rank -= left->sum[word];
        }
    uint64_t bits = left->bit[word];
    while (rank--) bits &= bits - 1;
    return 64 * word + __builtin_ctzll(bits);
}

/* Take a number away; false where it is not left. */
static bool take_away(Left *left, int64_t number) {
    uint64_t own = (uint64_t)1 << number % 64;
    if (!(left->bit[number / 64] & own)) return false;
    left->bit[number / 64] -= own;
    for (int64_t k = number / 64 + 1; k <= left->words; k += k & -k) left->sum[k]--;
    return true;
}

static int32_t list_places(const Listing *own, Left *left) {
    int64_t place = NOWHERE, back = NOWHERE, backs = 0, jumps = 0;
    for (int64_t n = 0; n < own->items; n++) {
        int64_t move = own->move[n];
        if (move) {
            place = moved(own->opposite, place, move);
        } else {
            if (backs == own->backs) return CUT_SHORT;
            move = own->back[backs++];
            if (move) {
                place = moved(own->opposite, back, move);
            } else {
                if (jumps == own->jumps || own->jump[jumps] >= own->items - n) return CUT_SHORT;
                place = turned(own->first[find_left(left, own->jump[jumps])], own->turn[jumps]);
                jumps++;
            }
            back = place;
        }
        if (place < 0 || !take_away(left, own->item[place])) return CUT_SHORT;
        own->place[n] = place;
    }
    return DONE;
}

/* Find the place to which each item leads. */
int32_t ENTRY(places_listed)(const Listing *own) {
    Left left = {0, NULL, NULL};
    int32_t status = all_left(&left, own->items) ? list_places(own, &left) : OUT_OF_MEMORY;
    free(left.bit);
    free(left.sum);
    return status;
}
