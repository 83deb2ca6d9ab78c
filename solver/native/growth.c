/* In which order values are predicted (surface/format/growth.py). */
#include "kernel.h"

/* Q links that each name a target and `width` places that predict it.  solver/native/stored.py has the same fields in
 * the same order. */
typedef struct {
    int64_t links, width, places; /* Q, n, N */
    const int32_t *row;           /* (Q, 1 + n): the target first */
} Links;

static inline const int32_t *row_of(const Links *own, int64_t link) { return own->row + link * (own->width + 1); }

/* What becomes known in which round. */
typedef struct {
    uint8_t *known;   /* (N): at the start, and then at the end */
    int64_t *place;   /* (N): round after round */
    int64_t *link;    /* (Q): those that predict them, round after round */
    int64_t *owner;   /* (Q): the position of each link's target among the places of its round */
    int64_t *places, *links; /* (N + 1): where each round ends in these */
    int64_t rounds;
} Order;

/* A link waits for one of its places that is not known yet; the links that wait for a place are a list. */
typedef struct {
    int32_t *first, *next; /* of each place (N), and of each link (Q); NONE at the end */
} WaitingLinks;

enum { NONE = -1 };

/* Let a link wait for a place; false where all of them are known. */
static bool waits(const Links *own, const Order *order, WaitingLinks *waiting, int64_t link) {
    const int32_t *row = row_of(own, link);
    for (int64_t k = 1; k <= own->width; k++) {
        if (order->known[row[k]]) continue;
        waiting->next[link] = waiting->first[row[k]];
        waiting->first[row[k]] = (int32_t)link;
        return true;
    }
    return false;
}

/* Put the numbers whose marks are set in ascending order, each once, and take the marks away. */
static int64_t each_once(const int64_t *numbers, int64_t count, uint8_t *marks, int64_t *found) {
    int64_t low = INT64_MAX, high = -1, made = 0;
    for (int64_t k = 0; k < count; k++) {
        marks[numbers[k]] = 1;
        low = numbers[k] < low ? numbers[k] : low;
        high = numbers[k] > high ? numbers[k] : high;
    }
    for (int64_t n = low; n <= high; n += 8) { /* nearly all are unset: eight at a time */
        uint64_t eight;
        memcpy(&eight, marks + n, sizeof eight);
        for (int64_t k = n; eight && k < n + 8; k++)
            if (marks[k]) found[made++] = k;
        memset(marks + n, 0, sizeof eight);
    }
    return made;
}

/* One round: `count` links are ready; they and their targets, which are known from now on, are put in order. */
static void finish_round(const Links *own, Order *order, int64_t count, uint8_t *marks, int64_t *position) {
    int64_t *link = order->link + order->links[order->rounds], *owner = order->owner + order->links[order->rounds];
    int64_t *place = order->place + order->places[order->rounds];
    each_once(link, count, marks, link);
    for (int64_t k = 0; k < count; k++) owner[k] = *row_of(own, link[k]);
    int64_t places = each_once(owner, count, marks, place);
    for (int64_t k = 0; k < places; k++) {
        position[place[k]] = k;
        order->known[place[k]] = 1;
    }
    for (int64_t k = 0; k < count; k++) owner[k] = position[owner[k]];
    order->rounds++;
    order->links[order->rounds] = order->links[order->rounds - 1] + count;
    order->places[order->rounds] = order->places[order->rounds - 1] + places;
}

/* Note the links that waited for a place, wait for no other, and have a target that is not known; return how many. */
static int64_t wake(const Links *own, Order *order, WaitingLinks *waiting, int64_t place, int64_t *ready) {
    int64_t count = 0;
    for (int32_t link = waiting->first[place], next; link != NONE; link = next) {
        next = waiting->next[link];
        if (!order->known[*row_of(own, link)] && !waits(own, order, waiting, link)) ready[count++] = link;
    }
    return count;
}

static void grow(const Links *own, Order *order, WaitingLinks *waiting, uint8_t *marks, int64_t *position) {
    int64_t count = 0;
    order->rounds = order->links[0] = order->places[0] = 0;
    for (int64_t q = 0; q < own->links; q++)
        if (!order->known[*row_of(own, q)] && !waits(own, order, waiting, q)) order->link[count++] = q;
    while (count) {
        finish_round(own, order, count, marks, position);
        count = 0;
        for (int64_t p = order->places[order->rounds - 1]; p < order->places[order->rounds]; p++)
            count += wake(own, order, waiting, order->place[p], order->link + order->links[order->rounds] + count);
    }
}

/* Find all rounds; every number of `own` names something that is there. */
static int32_t find_rounds(const Links *own, Order *order) {
    if (own->links > INT32_MAX || own->places > INT32_MAX) return OUT_OF_MEMORY;
    int64_t most = own->places > own->links ? own->places : own->links;
    int64_t *position = malloc(((size_t)own->places + 1) * sizeof *position);
    WaitingLinks waiting = {.first = malloc(((size_t)own->places + (size_t)own->links + 1) * sizeof(int32_t))};
    uint8_t *marks = calloc((size_t)most + 8, 1);
    bool room = position && waiting.first && marks;
    if (room) {
        waiting.next = waiting.first + own->places;
        for (int64_t p = 0; p < own->places; p++) waiting.first[p] = NONE;
        grow(own, order, &waiting, marks, position);
    }
    free(position);
    free(waiting.first);
    free(marks);
    return room ? DONE : OUT_OF_MEMORY;
}

int32_t ENTRY(growth)(const Links *own, Order *order) { return find_rounds(own, order); }

/* Find them into memory of their own, which begins at `place`. */
static int32_t find_own_rounds(const Links *own, Order *order) {
    size_t places = (size_t)own->places + 1, links = (size_t)own->links;
    int64_t *memory = malloc((3 * places + 2 * links) * sizeof *memory);
    if (!memory) return OUT_OF_MEMORY;
    order->place = memory;
    order->places = memory + places;
    order->links = order->places + places;
    order->link = order->links + places;
    order->owner = order->link + links;
    return find_rounds(own, order);
}
