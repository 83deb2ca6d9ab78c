/* Patches at points of their domains, and the surface blended of them (surface/representation.py).
 *
 * Some hundred points of one patch at a time: the tables of their polynomials stay in the first caches. */
#include "kernel.h"

enum { POINTS = 256 };

/* The functions of K patches.  solver/native/surface.py has the same fields in the same order, as for `Blend`. */
typedef struct {
    int64_t channels, width, degree, legendre; /* C, s, t */
    const int64_t *support;                    /* (K, 3, s); -1 where there is none */
    const double *coefficients;                /* (K, 3, s) */
    const double *origins, *scales;            /* (K, 3), (K, C): value = origin + h / scale */
} Functions;

/* Where the patches lie on the mesh, and how much each counts there. */
typedef struct {
    int64_t patches, vertex_count;   /* K, M */
    const int64_t *triangle_offsets; /* (K + 1): patch triangles of each patch */
    const int64_t *mesh_triangles;   /* (S) */
    const int32_t *corners;          /* (S, 3): patch vertices */
    const double *weights;           /* (M): blending weights of the patch vertices */
    const double *shares;            /* (T): factor of the weights on each mesh triangle; NULL for ones */
    const double *domains;           /* (C, M, 2) */
} Blend;

/* Polynomials at the points of a block, and what is made of them. */
typedef struct {
    int32_t *degree_u, *degree_v;              /* (n) */
    double *place_u, *place_v;                 /* (POINTS) */
    double *u, *v, *slope_u, *slope_v;         /* (t + 1, POINTS) */
    double *value, *along_u, *along_v, *share; /* (POINTS) */
    double *weight;                            /* (POINTS, 3): at the corners of the points' triangles */
    int64_t *point, *triangle;                 /* (POINTS): which points these are, and where */
} Block;

static void lay_out_block(const Functions *functions, Block *block, Arena *arena) {
    int size = dictionary_size((int)functions->degree);
    size_t table = (size_t)(functions->degree + 1) * POINTS;
    block->degree_u = take_integers(arena, size);
    block->degree_v = take_integers(arena, size);
    double **rows[] = {&block->place_u, &block->place_v, &block->value, &block->along_u, &block->along_v, &block->share};
    for (size_t k = 0; k < sizeof rows / sizeof *rows; k++) *rows[k] = take_doubles(arena, POINTS);
    double **tables[] = {&block->u, &block->v, &block->slope_u, &block->slope_v};
    for (size_t k = 0; k < sizeof tables / sizeof *tables; k++) *tables[k] = take_doubles(arena, table);
    block->weight = take_doubles(arena, 3 * POINTS);
    block->point = take(arena, POINTS, sizeof(int64_t));
    block->triangle = take(arena, POINTS, sizeof(int64_t));
    if (arena->memory) dictionary_degrees((int)functions->degree, block->degree_u, block->degree_v);
}

static Arena memory_for_block(const Functions *functions, Block *block) {
    Arena arena = {NULL, 0};
    lay_out_block(functions, block, &arena);
    arena.memory = aligned_memory(arena.used);
    arena.used = 0;
    if (arena.memory) lay_out_block(functions, block, &arena);
    return arena;
}

/* Values (count) of the sparse combination of one coordinate of a patch, from tables (t + 1, count). */
static ONE_COPY void combine(const Functions *functions, const Block *block, int64_t patch, int axis,
                             const double *restrict u, const double *restrict v, int count, double *restrict values) {
    size_t row = ((size_t)patch * 3 + axis) * functions->width;
    memset(values, 0, sizeof(double) * (size_t)count);
    for (int64_t k = 0; k < functions->width; k++) {
        int64_t number = functions->support[row + k];
        if (number < 0) continue;
        double coefficient = functions->coefficients[row + k];
        const double *along = u + (size_t)block->degree_u[number] * count;
        const double *across = v + (size_t)block->degree_v[number] * count;
        for (int n = 0; n < count; n++) values[n] += coefficient * along[n] * across[n];
    }
}

/* Tables of the polynomials at the block's places; returns the length of their rows. */
static ONE_COPY int tabulate(const Functions *functions, Block *block, int count, bool slopes) {
    int degree = (int)functions->degree, stride = padded(count);
    bool legendre = functions->legendre != 0;
    for (int n = count; n < stride; n++) block->place_u[n] = block->place_v[n] = 0.0;
    polynomial_tables(block->u, block->place_u, NULL, degree, legendre, stride);
    polynomial_tables(block->v, block->place_v, NULL, degree, legendre, stride);
    if (slopes) {
        derivative_tables(block->slope_u, stride, block->u, stride, degree, legendre, stride);
        derivative_tables(block->slope_v, stride, block->v, stride, degree, legendre, stride);
    }
    return stride;
}

/* The coordinates that share the domain of a channel: first .. end - 1. */
static int first_axis(const Functions *functions, int channel) { return functions->channels == 1 ? 0 : channel; }

