/* Values of a file, read and predicted round after round (surface/format/growth.py, positions.py and domains.py). */
#include "kernel.h"

/* Where values are read to, d numbers each.  solver/native/reading.py has the same fields in the same order. */
typedef struct {
    StoredNumbers *numbers;
    const uint8_t *has_table; /* (contexts) */
    int64_t contexts;
    const double *bound;      /* (contexts - 1): what is expected, in steps, at most in each context but the last */
    double largest;           /* of all values */
    double *value, *size;     /* (N, d): the values, and how far they were from their predictions */
} ReadValues;

/* Products and quotients as NumPy has them: calls, so that they are not fused with sums, and sums not reordered. */
static ONE_COPY double product(double one, double other) { return one * other; }
static ONE_COPY double quotient(double one, double other) { return one / other; }

/* Read number `place`: what is predicted, and as many steps as the file says. */
static ONE_COPY Status read_value(const ReadValues *own, int64_t place, double predicted, double step, double expected) {
    double steps = quotient(expected, step);
    int64_t context = 0, number;
    while (context < own->contexts - 1 && !(steps <= own->bound[context])) context++;
    if (!own->has_table[context]) return NO_TABLE;
    if (!next_number(own->numbers, context, &number)) return CUT_SHORT;
    double move = product((double)number, step);
    own->size[place] = fabs(move);
    own->value[place] = predicted + move;
    return fabs(own->value[place]) <= own->largest ? DONE : TOO_LARGE;
}

/* The links that lead to a round's places. */
static Round links_of_round(const Order *order, int64_t round) {
    int64_t first = order->links[round];
    return (Round){order->links[round + 1] - first, order->places[round + 1] - order->places[round],
                   order->link + first, order->owner + first};
}

static int64_t largest_round(const Order *order) {
    int64_t most = 1;
    for (int64_t k = 0; k < order->rounds; k++)
        if (order->places[k + 1] - order->places[k] > most) most = order->places[k + 1] - order->places[k];
    return most;
}

static int32_t read_round_of_positions(const Links *links, const ReadValues *own, const Order *order, int64_t round,
                                       const double *step, double *mean) {
    Round used = links_of_round(order, round);
    int32_t status = sum_positions(&used, links->row, own->value, own->size, mean);
    for (int64_t n = 0; n < used.owners && !status; n++) {
        int64_t place = order->place[order->places[round] + n];
        for (int k = 0; k < 3 && !status; k++)
            status = read_value(own, 3 * place + k, mean[6 * n + k], step[place], mean[6 * n + 3 + k]);
    }
    return status;
}

/* Read positions of all vertices that links (Q, 4) lead to from those that are `known`, with steps (V). */
int32_t ENTRY(read_positions)(const Links *links, const ReadValues *own, uint8_t *known, const double *step) {
    Order order = {.known = known};
    int32_t status = find_own_rounds(links, &order);
    double *mean = status ? NULL : malloc((size_t)largest_round(&order) * 6 * sizeof *mean);
    if (!status && !mean) status = OUT_OF_MEMORY;
    for (int64_t k = 0; k < order.rounds && !status; k++)
        status = read_round_of_positions(links, own, &order, k, step, mean);
    free(mean);
    free(order.place);
    return status;
}

/* How domains are found: limits.  solver/native/reading.py has the same fields in the same order. */
typedef struct {
    double expected, largest_start, anywhere, least_speed, largest_speed;
} DomainLimits;

/* What domains are read by.  solver/native/reading.py has the same fields in the same order. */
typedef struct {
    const Unfolded *triangles;
    const SparsePatches *functions;
    const Damping *damping;
    const DomainLimits *limits;
    const double *target; /* (M, r) */
    const double *step;   /* (M), in the patches' frames */
    const int32_t *patch; /* (M) */
    double *off;          /* (M, 2): how far domains are from where they were nearest to their targets */
} Domains;

enum { SETTLED_TOGETHER = 64 };

