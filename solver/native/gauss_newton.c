/* The linear system of the default patch solver (fitting/methods/gauss_newton.py).
 *
 * The Jacobian of signal d's residual is -(I - Q_d^T Q_d) G_d W: W takes the vertices' moves to the observations, G_d
 * are the fitted function's gradients there, and the projection Q_d^T Q_d = F_d^T (F_d F_d^T)^-1 F_d on the functions
 * takes out what the coefficients make good (Kaufman 1975).  NumPy applies these factors one after the other.  Here the
 * system is put together,
 *
 *     sum_d W^T G_d^T G_d W  -  sum_d (F_d G_d W)^T (F_d F_d^T)^-1 (F_d G_d W)  +  (beta1 + damping) I  +  beta2 L,
 *
 * the first and the last terms as 2 x 2 blocks over vertices that share a triangle, the second as D s rows: a product
 * with it then costs half as much (measured).  Only a direction comes of it, so single precision does.
 */
#include "kernel.h"

enum { CONJUGATE_GRADIENT_STEPS = 16 };

static const float SMALLEST_DETERMINANT = 1e-30f; /* vertices on which a problem depends no more than that stay */
static const double LARGEST_SLOPE = 1e6; /* systems with steeper functions are divided by their square */

/* The six ordered pairs of an observation's corners. */
static const int PAIR_FROM[6] = {0, 1, 0, 2, 1, 2}, PAIR_TO[6] = {1, 0, 2, 0, 2, 1};

static int neighbour_place(const Placed *placed, int from, int to) {
    for (int e = placed->first[from]; e < placed->end[from]; e++)
        if (placed->neighbour[e] == 2 * to) return e;
    return -1;
}

/* List the vertices that share a triangle with each, and find where the triangles' pairs of corners stand.  Where their
 * number is odd, the vertex itself makes it even; nothing is ever added to that entry. */
static void find_neighbours(Placed *placed) {
    int total = 0;
    memset(placed->end, 0, sizeof(int32_t) * (size_t)placed->padded_vertices);
    for (int k = 0; k < 3 * placed->triangle_count; k++) placed->end[placed->triangles[k]] += 2;
    for (int v = 0; v < placed->vertices; v++) {
        int room = placed->end[v];
        placed->first[v] = placed->end[v] = total;
        total += room;
    }
    for (int k = 0; k < placed->triangle_count; k++) {
        const int32_t *corner = placed->triangles + 3 * k;
        for (int pair = 0; pair < 6; pair++) {
            int from = corner[PAIR_FROM[pair]], to = corner[PAIR_TO[pair]];
            int entry = neighbour_place(placed, from, to);
            if (entry < 0) placed->neighbour[entry = placed->end[from]++] = 2 * to;
            placed->triangle_pairs[6 * k + pair] = entry;
        }
    }
    for (int v = 0; v < placed->vertices; v++)
        if ((placed->end[v] - placed->first[v]) % 2) placed->neighbour[placed->end[v]++] = 2 * v;
}

/* Where the pairs of an observation's corners stand, (6); an observation at one corner has none. */
static Status pairs_of(const Placed *placed, const int32_t *corner, const double *share, int32_t *pairs) {
    for (int pair = 0; pair < 6; pair++) {
        bool counts = share[PAIR_FROM[pair]] != 0.0 && share[PAIR_TO[pair]] != 0.0;
        int from = corner[PAIR_FROM[pair]], to = corner[PAIR_TO[pair]];
        pairs[pair] = counts ? neighbour_place(placed, from, to) : 0;
        if (pairs[pair] < 0) return NOT_IN_A_TRIANGLE;
    }
    return DONE;
}

/* Find where the observations' pairs of corners stand.  Most observations follow each other as their triangles do, so
 * that little is to be searched. */
