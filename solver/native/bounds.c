/* Bounds of the largest error on parts of triangles (surface/bounds.py). */
#include "kernel.h"

enum { MOST_PLACES = 48 };

/* P parts of mesh triangles, and what the surface is compared with there.  solver/native/bounds.py has the same fields
 * in the same order. */
typedef struct {
    int64_t count, places;       /* P, L */
    const int64_t *triangle;     /* (P): mesh triangle */
    const double *corners;       /* (P, 3, 3): the part's corners in the triangle's barycentric coordinates */
    const int64_t *triangles;    /* (T, 3) */
    const double *vertices;      /* (V, 3): corners of the flat triangles */
    const double *input;         /* (V, 3): the input, which shows through */
    const double *input_weights; /* (T, 3): how much, at the triangles' corners */
    const double *lattice;       /* (L, 3): places that fix a polynomial */
    const double *to_bernstein;  /* (L, L): from values, a row each, to Bernstein coefficients */
    double *lower, *upper;       /* (P) */
} Parts;

/* Models of the parts, summed over their patches. */
typedef struct {
    double *values;   /* (P, L, 3): polynomials less the flat triangle, times the weight */
    double *left_out; /* (P, 3): the remainders, times the largest weight */
} Models;

/* A block of pairs of one patch: weights and corners of the flat triangles at the corners of their parts. */
typedef struct {
    double weight[3][MODELS], flat[3][3][MODELS]; /* corner; coordinate, corner */
} Places;

/* Values (3) at the corners of a part, of a quantity that is linear on the triangle. */
static void at_part(const double *corners, double a, double b, double c, double *out) {
    for (int k = 0; k < 3; k++) out[k] = corners[3 * k] * a + corners[3 * k + 1] * b + corners[3 * k + 2] * c;
}

/* Weights and flat triangles of `count` pairs; what fills the rows repeats the last. */
static void find_places(const Blend *blend, const Parts *parts, const int64_t *part, const int64_t *held, int count,
                        int lanes, Places *places) {
    for (int n = 0; n < lanes; n++) {
        int own = n < count ? n : count - 1;
        const double *corners = parts->corners + 9 * part[own];
        const int64_t *corner = parts->triangles + 3 * parts->triangle[part[own]];
        double at[3], weights[3];
        weights_at(blend, held[own], weights);
        at_part(corners, weights[0], weights[1], weights[2], at);
        for (int k = 0; k < 3; k++) places->weight[k][n] = at[k];
        for (int axis = 0; axis < 3; axis++) {
            const double *x = parts->vertices + axis;
            at_part(corners, x[3 * corner[0]], x[3 * corner[1]], x[3 * corner[2]], at);
            for (int k = 0; k < 3; k++) places->flat[axis][k][n] = at[k];
        }
    }
}

/* The corners of the parts in the domain of a channel. */
static void place_parts(const Blend *blend, const Parts *parts, const int64_t *part, const int64_t *held, int channel,
                        int count, Expansion *own) {
    const double *domain = blend->domains + 2 * (size_t)channel * blend->vertex_count;
    for (int n = 0; n < own->lanes; n++) {
        int pair = n < count ? n : count - 1;
        const int32_t *corner = blend->corners + 3 * held[pair];
        for (int x = 0; x < 2; x++) {
            double at[3];
            at_part(parts->corners + 9 * part[pair], domain[2 * corner[0] + x], domain[2 * corner[1] + x],
                    domain[2 * corner[2] + x], at);
            for (int k = 0; k < 3; k++) own->corner[k][x][n] = at[k];
        }
    }
}

/* Add the polynomials of the coordinates of a channel at one place of the lattice to the parts. */
static void add_values(const Functions *functions, const Parts *parts, const Models *models, const Places *places,
                       Expansion *own, const int64_t *part, int64_t patch, int channel, int count, int l) {
    const double *at = parts->lattice + 3 * l;
    double scale = 1.0 / functions->scales[patch * functions->channels + channel], value[MODELS];
    powers_at(own, at);
    for (int axis = first_axis(functions, channel); axis < end_axis(functions, channel); axis++) {
        const double(*flat)[MODELS] = places->flat[axis], (*weight)[MODELS] = places->weight;
        double origin = functions->origins[3 * patch + axis];
        polynomials_at(own, axis, value);
        for (int n = 0; n < own->lanes; n++)
            value[n] = (value[n] * scale + (origin - (at[0] * flat[0][n] + at[1] * flat[1][n] + at[2] * flat[2][n]))) *
                       (at[0] * weight[0][n] + at[1] * weight[1][n] + at[2] * weight[2][n]);
        for (int n = 0; n < count; n++) models->values[3 * (part[n] * parts->places + l) + axis] += value[n];
    }
}

/* Add the models of `count` pairs of one patch to their parts. */
static void add_models(const Functions *functions, const Blend *blend, const Limits *limits, const Parts *parts,
                       const Models *models, Expansion *own, const int64_t *part, const int64_t *held, int64_t patch,
                       int count) {
    Places places;
    own->lanes = padded(count);
    find_places(blend, parts, part, held, count, own->lanes, &places);
    for (int c = 0; c < functions->channels; c++) {
        int first = first_axis(functions, c), end = end_axis(functions, c);
        double scale = functions->scales[patch * functions->channels + c];
        place_parts(blend, parts, part, held, c, count, own);
        expand(functions, limits, own, count);
        for (int axis = first; axis < end; axis++) sum_functions(functions, own, patch, axis);
        for (int l = 0; l < parts->places; l++)
            add_values(functions, parts, models, &places, own, part, patch, c, count, l);
        sum_remainders(own, first, end);
        for (int n = 0; n < count; n++) {
            double most = larger(larger(0.0, places.weight[0][n]), larger(places.weight[1][n], places.weight[2][n]));
            for (int axis = first; axis < end; axis++)
                models->left_out[3 * part[n] + axis] += most * own->remainders[axis][0][n] / scale;
        }
    }
}

