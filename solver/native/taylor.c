/* Taylor models of patches over triangles of the plane (surface/taylor.py): polynomials of degree m - 1 about the
 * triangles' centres, and bounds of what they leave out. */
#include "kernel.h"

enum { ORDER = 4, SLOPES = ORDER * (ORDER + 1) / 2, MODELS = 64, MOST_PLACES = 16 };

/* Largest derivatives of the one-variable polynomials over cells of the parameter (surface/taylor.py,
 * DerivativeBounds). */
typedef struct {
    double low, width;
    int64_t cells;
    const double *levels; /* (levels, m + 1, cells, t + 1) */
} Limits;

/* The polynomials about the centres of a block of triangles, and their largest derivatives there.  Index 0 is u, 1 is
 * v. */
typedef struct {
    int32_t *degree_u, *degree_v;
    double *centre[2], *extent[2];  /* (MODELS) */
    double *derivatives[2][ORDER];  /* (t + 1, MODELS) */
    double *largest[2][ORDER + 1];  /* (t + 1, MODELS) */
    double *slopes[SLOPES];          /* (MODELS): derivatives d^(a + b) h / du^a dv^b */
    double *remainders[ORDER + 1];  /* (MODELS) */
} Expansion;

static void lay_out_expansion(const Functions *functions, Expansion *own, Arena *arena) {
    int size = dictionary_size((int)functions->degree);
    size_t table = (size_t)(functions->degree + 1) * MODELS;
    own->degree_u = take_integers(arena, size);
    own->degree_v = take_integers(arena, size);
    for (int x = 0; x < 2; x++) {
        own->centre[x] = take_doubles(arena, MODELS);
        own->extent[x] = take_doubles(arena, MODELS);
        for (int a = 0; a < ORDER; a++) own->derivatives[x][a] = take_doubles(arena, table);
        for (int a = 0; a <= ORDER; a++) own->largest[x][a] = take_doubles(arena, table);
    }
    for (int k = 0; k < SLOPES; k++) own->slopes[k] = take_doubles(arena, MODELS);
    for (int a = 0; a <= ORDER; a++) own->remainders[a] = take_doubles(arena, MODELS);
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
    for (int a = 0; a <= ORDER; a++) {
        const double *own = limits->levels + (size_t)((level * (ORDER + 1) + a) * limits->cells) * rows;
        const double *one = own + first * rows, *other = own + second * rows;
        for (int i = 0; i < rows; i++) largest[a][(size_t)i * MODELS + n] = larger(one[i], other[i]);
    }
}

/* Expand the polynomials about the centres of `count` triangles (count, 3, 2). */
static void expand(const Functions *functions, const Limits *limits, Expansion *own, const double *triangles,
                   int count) {
    int degree = (int)functions->degree;
    bool legendre = functions->legendre != 0;
    for (int x = 0; x < 2; x++) {
        for (int n = 0; n < MODELS; n++) {
            const double *at = triangles + 6 * (n < count ? n : count - 1) + x;
            double centre = (at[0] + at[2] + at[4]) / 3.0;
            double low = smaller(at[0], smaller(at[2], at[4])), high = larger(at[0], larger(at[2], at[4]));
            own->centre[x][n] = centre;
            own->extent[x][n] = larger(high - centre, centre - low);
            limits_over(limits, low, high, degree + 1, n, own->largest[x]);
        }
        polynomial_tables(own->derivatives[x][0], own->centre[x], NULL, degree, legendre, MODELS);
        for (int a = 1; a < ORDER; a++)
            derivative_tables(own->derivatives[x][a], own->derivatives[x][a - 1], degree, legendre, MODELS);
    }
}

/* Sums over the chosen functions of one coordinate: its derivatives at the centres, and its largest of order m. */
static void sum_functions(const Functions *functions, Expansion *own, int64_t patch, int axis) {
    size_t row = ((size_t)patch * 3 + axis) * functions->width;
    for (int k = 0; k < SLOPES; k++) memset(own->slopes[k], 0, sizeof(double) * MODELS);
    for (int a = 0; a <= ORDER; a++) memset(own->remainders[a], 0, sizeof(double) * MODELS);
    for (int64_t k = 0; k < functions->width; k++) {
        int64_t number = functions->support[row + k];
        if (number < 0) continue;
        double coefficient = functions->coefficients[row + k], size = fabs(coefficient);
        size_t i = (size_t)own->degree_u[number] * MODELS, j = (size_t)own->degree_v[number] * MODELS;
        for (int a = 0, term = 0; a < ORDER; a++)
            for (int b = 0; b < ORDER - a; b++, term++) {
                const double *restrict u = own->derivatives[0][a] + i, *restrict v = own->derivatives[1][b] + j;
                double *restrict sum = own->slopes[term];
                for (int n = 0; n < MODELS; n++) sum[n] += coefficient * u[n] * v[n];
            }
        for (int a = 0; a <= ORDER; a++) {
            const double *restrict u = own->largest[0][a] + i, *restrict v = own->largest[1][ORDER - a] + j;
            double *restrict sum = own->remainders[a];
            for (int n = 0; n < MODELS; n++) sum[n] += size * u[n] * v[n];
        }
    }
}