static Status find_pairs(Placed *placed) {
    for (int n = 0, at = 0; n < placed->observations; n++) {
        const int32_t *corner = placed->corners + 3 * n, *triangle = placed->triangles + 3 * at;
        size_t size = 3 * sizeof *corner;
        if (at + 1 < placed->triangle_count && memcmp(corner, triangle + 3, size) == 0) at++, triangle += 3;
        if (placed->triangle_count && memcmp(corner, triangle, size) == 0) {
            memcpy(placed->pairs + 6 * n, placed->triangle_pairs + 6 * at, 6 * sizeof *corner);
            continue;
        }
        Status status = pairs_of(placed, corner, placed->shares + 3 * (size_t)n, placed->pairs + 6 * n);
        if (status != DONE) return status;
    }
    return DONE;
}

/* List the observations that each vertex has a share of: W, column by column. */
static void find_columns(Placed *placed) {
    int32_t *end = placed->column_end;
    memset(end, 0, sizeof(int32_t) * (size_t)placed->padded_vertices);
    for (int k = 0; k < 3 * placed->observations; k++) end[placed->corners[k]] += placed->shares[k] != 0.0;
    for (int v = 0, total = 0; v < placed->padded_vertices; v++) {
        int room = end[v];
        end[v] = total;
        total += room;
    }
    for (int n = 0; n < placed->observations; n++)
        for (int k = 3 * n; k < 3 * n + 3; k++) {
            if (placed->shares[k] == 0.0) continue;
            int entry = end[placed->corners[k]]++;
            placed->column[entry] = n;
            placed->column_share[entry] = placed->shares[k];
        }
}

/* Area-weighted Laplacian of the initial domain, half the Hessian of Q2 with the rotations held. */
static void measure_laplacian(Placed *placed) {
    for (int v = 0; v < placed->vertices; v++) {
        placed->laplacian_diagonal[v] = 0.0f;
        for (int e = placed->first[v]; e < placed->end[v]; e++) placed->laplacian[e] = 0.0f;
    }
    for (int k = 0; k < placed->triangle_count; k++) {
        const int32_t *corner = placed->triangles + 3 * k;
        const double *u = placed->hat_u + 3 * k, *v = placed->hat_v + 3 * k;
        for (int a = 0; a < 3; a++)
            placed->laplacian_diagonal[corner[a]] += (float)(placed->area[k] * (u[a] * u[a] + v[a] * v[a]));
        for (int pair = 0; pair < 6; pair++) {
            int a = PAIR_FROM[pair], b = PAIR_TO[pair];
            placed->laplacian[placed->triangle_pairs[6 * k + pair]] +=
                (float)(placed->area[k] * (u[a] * u[b] + v[a] * v[b]));
        }
    }
}

/* What moving a vertex along u and along v does to the sums over a signal's functions, for PAD times `vectors` of them,
 * which stay in registers.  (To add each observation to its corners takes a third longer: measured.) */
static inline void collect_some(const Placed *placed, const State *state, int vertex, int d, int column,
                                double per_unit, int vectors, float *along_u, float *along_v) {
    int columns = placed->signals * placed->width, count = placed->padded_observations;
    const double *slope_u = state->gradient + (size_t)d * count, *slope_v = slope_u + (size_t)placed->signals * count;
    Eight sum_u[ROW / PAD] = {{0.0f}}, sum_v[ROW / PAD] = {{0.0f}};
    for (int entry = vertex > 0 ? placed->column_end[vertex - 1] : 0; entry < placed->column_end[vertex]; entry++) {
        int n = placed->column[entry];
        double share = placed->column_share[entry] * per_unit;
        float by_u = (float)(share * slope_u[n]), by_v = (float)(share * slope_v[n]);
        const Eight *functions = (const Eight *)(state->fit.functions + (size_t)n * columns + column);
        for (int k = 0; k < vectors; k++) {
            sum_u[k] += by_u * functions[k];
            sum_v[k] += by_v * functions[k];
        }
    }
    for (int k = 0; k < vectors; k++) {
        *(Eight *)(along_u + column + k * PAD) = sum_u[k];
        *(Eight *)(along_v + column + k * PAD) = sum_v[k];
    }
}