static int end_axis(const Functions *functions, int channel) { return functions->channels == 1 ? 3 : channel + 1; }

/* Values (N, 3) of `count` patches from `first` on, at parameters (C, N, 2) that are split at `offsets` (count + 1). */
int ENTRY(patch_values)(const Functions *functions, int64_t first, int64_t count, const int64_t *offsets,
                        const double *domain, double *values) {
    Block block;
    Arena arena = memory_for_block(functions, &block);
    if (!arena.memory) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < count; k++)
        for (int64_t start = offsets[k]; start < offsets[k + 1]; start += POINTS) {
            int own = (int)(offsets[k + 1] - start < POINTS ? offsets[k + 1] - start : POINTS);
            for (int c = 0; c < functions->channels; c++) {
                const double *place = domain + 2 * ((size_t)c * offsets[count] + start);
                for (int n = 0; n < own; n++) {
                    block.place_u[n] = place[2 * n];
                    block.place_v[n] = place[2 * n + 1];
                }
                int stride = tabulate(functions, &block, own, false);
                double scale = functions->scales[(first + k) * functions->channels + c];
                for (int axis = first_axis(functions, c); axis < end_axis(functions, c); axis++) {
                    combine(functions, &block, first + k, axis, block.u, block.v, stride, block.value);
                    double origin = functions->origins[3 * (first + k) + axis];
                    for (int n = 0; n < own; n++)
                        values[3 * (start + n) + axis] = block.value[n] / scale + origin;
                }
            }
        }
    free_aligned(arena.memory);
    return DONE;
}

/* Blending weights (3) at the corners of a patch triangle. */
static void weights_at(const Blend *blend, int64_t triangle, double *weight) {
    const int32_t *corner = blend->corners + 3 * triangle;
    double share = blend->shares ? blend->shares[blend->mesh_triangles[triangle]] : 1.0;
    for (int k = 0; k < 3; k++) weight[k] = blend->weights[corner[k]] * share;
}

/* Add the part phi h of one coordinate to the points (N, 3), or (N, 9) with the derivatives along the edges 0 -> 1 and
 * 0 -> 2 of the triangle. */
static void add_coordinate(const Functions *functions, const Blend *blend, Block *block, int64_t patch, int channel,
                           int axis, int count, int stride, bool tangents, double *points) {
    double scale = functions->scales[patch * functions->channels + channel];
    double origin = functions->origins[3 * patch + axis];
    const double *domain = blend->domains + 2 * (size_t)channel * blend->vertex_count;
    int width = tangents ? 9 : 3;
    combine(functions, block, patch, axis, block->u, block->v, stride, block->value);
    if (tangents) {
        combine(functions, block, patch, axis, block->slope_u, block->v, stride, block->along_u);
        combine(functions, block, patch, axis, block->u, block->slope_v, stride, block->along_v);
    }
    for (int n = 0; n < count; n++) {
        double value = block->value[n] / scale + origin, share = block->share[n];
        double *out = points + (size_t)block->point[n] * width + axis;
        const int32_t *corner = blend->corners + 3 * block->triangle[n];
        const double *weight = block->weight + 3 * n, *from = domain + 2 * corner[0];
        out[0] += share * value;
        for (int k = 1; tangents && k < 3; k++) {
            const double *to = domain + 2 * corner[k];
            double slope = block->along_u[n] * (to[0] - from[0]) + block->along_v[n] * (to[1] - from[1]);
            out[3 * k] += (weight[k] - weight[0]) * value + share * slope / scale;
        }
    }
}

/* Weights of a patch at the points of a block; `inside` (N, 3) are the barycentric coordinates of all points. */
static void weigh_block(const Blend *blend, Block *block, int count, const double *inside) {
    for (int n = 0; n < count; n++) {
        const double *at = inside + 3 * block->point[n];
        double *weight = block->weight + 3 * n;
        weights_at(blend, block->triangle[n], weight);
        block->share[n] = at[0] * weight[0] + at[1] * weight[1] + at[2] * weight[2];
    }
}

/* Places of a block's points in the domain of a channel. */
static void place_block(const Blend *blend, Block *block, int channel, int count, const double *inside) {
    const double *domain = blend->domains + 2 * (size_t)channel * blend->vertex_count;
    for (int n = 0; n < count; n++) {
        const double *at = inside + 3 * block->point[n];
        const int32_t *corner = blend->corners + 3 * block->triangle[n];
        const double *one = domain + 2 * corner[0], *two = domain + 2 * corner[1], *three = domain + 2 * corner[2];
        block->place_u[n] = at[0] * one[0] + at[1] * two[0] + at[2] * three[0];
        block->place_v[n] = at[0] * one[1] + at[1] * two[1] + at[2] * three[1];
    }
}

