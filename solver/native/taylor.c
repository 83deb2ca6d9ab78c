/* Taylor models of patches over triangles of the plane (surface/taylor.py): polynomials of degree m - 1 about the
 * triangles' centres, and bounds of what they leave out; and what these say of parts of a surface (surface/bounds.py).
 */
#include "kernel.h"

enum { MOST_ORDER = 8, MOST_SLOPES = MOST_ORDER * (MOST_ORDER + 1) / 2, MODELS = 32, MOST_PLACES = 48 };

/* Largest derivatives of the one-variable polynomials over cells of the parameter (surface/taylor.py,
 * DerivativeBounds). */
typedef struct {
    double low, width;
    int64_t order, cells; /* m */
    const double *levels; /* (levels, m + 1, cells, t + 1) */
} Limits;

/* n pairs of a part of a mesh triangle and a patch that holds it, those of a patch one after the other, and the P parts
 * whose models are summed up over their pairs. */
typedef struct {
    int64_t pairs, places;    /* n, L */
    const int64_t *part;      /* (n) */
    const int64_t *held;      /* (n): patch triangle */
    const int64_t *patch;     /* (n) */
    const double *corners;    /* (P, 3, 3): the part's corners in the triangle's barycentric coordinates */
    const double *vertices;   /* (V, 3): corners of the flat triangles that the surface is compared with */
    const int64_t *triangles; /* (T, 3) */
    const double *lattice;    /* (L, 3) */
    double *values;           /* (P, L, 3): polynomials less the flat triangle, times the weight */
    double *left_out;         /* (P, 3): the remainders, times the largest weight */
} Parts;

/* The polynomials about the centres of a block of triangles, and their largest derivatives there.  Index 0 is u, 1 is
 * v. */
typedef struct {
    int order;
    int32_t *degree_u, *degree_v;
    double *triangles;                     /* (MODELS, 3, 2) */
    double *centre[2], *extent[2];         /* (MODELS) */
    double *derivatives[2][MOST_ORDER];    /* (t + 1, MODELS) */
    double *largest[2][MOST_ORDER + 1];    /* (t + 1, MODELS) */
    double *slopes[MOST_SLOPES];           /* (MODELS): derivatives d^(a + b) h / du^a dv^b */
    double *remainders[MOST_ORDER + 1];    /* (MODELS) */
    double *powers[2];                     /* (m + 1, MOST_PLACES) */
} Expansion;

static void lay_out_expansion(const Functions *functions, Expansion *own, Arena *arena) {
    int size = dictionary_size((int)functions->degree), order = own->order;
    size_t table = (size_t)(functions->degree + 1) * MODELS;
    own->degree_u = take_integers(arena, size);
    own->degree_v = take_integers(arena, size);
    own->triangles = take_doubles(arena, 6 * MODELS);
    for (int x = 0; x < 2; x++) {
        own->centre[x] = take_doubles(arena, MODELS);
        own->extent[x] = take_doubles(arena, MODELS);
        own->powers[x] = take_doubles(arena, (size_t)(order + 1) * MOST_PLACES);
        for (int a = 0; a < order; a++) own->derivatives[x][a] = take_doubles(arena, table);
        for (int a = 0; a <= order; a++) own->largest[x][a] = take_doubles(arena, table);
    }
    for (int k = 0; k < order * (order + 1) / 2; k++) own->slopes[k] = take_doubles(arena, MODELS);
    for (int a = 0; a <= order; a++) own->remainders[a] = take_doubles(arena, MODELS);
    if (arena->memory) dictionary_degrees((int)functions->degree, own->degree_u, own->degree_v);
}

static int64_t cell_of(const Limits *limits, double x) {
    double cell = (x - limits->low) / limits->width;
    return cell < 0.0 ? 0 : cell < (double)limits->cells ? (int64_t)cell : limits->cells - 1;
}

/* Column n of `largest` over the interval [low, high] of one parameter. */
static void limits_over(const Limits *limits, double low, double high, int rows, int n, double *const *largest) {
    int64_t first = cell_of(limits, low), last = cell_of(limits, high), level = 0;
    while (((int64_t)2 << level) <= last - first + 1) level++;
    int64_t second = last + 1 - ((int64_t)1 << level);
    for (int a = 0; a <= limits->order; a++) {
        const double *own = limits->levels + (size_t)((level * (limits->order + 1) + a) * limits->cells) * rows;
        const double *one = own + first * rows, *other = own + second * rows;
        for (int i = 0; i < rows; i++) largest[a][(size_t)i * MODELS + n] = larger(one[i], other[i]);
    }
}

