/* The nearest triangles of a mesh (distance/targets.py): a search through boxes around groups of triangles.
 *
 * Eight boxes or triangles are looked at together, a row of eight numbers for each of their properties.  Neighbouring
 * places have neighbouring feet, so the search begins at the triangles where the last one ended. */
#include "kernel.h"

enum { GROUP = 8, MOST_LEVELS = 24, TRIANGLE_ROWS = 15, BOX_ROWS = 6 };

/* solver/native/nearest.py has the same fields in the same order. */
typedef struct {
    int64_t levels;          /* of boxes; those of level 0 are around blocks of triangles */
    const int64_t *first;    /* (levels): the first block of each level */
    const double *boxes;     /* (blocks, BOX_ROWS, GROUP): lowest x, y, z, highest x, y, z; empty ones fill blocks */
    const double *triangles; /* (blocks, TRIANGLE_ROWS, GROUP) */
    const int64_t *number;   /* (blocks, GROUP): of the triangles */
} Groups;

/* The nearest triangle so far, the first of equally near ones, and the shares of its sides at the foot. */
typedef struct {
    double squared, v, w;
    int64_t triangle, block, place;
} Found;

typedef struct {
    double squared;
    int64_t level, group;
} Waiting;

static double within_side(double x) { return smaller(larger(x, 0.0), 1.0); }

/* Squared distances of a place from the triangles of a block, and the shares of their sides at the feet.
 *
 * The squared distance is a quadratic function of the shares (v, w); its minimum over the triangle is the free minimum,
 * or lies on one of the sides v = 0, w = 0, v + w = 1.  In a thin triangle the free one may be all rounding, so it has to
 * be the smallest. */
static ONE_COPY void distances_from_block(const double *block, const double *place, double *restrict squared,
                                          double *restrict shares_v, double *restrict shares_w) {
    const double(*row)[GROUP] = (const double(*)[GROUP])block;
    for (int n = 0; n < GROUP; n++) {
        double x = place[0] - row[0][n], y = place[1] - row[1][n], z = place[2] - row[2][n];
        double ux = row[3][n], uy = row[4][n], uz = row[5][n], vx = row[6][n], vy = row[7][n], vz = row[8][n];
        double uu = row[9][n], uv = row[10][n], vv = row[11][n];
        double per_uu = row[12][n], per_vv = row[13][n], per_area = row[14][n];
        double pu = x * ux + y * uy + z * uz, pv = x * vx + y * vy + z * vz;
        double v = (vv * pu - uv * pv) * per_area, w = (uu * pv - uv * pu) * per_area;
        double at_free = v * (v * uu - 2.0 * pu) + w * (w * vv - 2.0 * pv) + 2.0 * v * w * uv;
        double third = uu - 2.0 * uv + vv, on_u = within_side(pu * per_uu), on_v = within_side(pv * per_vv);
        double across = within_side((uu - uv - pu + pv) / (third > 0.0 ? third : 1.0)), rest = 1.0 - across;
        double at_u = on_u * (on_u * uu - 2.0 * pu), at_v = on_v * (on_v * vv - 2.0 * pv);
        double at_third = rest * (rest * uu - 2.0 * pu) + across * (across * vv - 2.0 * pv) + 2.0 * rest * across * uv;
        bool use_v = at_v < at_u && at_v <= at_third, use_third = at_third < at_u && !use_v;
        double side_v = use_third ? rest : use_v ? 0.0 : on_u, side_w = use_third ? across : use_v ? on_v : 0.0;
        bool inside = v >= 0.0 && w >= 0.0 && v + w <= 1.0 && at_free <= smaller(at_u, smaller(at_v, at_third));
        v = inside ? v : side_v;
        w = inside ? w : side_w;
        x -= v * ux + w * vx;
        y -= v * uy + w * vy;
        z -= v * uz + w * vz;
        squared[n] = x * x + y * y + z * z;
        shares_v[n] = v;
        shares_w[n] = w;
    }
}