/* Powers x^a / a! of `count` numbers, a row of MOST_PLACES an exponent. */
static void powers(const double *x, int exponents, int count, double *restrict out) {
    for (int n = 0; n < count; n++) out[n] = 1.0;
    for (int a = 1; a < exponents; a++)
        for (int n = 0; n < count; n++) out[a * MOST_PLACES + n] = out[(a - 1) * MOST_PLACES + n] * x[n] / a;
}

/* Powers of the way from the centre to the lattice's places (L, 3), for u and v. */
static void lattice_powers(const Expansion *own, const double *triangle, int n, const double *lattice, int places,
                           double (*out)[ORDER * MOST_PLACES]) {
    double away[MOST_PLACES];
    for (int x = 0; x < 2; x++) {
        for (int l = 0; l < places; l++) {
            away[l] = 0.0;
            for (int k = 0; k < 3; k++) away[l] += lattice[3 * l + k] * (triangle[2 * k + x] - own->centre[x][n]);
        }
        powers(away, ORDER, places, out[x]);
    }
}

/* The Taylor polynomial of a triangle at the lattice's places, in steps of 3: one coordinate of (L, 3). */
static void polynomial_at(const Expansion *own, int n, double (*power)[ORDER * MOST_PLACES], int places, double scale,
                          double origin, double *values) {
    double sum[MOST_PLACES] = {0.0};
    for (int a = 0, term = 0; a < ORDER; a++)
        for (int b = 0; b < ORDER - a; b++, term++) {
            const double *u = power[0] + a * MOST_PLACES, *v = power[1] + b * MOST_PLACES;
            double slope = own->slopes[term][n];
            for (int l = 0; l < MOST_PLACES; l++) sum[l] += slope * u[l] * v[l];
        }
    for (int l = 0; l < places; l++) values[3 * l] = sum[l] / scale + origin;
}

static double remainder_of(const Expansion *own, int n) {
    double u[(ORDER + 1) * MOST_PLACES], v[(ORDER + 1) * MOST_PLACES], sum = 0.0;
    powers(own->extent[0] + n, ORDER + 1, 1, u);
    powers(own->extent[1] + n, ORDER + 1, 1, v);
    for (int a = 0; a <= ORDER; a++) sum += own->remainders[a][n] * u[a * MOST_PLACES] * v[(ORDER - a) * MOST_PLACES];
    return sum;
}

/* What is asked of `taylor_models`, and where the answers go. */
typedef struct {
    int64_t runs, count;      /* R, n */
    const int64_t *offsets;   /* (R + 1): the triangles of each run ... */
    const int64_t *patch;     /* (R): ... belong to one patch */
    const double *triangles;  /* (C, n, 3, 2) */
    int64_t places;           /* L */
    const double *lattice;    /* (L, 3) */
    double *values;           /* (n, L, 3): the polynomials, scene units */
    double *left_out;         /* (n, 3): the remainders */
} Models;

static void write_models(const Functions *functions, const Limits *limits, const Models *models, Expansion *own,
                         int64_t patch, int64_t start, int count) {
    int places = (int)models->places;
    double power[2][ORDER * MOST_PLACES] = {{0.0}};
    for (int c = 0; c < functions->channels; c++) {
        const double *triangles = models->triangles + 6 * ((size_t)c * models->count + start);
        double scale = functions->scales[patch * functions->channels + c];
        expand(functions, limits, own, triangles, count);
        for (int axis = first_axis(functions, c); axis < end_axis(functions, c); axis++) {
            double origin = functions->origins[3 * patch + axis];
            sum_functions(functions, own, patch, axis);
            for (int n = 0; n < count; n++) {
                lattice_powers(own, triangles + 6 * n, n, models->lattice, places, power);
                double *values = models->values + (size_t)(start + n) * places * 3 + axis;
                polynomial_at(own, n, power, places, scale, origin, values);
                models->left_out[3 * (start + n) + axis] = remainder_of(own, n) / scale;
            }
        }
    }
}

int ENTRY(taylor_models)(const Functions *functions, const Limits *limits, const Models *models) {
    Expansion own;
    Arena arena = {NULL, 0};
    lay_out_expansion(functions, &own, &arena);
    arena.memory = aligned_memory(arena.used);
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out_expansion(functions, &own, &arena);
    for (int64_t k = 0; k < models->runs; k++)
        for (int64_t start = models->offsets[k]; start < models->offsets[k + 1]; start += MODELS) {
            int64_t left = models->offsets[k + 1] - start;
            write_models(functions, limits, models, &own, models->patch[k], start, (int)(left < MODELS ? left : MODELS));
        }
    free_aligned(arena.memory);
    return DONE;
}