/* Expand the polynomials about the centres of `count` triangles. */
static void expand(const Functions *functions, const Limits *limits, Expansion *own, int count) {
    int degree = (int)functions->degree;
    bool legendre = functions->legendre != 0;
    for (int x = 0; x < 2; x++) {
        for (int n = 0; n < MODELS; n++) {
            const double *at = own->triangles + 6 * (n < count ? n : count - 1) + x;
            double centre = (at[0] + at[2] + at[4]) / 3.0;
            double low = smaller(at[0], smaller(at[2], at[4])), high = larger(at[0], larger(at[2], at[4]));
            own->centre[x][n] = centre;
            own->extent[x][n] = larger(high - centre, centre - low);
            limits_over(limits, low, high, degree + 1, n, own->largest[x]);
        }
        polynomial_tables(own->derivatives[x][0], own->centre[x], NULL, degree, legendre, MODELS);
        for (int a = 1; a < own->order; a++)
            derivative_tables(own->derivatives[x][a], own->derivatives[x][a - 1], degree, legendre, MODELS);
    }
}

/* Sums over the chosen functions of one coordinate: its derivatives at the centres, and its largest of order m. */
static void sum_functions(const Functions *functions, Expansion *own, int64_t patch, int axis) {
    size_t row = ((size_t)patch * 3 + axis) * functions->width;
    int order = own->order;
    for (int k = 0; k < order * (order + 1) / 2; k++) memset(own->slopes[k], 0, sizeof(double) * MODELS);
    for (int a = 0; a <= order; a++) memset(own->remainders[a], 0, sizeof(double) * MODELS);
    for (int64_t k = 0; k < functions->width; k++) {
        int64_t number = functions->support[row + k];
        if (number < 0) continue;
        double coefficient = functions->coefficients[row + k], size = fabs(coefficient);
        size_t i = (size_t)own->degree_u[number] * MODELS, j = (size_t)own->degree_v[number] * MODELS;
        for (int a = 0, slope = 0; a < order; a++)
            for (int b = 0; b < order - a; b++, slope++) {
                const double *restrict u = own->derivatives[0][a] + i, *restrict v = own->derivatives[1][b] + j;
                double *restrict sum = own->slopes[slope];
                for (int n = 0; n < MODELS; n++) sum[n] += coefficient * u[n] * v[n];
            }
        for (int a = 0; a <= order; a++) {
            const double *restrict u = own->largest[0][a] + i, *restrict v = own->largest[1][order - a] + j;
            double *restrict sum = own->remainders[a];
            for (int n = 0; n < MODELS; n++) sum[n] += size * u[n] * v[n];
        }
    }
}

/* Powers x^a / a! of `count` numbers for a <= m, a row of MOST_PLACES an exponent. */
static void powers(const double *x, int order, int count, double *restrict out) {
    for (int n = 0; n < count; n++) out[n] = 1.0;
    for (int a = 1; a <= order; a++)
        for (int n = 0; n < count; n++) out[a * MOST_PLACES + n] = out[(a - 1) * MOST_PLACES + n] * x[n] / a;
}

/* Powers of the way from the centre of triangle n to the lattice's places, for u and v. */
static void lattice_powers(const Expansion *own, int n, const double *lattice, int places) {
    double away[MOST_PLACES];
    for (int x = 0; x < 2; x++) {
        for (int l = 0; l < places; l++) {
            away[l] = 0.0;
            for (int k = 0; k < 3; k++)
                away[l] += lattice[3 * l + k] * (own->triangles[6 * n + 2 * k + x] - own->centre[x][n]);
        }
        powers(away, own->order, places, own->powers[x]);
    }
}

/* The Taylor polynomial of triangle n at the lattice's places. */
static void polynomial_at(const Expansion *own, int n, int places, double *restrict values) {
    for (int l = 0; l < places; l++) values[l] = 0.0;
    for (int a = 0, slope = 0; a < own->order; a++)
        for (int b = 0; b < own->order - a; b++, slope++) {
            const double *restrict u = own->powers[0] + a * MOST_PLACES, *restrict v = own->powers[1] + b * MOST_PLACES;
            double factor = own->slopes[slope][n];
            for (int l = 0; l < places; l++) values[l] += factor * u[l] * v[l];
        }
}