static ONE_COPY void try_block(const Groups *groups, int64_t block, const double *place, Found *found) {
    double squared[GROUP], v[GROUP], w[GROUP];
    const int64_t *number = groups->number + GROUP * block;
    distances_from_block(groups->triangles + TRIANGLE_ROWS * GROUP * block, place, squared, v, w);
    for (int n = 0; n < GROUP; n++) {
        if (squared[n] > found->squared || (squared[n] == found->squared && number[n] >= found->triangle)) continue;
        *found = (Found){squared[n], v[n], w[n], number[n], block, n};
    }
}

/* Put the groups of a block that may hold something nearer on the stack, the nearest last. */
static ONE_COPY void push_block(const Groups *groups, int64_t level, int64_t block, const double *place, double nearest,
                                Waiting *stack, int *height) {
    const double(*row)[GROUP] = (const double(*)[GROUP])(groups->boxes +
                                                         BOX_ROWS * GROUP * (groups->first[level] + block));
    double squared[GROUP];
    for (int n = 0; n < GROUP; n++) {
        double x = larger(0.0, larger(row[0][n] - place[0], place[0] - row[3][n]));
        double y = larger(0.0, larger(row[1][n] - place[1], place[1] - row[4][n]));
        double z = larger(0.0, larger(row[2][n] - place[2], place[2] - row[5][n]));
        squared[n] = (x * x + y * y + z * z) * (1.0 - 1e-12); /* a little less for rounding */
    }
    int bottom = *height;
    for (int n = 0; n < GROUP; n++) {
        if (!(squared[n] <= nearest)) continue;
        int at = (*height)++;
        for (; at > bottom && stack[at - 1].squared < squared[n]; at--) stack[at] = stack[at - 1];
        stack[at] = (Waiting){squared[n], level, GROUP * block + n};
    }
}

static void search(const Groups *groups, const double *place, Found *found) {
    Waiting stack[MOST_LEVELS * GROUP];
    int height = 0;
    int64_t tried = found->block;
    try_block(groups, tried, place, found);
    push_block(groups, groups->levels - 1, 0, place, found->squared, stack, &height);
    while (height) {
        Waiting next = stack[--height];
        if (next.squared > found->squared) continue;
        if (next.level)
            push_block(groups, next.level - 1, next.group, place, found->squared, stack, &height);
        else if (next.group != tried)
            try_block(groups, next.group, place, found);
    }
}

/* The place on a triangle of a block with these shares of its sides. */
static void foot_at(const Groups *groups, int64_t block, int64_t place, double v, double w, double *foot) {
    const double *row = groups->triangles + TRIANGLE_ROWS * GROUP * block + place;
    for (int d = 0; d < 3; d++) foot[d] = row[GROUP * d] + v * row[GROUP * (3 + d)] + w * row[GROUP * (6 + d)];
}

/* Find the nearest triangle of each of `count` places, (count, 3), and the foot there, (count, 3). */
int ENTRY(nearest_triangles)(const Groups *groups, const double *places, int64_t count, int64_t *triangle,
                             double *feet) {
    if (groups->levels > MOST_LEVELS) return UNKNOWN_FUNCTION;
    Found found = {.block = 0};
    for (int64_t k = 0; k < count; k++) {
        found.squared = INFINITY;
        found.triangle = INT64_MAX;
        search(groups, places + 3 * k, &found);
        triangle[k] = found.triangle;
        foot_at(groups, found.block, found.place, found.v, found.w, feet + 3 * k);
    }
    return DONE;
}

/* Find the foot of each of `count` places, (count, 3), on a triangle of its own, which stands at `slot` among all. */
void ENTRY(feet_on_triangles)(const Groups *groups, const double *places, int64_t count, const int64_t *slot,
                              double *feet) {
    for (int64_t k = 0; k < count; k++) {
        double squared[GROUP], v[GROUP], w[GROUP];
        int64_t block = slot[k] / GROUP, place = slot[k] % GROUP;
        distances_from_block(groups->triangles + TRIANGLE_ROWS * GROUP * block, places + 3 * k, squared, v, w);
        foot_at(groups, block, place, v[place], w[place], feet + 3 * k);
    }
}
