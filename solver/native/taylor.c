/* Taylor models of patches over triangles of the plane (surface/taylor.py): polynomials of degree m - 1 about the
 * triangles' centres, and bounds of what they leave out.
 */
#include "kernel.h"

enum { MOST_ORDER = 8, MOST_SLOPES = MOST_ORDER * (MOST_ORDER + 1) / 2, MODELS = 32 };

/* Largest derivatives of the one-variable polynomials over cells of the parameter (surface/taylor.py,
 * DerivativeBounds). */
typedef struct {
    double low, width;
    int64_t order, cells; /* m */
    const double *levels; /* (levels, m + 1, cells, t + 1) */
} Limits;

/* The polynomials about the centres of a block of triangles, and their largest derivatives there.  Index 0 is u, 1 is
 * v.  A row has a number for each triangle of the block, and what fills it up to `lanes`. */
typedef struct {
    int order, lanes;
    int32_t *degree_u, *degree_v;
    double *corner[3][2];                  /* (lanes): of the triangles */
    double *centre[2], *extent[2];         /* (lanes) */
    double *derivatives[2][MOST_ORDER];    /* (t + 1, lanes) */
    double *largest[2][MOST_ORDER + 1];    /* (t + 1, lanes) */
    double *slopes[3][MOST_SLOPES];        /* (lanes): derivatives d^(a + b) h / du^a dv^b of the coordinates */
    double *remainders[3][MOST_ORDER + 1]; /* (lanes) */
    double *powers[2];                     /* (m + 1, lanes) */
} Expansion;

static void lay_out_expansion(const Functions *functions, Expansion *own, Arena *arena) {
    int size = dictionary_size((int)functions->degree), order = own->order;
    size_t table = (size_t)(functions->degree + 1) * MODELS;
    own->degree_u = take_integers(arena, size);
    own->degree_v = take_integers(arena, size);
    for (int x = 0; x < 2; x++) {
        for (int k = 0; k < 3; k++) own->corner[k][x] = take_doubles(arena, MODELS);
        own->centre[x] = take_doubles(arena, MODELS);
        own->extent[x] = take_doubles(arena, MODELS);
        own->powers[x] = take_doubles(arena, (size_t)(order + 1) * MODELS);
        for (int a = 0; a < order; a++) own->derivatives[x][a] = take_doubles(arena, table);
        for (int a = 0; a <= order; a++) own->largest[x][a] = take_doubles(arena, table);
    }
    for (int axis = 0; axis < 3; axis++) {
        for (int k = 0; k < order * (order + 1) / 2; k++) own->slopes[axis][k] = take_doubles(arena, MODELS);
        for (int a = 0; a <= order; a++) own->remainders[axis][a] = take_doubles(arena, MODELS);
    }
    if (arena->memory) dictionary_degrees((int)functions->degree, own->degree_u, own->degree_v);
}

static int64_t cell_of(const Limits *limits, double x) {
    double cell = (x - limits->low) / limits->width;
    return cell < 0.0 ? 0 : cell < (double)limits->cells ? (int64_t)cell : limits->cells - 1;
}

/* Column n of `largest` over the interval [low, high] of one parameter. */
static ONE_COPY void limits_over(const Limits *limits, double low, double high, int rows, int n, int lanes,
                                 double *const *largest) {
    int64_t first = cell_of(limits, low), last = cell_of(limits, high), level = 0;
    while (((int64_t)2 << level) <= last - first + 1) level++;
    int64_t second = last + 1 - ((int64_t)1 << level);
    for (int a = 0; a <= limits->order; a++) {
        const double *own = limits->levels + (size_t)((level * (limits->order + 1) + a) * limits->cells) * rows;
        const double *one = own + first * rows, *other = own + second * rows;
        for (int i = 0; i < rows; i++) largest[a][(size_t)i * lanes + n] = larger(one[i], other[i]);
    }
}

/* Expand the polynomials about the centres of `count` triangles. */
static void expand(const Functions *functions, const Limits *limits, Expansion *own, int count) {
    int degree = (int)functions->degree, lanes = own->lanes;
    bool legendre = functions->legendre != 0;
    for (int x = 0; x < 2; x++) {
        for (int n = 0; n < lanes; n++) {
            double one = own->corner[0][x][n], two = own->corner[1][x][n], three = own->corner[2][x][n];
            double centre = (one + two + three) / 3.0;
            double low = smaller(one, smaller(two, three)), high = larger(one, larger(two, three));
            own->centre[x][n] = centre;
            own->extent[x][n] = larger(high - centre, centre - low);
            if (n < count) limits_over(limits, low, high, degree + 1, n, lanes, own->largest[x]);
        }
        polynomial_tables(own->derivatives[x][0], own->centre[x], NULL, degree, legendre, lanes);
        for (int a = 1; a < own->order; a++)
            derivative_tables(own->derivatives[x][a], lanes, own->derivatives[x][a - 1], lanes, degree, legendre, lanes);
    }
}

