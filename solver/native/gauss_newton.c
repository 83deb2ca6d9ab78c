/* The linear system of the default patch solver (fitting/methods/gauss_newton.py).
 *
 * The Jacobian of signal d's residual is -(I - Q_d^T Q_d) G_d W: W takes the vertices' moves to the observations, G_d
 * are the fitted function's gradients there, and the projection takes out what the coefficients make good (Kaufman
 * 1975).  NumPy applies these factors one after the other.  Here the system is put together,
 *
 *     sum_d W^T G_d^T G_d W  -  sum_d (Q_d G_d W)^T (Q_d G_d W)  +  (beta1 + damping) I  +  beta2 L,
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
        if (placed->neighbour[e] == to) return e;
    return -1;
}

/* List the vertices that share a triangle with each, and find where the observations' pairs of corners stand. */
static Status find_neighbours(Placed *placed) {
    int total = 0;
    memset(placed->end, 0, sizeof(int32_t) * (size_t)placed->vertices);
    for (int k = 0; k < 3 * placed->triangle_count; k++) placed->end[placed->triangles[k]] += 2;
    for (int v = 0; v < placed->vertices; v++) {
        int room = placed->end[v];
        placed->first[v] = placed->end[v] = total;
        total += room;
    }
    for (int k = 0; k < placed->triangle_count; k++)
        for (int pair = 0; pair < 6; pair++) {
            int from = placed->triangles[3 * k + PAIR_FROM[pair]], to = placed->triangles[3 * k + PAIR_TO[pair]];
            if (neighbour_place(placed, from, to) < 0) placed->neighbour[placed->end[from]++] = to;
        }
    for (int n = 0; n < placed->observations; n++)
        for (int pair = 0; pair < 6; pair++) {
            const int32_t *corner = placed->corners + 3 * n;
            const double *share = placed->shares + 3 * (size_t)n;
            bool counts = share[PAIR_FROM[pair]] != 0.0 && share[PAIR_TO[pair]] != 0.0;
            int place = counts ? neighbour_place(placed, corner[PAIR_FROM[pair]], corner[PAIR_TO[pair]]) : 0;
            if (place < 0) return NOT_IN_A_TRIANGLE;
            placed->pairs[6 * n + pair] = place;
        }
    return DONE;
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
            placed->laplacian[neighbour_place(placed, corner[a], corner[b])] +=
                (float)(placed->area[k] * (u[a] * u[b] + v[a] * v[b]));
        }
    }
}

/* W^T (functions times slopes), (2 m, D s): what moving a vertex along u or v does to the sums over the functions. */
static void collect_functions(const Placed *placed, const State *state, double unit) {
    int columns = placed->signals * placed->width, count = placed->padded_observations;
    int vectors = placed->width / LANES, row = columns / LANES;
    memset(state->system.observed, 0, sizeof(double) * 2 * (size_t)placed->padded_vertices * (size_t)columns);
    for (int n = 0; n < placed->observations; n++) {
        for (int corner = 0; corner < 3; corner++) {
            double share = placed->shares[3 * (size_t)n + corner] / unit;
            if (share == 0.0) continue;
            const Lanes *functions = (const Lanes *)(state->fit.functions + (size_t)n * columns);
            Lanes *along_u = (Lanes *)(state->system.observed + 2 * (size_t)placed->corners[3 * n + corner] * columns);
            for (int d = 0; d < placed->signals; d++) {
                double slope_u = share * state->gradient[(size_t)d * count + n];
                double slope_v = share * state->gradient[(size_t)(placed->signals + d) * count + n];
                for (int k = 0; k < vectors; k++, functions++, along_u++) {
                    along_u[0] += slope_u * functions[0];
                    along_u[row] += slope_v * functions[0];
                }
            }
        }
    }
}