/* Add a patch's part at the points of a block. */
static ONE_COPY void add_block(const Functions *functions, const Blend *blend, Block *block, int64_t patch, int count,
                               const double *inside, bool tangents, double *points) {
    weigh_block(blend, block, count, inside);
    for (int c = 0; c < functions->channels; c++) {
        place_block(blend, block, c, count, inside);
        int stride = tabulate(functions, block, count, tangents);
        for (int axis = first_axis(functions, c); axis < end_axis(functions, c); axis++)
            add_coordinate(functions, blend, block, patch, c, axis, count, stride, tangents, points);
    }
}

/* Add what the patches contribute to the surface at points sorted by triangle.
 *
 * The points runs[t] .. runs[t + 1] - 1 lie in the mesh triangle triangle[t], t < count, at `inside` (N, 3); `points`
 * are (N, 3), or (N, 9) with tangents.  Each point receives its patches in their order. */
int ENTRY(add_patches)(const Functions *functions, const Blend *blend, const Holders *holders, const int64_t *triangle,
                       const int64_t *runs, int64_t count, const double *inside, int64_t tangents, double *points) {
    Block block;
    Visits visits;
    if (!find_visits(blend->patches, holders, triangle, count, &visits)) return OUT_OF_MEMORY;
    Arena arena = memory_for_block(functions, &block);
    for (int64_t k = 0; k < blend->patches && arena.memory; k++) {
        int own = 0;
        for (int64_t pair = visits.starts[k]; pair < visits.starts[k + 1]; pair++) {
            int64_t run = visits.thing[pair];
            for (int64_t point = runs[run]; point < runs[run + 1]; point++) {
                block.point[own] = point;
                block.triangle[own++] = visits.held[pair];
                if (own < POINTS) continue;
                add_block(functions, blend, &block, k, own, inside, tangents != 0, points);
                own = 0;
            }
        }
        if (own) add_block(functions, blend, &block, k, own, inside, tangents != 0, points);
    }
    forget_visits(&visits);
    if (!arena.memory) return OUT_OF_MEMORY;
    free_aligned(arena.memory);
    return DONE;
}

/* Where each patch is compared with the flat triangles of the mesh. */
typedef struct {
    const double *vertices;   /* (V, 3) */
    const int64_t *triangles; /* (T, 3): corners, in the order of the patch triangles' corners */
    int64_t samples;          /* q */
    const double *inside;     /* (q, 3): barycentric coordinates of the places in every triangle */
    double *errors;           /* (S): largest distance times blending weight */
} Comparison;

/* Raise the errors of the triangles that a block's points lie in; `point` holds the numbers of samples. */
static void compare_block(const Functions *functions, const Blend *blend, const Comparison *comparison, Block *block,
                          int64_t patch, int count) {
    memset(block->along_u, 0, sizeof(double) * POINTS);
    for (int c = 0; c < functions->channels; c++) {
        place_block(blend, block, c, count, comparison->inside);
        int stride = tabulate(functions, block, count, false);
        double scale = functions->scales[patch * functions->channels + c];
        for (int axis = first_axis(functions, c); axis < end_axis(functions, c); axis++) {
            double origin = functions->origins[3 * patch + axis];
            combine(functions, block, patch, axis, block->u, block->v, stride, block->value);
            for (int n = 0; n < count; n++) {
                const double *at = comparison->inside + 3 * block->point[n];
                const int64_t *corner = comparison->triangles + 3 * blend->mesh_triangles[block->triangle[n]];
                double flat = 0.0;
                for (int k = 0; k < 3; k++) flat += at[k] * comparison->vertices[3 * corner[k] + axis];
                double away = block->value[n] / scale + origin - flat;
                block->along_u[n] += away * away;
            }
        }
    }
    for (int n = 0; n < count; n++) {
        double *error = comparison->errors + block->triangle[n];
        *error = larger(*error, sqrt(block->along_u[n]) * block->share[n]);
    }
}

/* The largest distance of each patch triangle from its flat triangle. */
int ENTRY(largest_errors)(const Functions *functions, const Blend *blend, const Comparison *comparison) {
    Block block;
    Arena arena = memory_for_block(functions, &block);
    if (!arena.memory) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < blend->patches; k++) {
        int count = 0;
        for (int64_t s = blend->triangle_offsets[k]; s < blend->triangle_offsets[k + 1]; s++) {
            comparison->errors[s] = 0.0;
            for (int64_t sample = 0; sample < comparison->samples; sample++) {
                block.point[count] = sample;
                block.triangle[count++] = s;
                if (count < POINTS) continue;
                weigh_block(blend, &block, count, comparison->inside);
                compare_block(functions, blend, comparison, &block, k, count);
                count = 0;
            }
        }
        weigh_block(blend, &block, count, comparison->inside);
        if (count) compare_block(functions, blend, comparison, &block, k, count);
    }
    free_aligned(arena.memory);
    return DONE;
}