/* Two columns of F G W: what moving a vertex along u and along v does to the sums over the functions, (2, D s). */
static void collect_functions(const Placed *placed, const State *state, int vertex, double per_unit, float *out) {
    float *along_v = out + placed->signals * placed->width;
    for (int d = 0; d < placed->signals; d++) {
        int column = d * placed->width, end = column + placed->width;
        for (; column + ROW <= end; column += ROW)
            collect_some(placed, state, vertex, d, column, per_unit, ROW / PAD, out, along_v);
        for (; column < end; column += PAD) collect_some(placed, state, vertex, d, column, per_unit, 1, out, along_v);
    }
}

/* F G W, (D s, 2 m): two columns at a time are collected, and a vector of them is turned into rows. */
static void collect(const Placed *placed, const State *state, double per_unit) {
    int columns = placed->signals * placed->width, across = 2 * placed->padded_vertices;
    float *tile = state->system.tile;
    for (int v = 0; v < across; v += PAD) {
        for (int k = 0; k < PAD; k += 2)
            collect_functions(placed, state, (v + k) / 2, per_unit, tile + (size_t)k * columns);
        for (int row = 0; row < columns; row += PAD) {
            Eight square[PAD];
            for (int k = 0; k < PAD; k++) square[k] = *(const Eight *)(tile + (size_t)k * columns + row);
            turn_eight(square);
            for (int k = 0; k < PAD; k++)
                *(Eight *)(state->system.collected + (size_t)(row + k) * across + v) = square[k];
        }
    }
}

/* (F F^T)^-1 = L^-T L^-1 of each signal's functions, (D, s, s). */
static void invert_normal(const Placed *placed, const State *state) {
    int width = placed->width;
    memset(state->system.normal_inverse, 0, sizeof(double) * (size_t)placed->signals * (size_t)(width * width));
    for (int d = 0; d < placed->signals; d++) {
        double *restrict inverse = state->system.normal_inverse + (size_t)d * width * width;
        const double *restrict row = state->fit.inverse_factor + (size_t)d * width * width;
        for (int k = 0; k < placed->sparsity; k++, row += width)
            for (int i = 0; i <= k; i++)
                for (int j = 0; j < width; j++) inverse[i * width + j] += row[i] * row[j];
    }
}

static Quad scaled_identity(float scale) { return (Quad){scale, 0.0f, 0.0f, scale}; }

/* G^T G at an observation. */
static Quad squared_slopes(const Placed *placed, const State *state, int n, double per_unit) {
    size_t count = (size_t)placed->padded_observations;
    float uu = 0.0f, uv = 0.0f, vv = 0.0f;
    for (int d = 0; d < placed->signals; d++) {
        float u = (float)(state->gradient[d * count + n] * per_unit);
        float v = (float)(state->gradient[(placed->signals + d) * count + n] * per_unit);
        uu += u * u, uv += u * v, vv += v * v;
    }
    return (Quad){uu, uv, uv, vv};
}

/* The blocks: W^T G^T G W + beta2 L, and the shift on the diagonal. */
static void sum_blocks(const Placed *placed, const State *state, double per_unit, float shift, float beta2) {
    const System *system = &state->system;
    for (int v = 0; v < placed->vertices; v++) {
        system->diagonal[v] = scaled_identity(shift + beta2 * placed->laplacian_diagonal[v]);
        for (int e = placed->first[v]; e < placed->end[v]; e++)
            system->blocks[e] = scaled_identity(beta2 * placed->laplacian[e]);
    }
    for (int n = 0; n < placed->observations; n++) {
        Quad slopes = squared_slopes(placed, state, n, per_unit);
        const double *share = placed->shares + 3 * (size_t)n;
        const int32_t *corner = placed->corners + 3 * n;
        for (int k = 0; k < 3; k++) system->diagonal[corner[k]] += (float)(share[k] * share[k]) * slopes;
        if (share[1] == 0.0 && share[2] == 0.0) continue;
        for (int pair = 0; pair < 6; pair++)
            system->blocks[placed->pairs[6 * n + pair]] +=
                (float)(share[PAIR_FROM[pair]] * share[PAIR_TO[pair]]) * slopes;
    }
}