/* Q G W = L^-1 (F G W), (D s, 2 m), for as many of the 2 m at a time as a vector holds. */
static void project_functions(const Placed *placed, const State *state) {
    int width = placed->width, columns = placed->signals * width, across = 2 * placed->padded_vertices;
    Lanes *collected = (Lanes *)state->system.tile;
    for (int d = 0; d < placed->signals; d++)
        for (int v = 0; v < across; v += LANES) {
            const double *observed = state->system.observed + (size_t)v * columns + d * width;
            for (int j = 0; j < width; j++)
                for (int lane = 0; lane < LANES; lane++) collected[j][lane] = observed[(size_t)lane * columns + j];
            for (int k = 0; k < width; k += PAD) {
                const double *factor = state->fit.inverse_factor + (size_t)(d * width + k) * width;
                Lanes sum[PAD] = {{0.0}};
                for (int j = 0; j < k + PAD; j++)
                    for (int row = 0; row < PAD; row++) sum[row] += factor[row * width + j] * collected[j];
                float *projected = state->system.projected + (size_t)(d * width + k) * across + v;
                for (int row = 0; row < PAD; row++)
                    for (int lane = 0; lane < LANES; lane++)
                        projected[(size_t)row * across + lane] = (float)sum[row][lane];
            }
        }
}

/* The blocks: W^T G^T G W + beta2 L, and the shift on the diagonal. */
static void sum_blocks(const Placed *placed, const State *state, double unit, float shift, float beta2) {
    const System *system = &state->system;
    int count = placed->padded_observations, signals = placed->signals;
    for (int v = 0; v < placed->vertices; v++) {
        float own = shift + beta2 * placed->laplacian_diagonal[v];
        float *block = system->diagonal + 3 * v;
        block[0] = own, block[1] = 0.0f, block[2] = own;
        for (int e = placed->first[v]; e < placed->end[v]; e++) {
            float *other = system->blocks + 3 * e;
            other[0] = beta2 * placed->laplacian[e], other[1] = 0.0f, other[2] = other[0];
        }
    }
    for (int n = 0; n < placed->observations; n++) {
        float uu = 0.0f, uv = 0.0f, vv = 0.0f;
        for (int d = 0; d < signals; d++) {
            float u = (float)(state->gradient[(size_t)d * count + n] / unit);
            float v = (float)(state->gradient[(size_t)(signals + d) * count + n] / unit);
            uu += u * u, uv += u * v, vv += v * v;
        }
        const double *share = placed->shares + 3 * (size_t)n;
        for (int corner = 0; corner < 3; corner++) {
            float weight = (float)(share[corner] * share[corner]);
            float *block = system->diagonal + 3 * placed->corners[3 * n + corner];
            block[0] += weight * uu, block[1] += weight * uv, block[2] += weight * vv;
        }
        if (share[1] == 0.0 && share[2] == 0.0) continue;
        for (int pair = 0; pair < 6; pair++) {
            float weight = (float)(share[PAIR_FROM[pair]] * share[PAIR_TO[pair]]);
            float *block = system->blocks + 3 * placed->pairs[6 * n + pair];
            block[0] += weight * uu, block[1] += weight * uv, block[2] += weight * vv;
        }
    }
}

/* Inverse of the 2 x 2 blocks on the diagonal, without the projection. */
static void invert_blocks(const Placed *placed, const System *system) {
    for (int v = 0; v < placed->vertices; v++) {
        const float *block = system->diagonal + 3 * v;
        float determinant = block[0] * block[2] - block[1] * block[1];
        float scale = determinant > SMALLEST_DETERMINANT ? 1.0f / determinant : 0.0f;
        float *inverse = system->inverse + 3 * v;
        inverse[0] = block[2] * scale, inverse[1] = -block[1] * scale, inverse[2] = block[0] * scale;
    }
}