/* Start from where links suggest, in means (n, 5), or from the middle where there are none. */
static void begin_at(const Domains *own, const double *mean, int64_t n, double *start) {
    for (int k = 0; k < 2; k++) {
        double suggested = mean ? mean[5 * n + k] : 0.0;
        start[k] = fabs(suggested) <= own->limits->largest_start ? suggested : 0.0;
    }
}

static double limited_speed(const DomainLimits *limits, double speed) {
    if (!isfinite(speed)) return limits->largest_speed;
    return fmin(fmax(speed, limits->least_speed), limits->largest_speed);
}

/* Read the domain of one patch vertex that is `nearest` (2) to its target at a speed (2). */
static Status read_domain(const Domains *own, const ReadValues *values, int64_t place, const double *nearest,
                          const double *speed, const double *mean /* (5) or NULL */) {
    Status status = DONE;
    for (int k = 0; k < 2 && !status; k++) {
        double expected = mean ? mean[2 + k] : 0.0, size = mean ? mean[4] : own->limits->anywhere;
        double step = quotient(own->step[place], limited_speed(own->limits, speed[k]));
        double predicted = nearest[k] + product(own->limits->expected, expected);
        status = read_value(values, 2 * place + k, predicted, step, size);
        own->off[2 * place + k] = values->value[2 * place + k] - nearest[k];
    }
    return status;
}

/* Settle places (count), by the means (n, 5) of what is suggested for them, or without where that is NULL. */
static int32_t settle(const Domains *own, const ReadValues *values, const int64_t *place, int64_t count,
                      const double *mean) {
    double start[2 * SETTLED_TOGETHER], nearest[2 * SETTLED_TOGETHER], speed[2 * SETTLED_TOGETHER];
    double target[3 * SETTLED_TOGETHER];
    int64_t patch[SETTLED_TOGETHER], signals = own->functions->signals;
    int32_t status = DONE;
    for (int64_t first = 0; first < count && !status; first += SETTLED_TOGETHER) {
        int64_t some = count - first < SETTLED_TOGETHER ? count - first : SETTLED_TOGETHER;
        for (int64_t n = 0; n < some; n++) {
            int64_t at = place[first + n];
            begin_at(own, mean, first + n, start + 2 * n);
            patch[n] = own->patch[at];
            memcpy(target + n * signals, own->target + at * signals, (size_t)signals * sizeof *target);
        }
        status = step_all(own->functions, own->damping, some, patch, start, target, nearest, speed);
        for (int64_t n = 0; n < some && !status; n++) {
            const double *row = mean ? mean + 5 * (first + n) : NULL;
            status = read_domain(own, values, place[first + n], nearest + 2 * n, speed + 2 * n, row);
        }
    }
    return status;
}

/* Settle places that are known, or are not known: nothing is suggested for them. */
static int32_t settle_unpredicted(const Domains *own, const ReadValues *values, const uint8_t *known, bool which,
                                  int64_t count) {
    int32_t status = DONE;
    for (int64_t place = 0; place < count && !status; place++)
        if ((known[place] != 0) == which) status = settle(own, values, &place, 1, NULL);
    return status;
}

/* Read the domains of all patch vertices (M); rounds grow from the `known` ones. */
int32_t ENTRY(read_domains)(const Links *links, const ReadValues *values, const Domains *own, uint8_t *known) {
    Order order = {.known = known};
    int32_t status = settle_unpredicted(own, values, known, true, links->places);
    if (!status) status = find_own_rounds(links, &order);
    double *mean = status ? NULL : malloc((size_t)largest_round(&order) * 5 * sizeof *mean);
    if (!status && !mean) status = OUT_OF_MEMORY;
    for (int64_t k = 0; k < order.rounds && !status; k++) {
        Round used = links_of_round(&order, k);
        status = sum_domains(&used, own->triangles, values->value, own->off, values->size, mean);
        if (!status) status = settle(own, values, order.place + order.places[k], used.owners, mean);
    }
    if (!status) status = settle_unpredicted(own, values, known, false, links->places);
    free(mean);
    free(order.place);
    return status;
}