static double remainder_of(const Expansion *own, int n) {
    double u[(MOST_ORDER + 1) * MOST_PLACES], v[(MOST_ORDER + 1) * MOST_PLACES], sum = 0.0;
    powers(own->extent[0] + n, own->order, 1, u);
    powers(own->extent[1] + n, own->order, 1, v);
    for (int a = 0; a <= own->order; a++)
        sum += own->remainders[a][n] * u[a * MOST_PLACES] * v[(own->order - a) * MOST_PLACES];
    return sum;
}

/* Values (3) at the corners of a part, of a quantity that is linear on the triangle. */
static void at_part(const double *corners, double a, double b, double c, double *out) {
    for (int k = 0; k < 3; k++) out[k] = corners[3 * k] * a + corners[3 * k + 1] * b + corners[3 * k + 2] * c;
}

/* The parts in the domain of a channel: corners (count, 3, 2) of `triangles`. */
static void place_parts(const Blend *blend, const Parts *parts, Expansion *own, int channel, int64_t start, int count) {
    const double *domain = blend->domains + 2 * (size_t)channel * blend->vertex_count;
    for (int n = 0; n < count; n++) {
        const double *corners = parts->corners + 9 * parts->part[start + n];
        const int64_t *corner = blend->corners + 3 * parts->held[start + n];
        for (int x = 0; x < 2; x++) {
            double at[3];
            at_part(corners, domain[2 * corner[0] + x], domain[2 * corner[1] + x], domain[2 * corner[2] + x], at);
            for (int k = 0; k < 3; k++) own->triangles[6 * n + 2 * k + x] = at[k];
        }
    }
}

/* Add the model of one coordinate of pair `start + n` to its part. */
static void add_model(const Functions *functions, const Blend *blend, const Parts *parts, const Expansion *own,
                      int64_t pair, int n, int axis, double scale) {
    double value[MOST_PLACES], weight[3], flat[3];
    int places = (int)parts->places;
    int64_t part = parts->part[pair], held = parts->held[pair];
    const double *corners = parts->corners + 9 * part, *own_weights = blend->weights + 3 * held;
    const int64_t *corner = parts->triangles + 3 * blend->mesh_triangles[held];
    const double *x = parts->vertices + axis;
    at_part(corners, own_weights[0], own_weights[1], own_weights[2], weight);
    at_part(corners, x[3 * corner[0]], x[3 * corner[1]], x[3 * corner[2]], flat);
    lattice_powers(own, n, parts->lattice, places);
    polynomial_at(own, n, places, value);
    double origin = functions->origins[3 * parts->patch[pair] + axis];
    double *out = parts->values + (size_t)part * places * 3 + axis;
    for (int l = 0; l < places; l++) {
        const double *at = parts->lattice + 3 * l;
        double away = value[l] / scale + (origin - (at[0] * flat[0] + at[1] * flat[1] + at[2] * flat[2]));
        out[3 * l] += away * (at[0] * weight[0] + at[1] * weight[1] + at[2] * weight[2]);
    }
    double most = larger(0.0, larger(weight[0], larger(weight[1], weight[2])));
    parts->left_out[3 * part + axis] += most * remainder_of(own, n) / scale;
}

static void add_models_of(const Functions *functions, const Blend *blend, const Limits *limits, const Parts *parts,
                          Expansion *own, int64_t start, int count) {
    int64_t patch = parts->patch[start];
    for (int c = 0; c < functions->channels; c++) {
        double scale = functions->scales[patch * functions->channels + c];
        place_parts(blend, parts, own, c, start, count);
        expand(functions, limits, own, count);
        for (int axis = first_axis(functions, c); axis < end_axis(functions, c); axis++) {
            sum_functions(functions, own, patch, axis);
            for (int n = 0; n < count; n++) add_model(functions, blend, parts, own, start + n, n, axis, scale);
        }
    }
}

/* Add the models of the pairs to their parts, in the order of the pairs. */
int ENTRY(add_models)(const Functions *functions, const Blend *blend, const Limits *limits, const Parts *parts) {
    Expansion own = {.order = (int)limits->order};
    Arena arena = {NULL, 0};
    if (limits->order > MOST_ORDER || parts->places > MOST_PLACES) return UNKNOWN_FUNCTION;
    lay_out_expansion(functions, &own, &arena);
    arena.memory = aligned_memory(arena.used);
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out_expansion(functions, &own, &arena);
    for (int64_t start = 0, count; start < parts->pairs; start += count) {
        for (count = 1; count < MODELS && start + count < parts->pairs; count++)
            if (parts->patch[start + count] != parts->patch[start]) break;
        add_models_of(functions, blend, limits, parts, &own, start, (int)count);
    }
    free_aligned(arena.memory);
    return DONE;
}