static void precondition(const Placed *placed, const System *system, const float *restrict x, float *restrict y) {
    for (int v = 0; v < placed->vertices; v++) {
        const float *inverse = system->inverse + 3 * v;
        y[2 * v] = inverse[0] * x[2 * v] + inverse[1] * x[2 * v + 1];
        y[2 * v + 1] = inverse[1] * x[2 * v] + inverse[2] * x[2 * v + 1];
    }
}

/* The sparse part of the product with the system. */
static void apply_blocks(const Placed *placed, const System *system, const float *restrict x, float *restrict y) {
    for (int v = 0; v < placed->vertices; v++) {
        const float *block = system->diagonal + 3 * v;
        float along_u = block[0] * x[2 * v] + block[1] * x[2 * v + 1];
        float along_v = block[1] * x[2 * v] + block[2] * x[2 * v + 1];
        for (int e = placed->first[v]; e < placed->end[v]; e++) {
            const float *other = system->blocks + 3 * e, *at = x + 2 * placed->neighbour[e];
            along_u += other[0] * at[0] + other[1] * at[1];
            along_v += other[1] * at[0] + other[2] * at[1];
        }
        y[2 * v] = along_u, y[2 * v + 1] = along_v;
    }
}

/* Take the projection's part off y: four rows at a time, so that x is read once for them. */
static void subtract_projection(const float *restrict rows, int count, int across, const float *restrict x,
                                float *restrict y) {
    for (int k = 0; k < count; k += 4, rows += 4 * (size_t)across) {
        const float *a = rows, *b = a + across, *c = b + across, *d = c + across;
        float with_a = 0.0f, with_b = 0.0f, with_c = 0.0f, with_d = 0.0f;
        for (int v = 0; v < across; v++) {
            with_a += a[v] * x[v];
            with_b += b[v] * x[v];
            with_c += c[v] * x[v];
            with_d += d[v] * x[v];
        }
        for (int v = 0; v < across; v++) y[v] -= with_a * a[v] + with_b * b[v] + with_c * c[v] + with_d * d[v];
    }
}

static float ratio(float a, float b) { return b > 0.0f ? a / b : 0.0f; }

/* A few preconditioned steps from zero; `system->residual` holds the right-hand side. */
static void conjugate_gradients(const Placed *placed, const System *system) {
    int across = 2 * placed->padded_vertices, rows = placed->signals * placed->width;
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
        subtract_projection(system->projected, rows, across, direction, applied);
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

/* The damped Gauss-Newton step, `move` (2, m); the gradients of the fitted functions and the force are in `state`. */
static void gauss_newton_move(const Placed *placed, const State *state, double beta1, double beta2, double *move) {
    const System *system = &state->system;
    int across = placed->padded_vertices;
    double steepest = 0.0;
    for (int n = 0; n < 2 * placed->signals * placed->padded_observations; n++)
        steepest = larger(fabs(state->gradient[n]), steepest);
    double unit = steepest > LARGEST_SLOPE ? steepest : 1.0, squared = unit * unit;
    collect_functions(placed, state, unit);
    project_functions(placed, state);
    sum_blocks(placed, state, unit, (float)((beta1 + state->damping) / squared), (float)(beta2 / squared));
    invert_blocks(placed, system);
    for (int v = 0; v < across; v++) {
        system->residual[2 * v] = (float)(state->force[v] / squared);
        system->residual[2 * v + 1] = (float)(state->force[across + v] / squared);
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
    system->blocks = take_floats(arena, 18 * (size_t)placed->triangle_count + 3);
    system->diagonal = take_floats(arena, 3 * (size_t)placed->padded_vertices);
    system->observed = take_doubles(arena, across * rows);
    system->projected = take_floats(arena, rows * across);
    system->inverse = take_floats(arena, 3 * (size_t)placed->padded_vertices);
    system->tile = take_doubles(arena, PAD * (size_t)placed->width);
    system->move = take_floats(arena, across);
    system->residual = take_floats(arena, across);
    system->direction = take_floats(arena, across);
    system->applied = take_floats(arena, across);
    system->preconditioned = take_floats(arena, across);
}