/* Inverse of the 2 x 2 blocks on the diagonal, without the projection. */
static void invert_blocks(const Placed *placed, const System *system) {
    for (int v = 0; v < placed->vertices; v++) {
        Quad block = system->diagonal[v];
        float determinant = block[0] * block[3] - block[1] * block[2];
        float scale = determinant > SMALLEST_DETERMINANT ? 1.0f / determinant : 0.0f;
        system->inverse[v] = (Quad){block[3] * scale, -block[1] * scale, -block[2] * scale, block[0] * scale};
    }
}

/* The products of a block's numbers with those of a vector (2) that they meet.  Two floats are loaded as one double,
 * so that one instruction puts them into both halves of a register. */
static inline Quad times(Quad block, const float *x) {
    typedef double Pair __attribute__((vector_size(sizeof(Quad)), may_alias));
    double both;
    memcpy(&both, x, sizeof both);
    return block * (Quad)(Pair){both, both};
}

static inline void add_up(Quad products, float *y) {
    y[0] = products[0] + products[1];
    y[1] = products[2] + products[3];
}

static void precondition(const Placed *placed, const System *system, const float *restrict x, float *restrict y) {
    for (int v = 0; v < placed->vertices; v++) add_up(times(system->inverse[v], x + 2 * v), y + 2 * v);
}

/* The sparse part of the product with the system, two neighbours at a time. */
static void apply_blocks(const Placed *placed, const System *system, const float *restrict x, float *restrict y) {
    for (int v = 0; v < placed->vertices; v++) {
        Quad sum = times(system->diagonal[v], x + 2 * v), other = {0.0f};
        for (int e = placed->first[v]; e < placed->end[v]; e += 2) {
            sum += times(system->blocks[e], x + placed->neighbour[e]);
            other += times(system->blocks[e + 1], x + placed->neighbour[e + 1]);
        }
        add_up(sum + other, y + 2 * v);
    }
}

/* Sums (PAD) of a symmetric matrix's rows, or of parts of them, times numbers (width). */
static void combine_rows(const double *matrix, const double *numbers, int width, float *sums) {
    enum { VECTORS = PAD / LANES };
    Lanes sum[VECTORS] = {{0.0}};
    for (int j = 0; j < width; j++)
        for (int k = 0; k < VECTORS; k++) sum[k] += numbers[j] * ((const Lanes *)(matrix + (size_t)j * width))[k];
    for (int k = 0; k < PAD; k++) sums[k] = (float)sum[k / LANES][k % LANES];
}

/* Take the projection's part off y: (F G W)^T (F F^T)^-1 (F G W) x, signal by signal, for the rows of one fit into the
 * first cache, and eight rows at a time, so that x and y are read once for them. */
static void subtract_projection(const Placed *placed, const System *system, const float *x, float *y) {
    int width = placed->width, across = 2 * placed->padded_vertices, steps = across / (2 * LANES);
    const Singles *along = (const Singles *)x;
    Singles *left = (Singles *)y;
    double *sums = system->sums;
    for (int d = 0; d < placed->signals; d++) {
        const Singles *rows = (const Singles *)(system->collected + (size_t)d * width * across);
        for (int k = 0; k < width; k += PAD) {
            const Singles *row = rows + (size_t)k * steps;
            Singles sum[PAD] = {{0.0f}};
            for (int v = 0; v < steps; v++)
                for (int i = 0; i < PAD; i++) sum[i] += row[i * steps + v] * along[v];
            for (int i = 0; i < PAD; i++) sums[k + i] = sum_of_singles(sum[i]);
        }
        for (int k = 0; k < width; k += PAD) {
            const Singles *row = rows + (size_t)k * steps;
            float part[PAD];
            combine_rows(system->normal_inverse + (size_t)d * width * width + k, sums, width, part);
            for (int v = 0; v < steps; v++) {
                Singles own = left[v];
                for (int i = 0; i < PAD; i++) own -= part[i] * row[i * steps + v];
                left[v] = own;
            }
        }
    }
}