/* Sums over the chosen functions of one coordinate: its derivatives at the centres, and its largest of order m. */
static ONE_COPY void sum_functions(const Functions *functions, Expansion *own, int64_t patch, int axis) {
    size_t row = ((size_t)patch * 3 + axis) * functions->width, bytes = sizeof(double) * (size_t)own->lanes;
    int order = own->order, lanes = own->lanes;
    for (int k = 0; k < order * (order + 1) / 2; k++) memset(own->slopes[axis][k], 0, bytes);
    for (int a = 0; a <= order; a++) memset(own->remainders[axis][a], 0, bytes);
    for (int64_t k = 0; k < functions->width; k++) {
        int64_t number = functions->support[row + k];
        if (number < 0) continue;
        double coefficient = functions->coefficients[row + k], size = fabs(coefficient);
        int degree_u = own->degree_u[number], degree_v = own->degree_v[number];
        size_t i = (size_t)degree_u * lanes, j = (size_t)degree_v * lanes;
        /* higher derivatives of these polynomials are zero */
        for (int a = 0, slope = 0; a < order; slope += order - a, a++)
            for (int b = 0; a <= degree_u && b < order - a && b <= degree_v; b++) {
                const double *restrict u = own->derivatives[0][a] + i, *restrict v = own->derivatives[1][b] + j;
                double *restrict sum = own->slopes[axis][slope + b];
                for (int n = 0; n < lanes; n++) sum[n] += coefficient * u[n] * v[n];
            }
        for (int a = 0; a <= order && a <= degree_u; a++) {
            if (order - a > degree_v) continue;
            const double *restrict u = own->largest[0][a] + i, *restrict v = own->largest[1][order - a] + j;
            double *restrict sum = own->remainders[axis][a];
            for (int n = 0; n < lanes; n++) sum[n] += size * u[n] * v[n];
        }
    }
}

/* Powers x^a / a! for a <= m of a block's numbers, a row an exponent. */
static ONE_COPY void powers(const double *x, int order, int lanes, double *restrict out) {
    for (int n = 0; n < lanes; n++) out[n] = 1.0;
    for (int a = 1; a <= order; a++)
        for (int n = 0; n < lanes; n++) out[a * lanes + n] = out[(a - 1) * lanes + n] * x[n] / a;
}

/* Powers of the ways from the centres to the place with these barycentric coordinates, for u and v. */
static void powers_at(Expansion *own, const double *place) {
    double away[MODELS];
    for (int x = 0; x < 2; x++) {
        const double *one = own->corner[0][x], *two = own->corner[1][x], *three = own->corner[2][x];
        const double *centre = own->centre[x];
        for (int n = 0; n < own->lanes; n++)
            away[n] = place[0] * (one[n] - centre[n]) + place[1] * (two[n] - centre[n]) +
                      place[2] * (three[n] - centre[n]);
        powers(away, own->order, own->lanes, own->powers[x]);
    }
}

/* The Taylor polynomials of one coordinate at the place of `powers_at`. */
static ONE_COPY void polynomials_at(const Expansion *own, int axis, double *restrict values) {
    int lanes = own->lanes;
    for (int n = 0; n < lanes; n++) values[n] = 0.0;
    for (int a = 0, slope = 0; a < own->order; slope += own->order - a, a++) {
        double across[MODELS];
        for (int n = 0; n < lanes; n++) across[n] = 0.0;
        for (int b = 0; b < own->order - a; b++) {
            const double *restrict v = own->powers[1] + b * lanes, *restrict factor = own->slopes[axis][slope + b];
            for (int n = 0; n < lanes; n++) across[n] += factor[n] * v[n];
        }
        const double *restrict u = own->powers[0] + a * lanes;
        for (int n = 0; n < lanes; n++) values[n] += across[n] * u[n];
    }
}

/* What the polynomials of the coordinates first .. end - 1 leave out, in the first row of their `remainders`. */
static void sum_remainders(Expansion *own, int first, int end) {
    int order = own->order, lanes = own->lanes;
    for (int x = 0; x < 2; x++) powers(own->extent[x], order, lanes, own->powers[x]);
    for (int axis = first; axis < end; axis++) {
        double sum[MODELS] = {0.0};
        for (int a = 0; a <= order; a++) {
            const double *u = own->powers[0] + a * lanes, *v = own->powers[1] + (order - a) * lanes;
            for (int n = 0; n < lanes; n++) sum[n] += own->remainders[axis][a][n] * u[n] * v[n];
        }
        memcpy(own->remainders[axis][0], sum, sizeof(double) * (size_t)lanes);
    }
}