/* Add what the input contributes where it shows through to the values (L, 3) of a part. */
static void add_input(const Parts *parts, int64_t part, double *values) {
    const double *corners = parts->corners + 9 * part, *shown = parts->input_weights + 3 * parts->triangle[part];
    const int64_t *corner = parts->triangles + 3 * parts->triangle[part];
    if (shown[0] == 0.0 && shown[1] == 0.0 && shown[2] == 0.0) return;
    double weight[3], away[3][3];
    at_part(corners, shown[0], shown[1], shown[2], weight);
    for (int axis = 0; axis < 3; axis++) {
        double x[3];
        for (int k = 0; k < 3; k++) x[k] = parts->input[3 * corner[k] + axis] - parts->vertices[3 * corner[k] + axis];
        at_part(corners, x[0], x[1], x[2], away[axis]);
    }
    for (int l = 0; l < parts->places; l++) {
        const double *at = parts->lattice + 3 * l;
        double share = at[0] * weight[0] + at[1] * weight[1] + at[2] * weight[2];
        for (int axis = 0; axis < 3; axis++)
            values[3 * l + axis] += share * (at[0] * away[axis][0] + at[1] * away[axis][1] + at[2] * away[axis][2]);
    }
}

/* Add the correction of a part, if it has one, to its values; returns how far it is from linear. */
static double add_correction(const Closing *closing, const Parts *parts, int64_t part, double *values) {
    int64_t row = closing ? closing->row[parts->triangle[part]] : -1;
    double correction[9];
    if (row < 0) return 0.0;
    double left_out = correction_at(closing, row, parts->corners + 9 * part, correction);
    for (int l = 0; l < parts->places; l++) {
        const double *at = parts->lattice + 3 * l;
        for (int d = 0; d < 3; d++)
            values[3 * l + d] += at[0] * correction[d] + at[1] * correction[3 + d] + at[2] * correction[6 + d];
    }
    return left_out;
}

/* Bound the length of a part's polynomial, whose values are (L, 3): by its Bernstein coefficients and by the values. */
static void bound_part(const Parts *parts, int64_t part, const double *values, double left_out) {
    int places = (int)parts->places;
    double coefficients[3][MOST_PLACES] = {{0.0}}, upper = 0.0, lower = 0.0;
    for (int l = 0; l < places; l++) {
        const double *restrict row = parts->to_bernstein + (size_t)l * places, *value = values + 3 * l;
        for (int d = 0; d < 3; d++)
            for (int j = 0; j < places; j++) coefficients[d][j] += row[j] * value[d];
        lower = larger(lower, value[0] * value[0] + value[1] * value[1] + value[2] * value[2]);
    }
    for (int j = 0; j < places; j++) {
        double x = coefficients[0][j], y = coefficients[1][j], z = coefficients[2][j];
        upper = larger(upper, x * x + y * y + z * z);
    }
    parts->lower[part] = larger(0.0, sqrt(lower) - left_out);
    parts->upper[part] = sqrt(upper) + left_out;
}

static int bound_all(const Functions *functions, const Blend *blend, const Limits *limits, const Closing *closing,
                     const Parts *parts, const Visits *visits, const Models *models) {
    Expansion own = {.order = (int)limits->order, .lanes = MODELS};
    Arena arena = {NULL, 0};
    lay_out_expansion(functions, &own, &arena);
    arena.memory = aligned_memory(arena.used);
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out_expansion(functions, &own, &arena);
    for (int64_t k = 0; k < blend->patches; k++)
        for (int64_t start = visits->starts[k]; start < visits->starts[k + 1]; start += MODELS) {
            int64_t left = visits->starts[k + 1] - start;
            int count = left < MODELS ? (int)left : MODELS;
            const int64_t *part = visits->thing + start, *held = visits->held + start;
            add_models(functions, blend, limits, parts, models, &own, part, held, k, count);
        }
    free_aligned(arena.memory);
    for (int64_t p = 0; p < parts->count; p++) {
        double *values = models->values + 3 * (size_t)(p * parts->places), *rest = models->left_out + 3 * p;
        double left_out = sqrt(rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2]);
        add_input(parts, p, values);
        left_out += add_correction(closing, parts, p, values);
        bound_part(parts, p, values, left_out);
    }
    return DONE;
}

/* Bound the largest error on each part from below and above; `closing` is NULL where there are no creases. */
int ENTRY(bound_parts)(const Functions *functions, const Blend *blend, const Holders *holders, const Limits *limits,
                       const Closing *closing, const Parts *parts) {
    Visits visits;
    if (limits->order > MOST_ORDER || parts->places > MOST_PLACES) return UNKNOWN_FUNCTION;
    if (!find_visits(blend->patches, holders, parts->triangle, parts->count, &visits)) return OUT_OF_MEMORY;
    Models models = {calloc((size_t)(parts->count * parts->places * 3 + 1), sizeof(double)),
                     calloc((size_t)(parts->count * 3 + 1), sizeof(double))};
    int status = OUT_OF_MEMORY;
    if (models.values && models.left_out)
        status = bound_all(functions, blend, limits, closing, parts, &visits, &models);
    free(models.values);
    free(models.left_out);
    forget_visits(&visits);
    return status;
}