static float ratio(float a, float b) { return b > 0.0f ? a / b : 0.0f; }

/* A few preconditioned steps from zero; `system->residual` holds the right-hand side. */
static void conjugate_gradients(const Placed *placed, const System *system) {
    int across = 2 * placed->padded_vertices;
    float *restrict move = system->move, *restrict residual = system->residual;
    float *restrict direction = system->direction, *restrict applied = system->applied;
    memset(move, 0, sizeof(float) * (size_t)across);
    memset(direction, 0, sizeof(float) * (size_t)across);
    memset(applied, 0, sizeof(float) * (size_t)across);
    memset(system->preconditioned, 0, sizeof(float) * (size_t)across);
    precondition(placed, system, residual, direction);
    float slope = dot_single(residual, direction, across);
    for (int step = 0; step < CONJUGATE_GRADIENT_STEPS; step++) {
        apply_blocks(placed, system, direction, applied);
        subtract_projection(placed, system, direction, applied);
        float length = ratio(slope, dot_single(direction, applied, across));
        for (int v = 0; v < across; v++) {
            move[v] += length * direction[v];
            residual[v] -= length * applied[v];
        }
        precondition(placed, system, residual, system->preconditioned);
        float following = dot_single(residual, system->preconditioned, across), share = ratio(following, slope);
        for (int v = 0; v < across; v++) direction[v] = system->preconditioned[v] + share * direction[v];
        slope = following;
    }
}

/* By what to divide slopes for their squares not to overflow: one, unless some are very steep. */
static double unit_of_slopes(const double *slopes, int count) {
    double steepest = 0.0;
    if (dot(slopes, slopes, count) <= LARGEST_SLOPE * LARGEST_SLOPE) return 1.0;
    for (int n = 0; n < count; n++) steepest = larger(fabs(slopes[n]), steepest);
    return steepest > LARGEST_SLOPE ? steepest : 1.0;
}

/* The damped Gauss-Newton step, `move` (2, m); the gradients of the fitted functions and the force are in `state`. */
static void gauss_newton_move(const Placed *placed, const State *state, double beta1, double beta2, double *move) {
    const System *system = &state->system;
    int across = placed->padded_vertices;
    double unit = unit_of_slopes(state->gradient, 2 * placed->signals * placed->padded_observations);
    double squared = unit * unit;
    collect(placed, state, 1.0 / unit);
    invert_normal(placed, state);
    sum_blocks(placed, state, 1.0 / unit, (float)((beta1 + state->damping) / squared), (float)(beta2 / squared));
    invert_blocks(placed, system);
    for (int v = 0; v < across; v++) {
        float *residual = system->residual + 2 * v;
        residual[0] = (float)(state->force[v] / squared);
        residual[1] = (float)(state->force[across + v] / squared);
    }
    conjugate_gradients(placed, system);
    for (int v = 0; v < across; v++) {
        move[v] = system->move[2 * v];
        move[across + v] = system->move[2 * v + 1];
    }
}

/* Memory of the system. */
static void lay_out_system(const Placed *placed, System *system, Arena *arena) {
    size_t across = 2 * (size_t)placed->padded_vertices, rows = (size_t)placed->signals * (size_t)placed->width;
    system->blocks = take(arena, 6 * (size_t)placed->triangle_count + 1, sizeof(Quad));
    system->diagonal = take(arena, across / 2, sizeof(Quad));
    system->inverse = take(arena, across / 2, sizeof(Quad));
    system->collected = take_floats(arena, rows * across);
    system->normal_inverse = take_doubles(arena, rows * (size_t)placed->width);
    system->tile = take_floats(arena, PAD * rows);
    system->sums = take_doubles(arena, (size_t)placed->width);
    system->move = take_floats(arena, across);
    system->residual = take_floats(arena, across);
    system->direction = take_floats(arena, across);
    system->applied = take_floats(arena, across);
    system->preconditioned = take_floats(arena, across);
}
