/* In which order values are predicted (surface/format/growth.py). */
#include "kernel.h"

/* Q links that each name a target and `width` places that predict it.  Places may stand in groups that no link leaves:
 * one after the other stays in a processor's cache.  solver/native/stored.py has the same fields in the same order. */
typedef struct {
    int64_t links, width, places; /* Q, n, N */
    const int32_t *row;           /* (Q, 1 + n): the target first */
    int64_t groups;
    const int64_t *group; /* (groups + 1): where the places of each begin */
} Links;

static inline const int32_t *row_of(const Links *own, int64_t link) { return own->row + link * (own->width + 1); }

/* What becomes known in which round. */
typedef struct {
    uint8_t *known;   /* (N): at the start, and then at the end */
    int64_t *place;   /* (N): round after round, ascending in each */
    int64_t *link;    /* (Q): those that predict them, round after round, ascending in each */
    int64_t *owner;   /* (Q): the position of each link's target among the places of its round */
    int64_t *places, *links; /* (N + 1): where each round ends in these */
    int64_t rounds;
} Order;

/* A link waits for one of its places; the links that wait for a place are a list. */
typedef struct {
    int32_t *round;        /* (N): in which a place becomes known; 0 at the start, NONE never */
    int32_t *first, *next; /* of each place (N), and of each link (Q); NONE at the end */
    int32_t *queue;        /* (N) */
} Growing;

enum { NONE = -1 };

/* Let a link wait for a place that is not known in a round; false where all are. */
static bool waits(const Links *own, Growing *growing, int64_t link, int32_t round) {
    const int32_t *row = row_of(own, link);
    for (int64_t k = 1; k <= own->width; k++) {
        int32_t known = growing->round[row[k]];
        if (known != NONE && known <= round) continue;
        growing->next[link] = growing->first[row[k]];
        growing->first[row[k]] = (int32_t)link;
        return true;
    }
    return false;
}

/* Find the rounds of the places from `first` to `end`, from those of the first round on. */
static void grow_group(const Links *own, Growing *growing, int64_t first, int64_t end) {
    int64_t reached = 0;
    for (int64_t place = first; place < end; place++)
        if (growing->round[place] == 1) growing->queue[reached++] = (int32_t)place;
    for (int64_t k = 0; k < reached; k++) {
        int32_t place = growing->queue[k], round = growing->round[place];
        for (int32_t link = growing->first[place], next; link != NONE; link = next) {
            next = growing->next[link];
            int32_t target = *row_of(own, link);
            if (growing->round[target] != NONE || waits(own, growing, link, round)) continue;
            growing->round[target] = round + 1;
            growing->queue[reached++] = target;
        }
    }
}

static void grow(const Links *own, Growing *growing) {
    for (int64_t place = 0; place < own->places; place++) growing->first[place] = NONE;
    for (int64_t q = 0; q < own->links; q++) {
        int32_t target = *row_of(own, q);
        if (growing->round[target] == NONE && !waits(own, growing, q, 0)) growing->round[target] = 1;
    }
    for (int64_t k = 0; k < own->groups; k++) grow_group(own, growing, own->group[k], own->group[k + 1]);
}

/* The round that a link is used in: all that predicts is known before it; or NONE. */
static int32_t round_of_link(const Links *own, const int32_t *round, int64_t link) {
    const int32_t *row = row_of(own, link);
    for (int64_t k = 1; k <= own->width; k++)
        if (round[row[k]] == NONE || round[row[k]] >= round[row[0]]) return NONE;
    return round[row[0]];
}

/* How many there are of each round, from 1 on, becomes where those of the next begin. */
static void sum_up(int64_t *ends, int64_t rounds) {
    for (int64_t k = 1; k <= rounds; k++) ends[k] += ends[k - 1];
}

/* Put places and links in order, by counting; `position` (N) is scratch memory. */
static void put_in_order(const Links *own, const int32_t *round, Order *order, int32_t *position) {
    order->rounds = 0;
    for (int64_t p = 0; p < own->places; p++)
        if (round[p] > order->rounds) order->rounds = round[p];
    memset(order->places, 0, ((size_t)order->rounds + 1) * sizeof *order->places);
    memset(order->links, 0, ((size_t)order->rounds + 1) * sizeof *order->links);
    for (int64_t p = 0; p < own->places; p++)
        if (round[p] > 0) position[p] = (int32_t)order->places[round[p]]++;
    sum_up(order->places, order->rounds);
    for (int64_t p = 0; p < own->places; p++) {
        if (round[p] > 0) order->place[order->places[round[p] - 1] + position[p]] = p;
        order->known[p] = round[p] != NONE;
    }
    for (int64_t q = 0; q < own->links; q++) {
        int32_t used = round_of_link(own, round, q);
        if (used > 0) order->links[used]++;
    }
    sum_up(order->links, order->rounds);
    for (int64_t q = 0; q < own->links; q++) {
        int32_t used = round_of_link(own, round, q);
        if (used <= 0) continue;
        int64_t at = order->links[used - 1]++; /* where each round begins becomes where it ends */
        order->link[at] = q;
        order->owner[at] = position[*row_of(own, q)];
    }
    memmove(order->links + 1, order->links, (size_t)order->rounds * sizeof *order->links);
    order->links[0] = 0;
}

/* Find all rounds; every number of `own` names something that is there. */
static int32_t find_rounds(const Links *own, Order *order) {
    if (own->links > INT32_MAX || own->places >= INT32_MAX) return OUT_OF_MEMORY;
    size_t places = (size_t)own->places;
    int32_t *memory = malloc((3 * places + (size_t)own->links + 1) * sizeof *memory);
    if (!memory) return OUT_OF_MEMORY;
    Growing growing = {memory, memory + places, memory + 3 * places, memory + 2 * places};
    for (size_t p = 0; p < places; p++) growing.round[p] = order->known[p] ? 0 : NONE;
    grow(own, &growing);
    put_in_order(own, growing.round, order, growing.queue);
    free(memory);
    return DONE;
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
