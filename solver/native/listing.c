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

/* Sums over ranges whose sizes are powers of two, (n + 1): how many numbers are left there. */
static int64_t found_left(const int64_t *sums, int64_t count, int64_t rank) {
    int64_t place = 0, size = 1;
    while (2 * size <= count) size *= 2;
    for (; size; size /= 2)
        if (place + size <= count && sums[place + size] <= rank) {
            place += size;
            rank -= sums[place];
        }
    return place;
}

static int32_t list_places(const Listing *own, int64_t *sums, uint8_t *taken) {
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
                place = turned(own->first[found_left(sums, own->items, own->jump[jumps])], own->turn[jumps]);
                jumps++;
            }
            back = place;
        }
        if (place < 0 || taken[own->item[place]]) return CUT_SHORT;
        taken[own->item[place]] = 1;
        for (int64_t k = own->item[place] + 1; k <= own->items; k += k & -k) sums[k]--;
        own->place[n] = place;
    }
    return DONE;
}

/* Find the place to which each item leads. */
int32_t ENTRY(places_listed)(const Listing *own) {
    size_t items = (size_t)own->items;
    int64_t *sums = malloc((items + 1) * sizeof *sums);
    uint8_t *taken = calloc(items + 1, 1);
    int32_t status = OUT_OF_MEMORY;
    if (sums && taken) {
        for (int64_t k = 0; k <= own->items; k++) sums[k] = k & -k;
        status = list_places(own, sums, taken);
    }
    free(sums);
    free(taken);
    return status;
}
