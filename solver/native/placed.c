/* Putting a problem in its frame and taking the solution back to scene units (fitting/batch.py, fitting/chunks.py). */
#include "kernel.h"

/* Sizes of a problem; no memory is needed for them. */
static Placed sizes_of(const Problem *problem, const Settings *settings) {
    Placed placed;
    memset(&placed, 0, sizeof placed);
    placed.vertices = (int)problem->vertex_count;
    placed.padded_vertices = padded(placed.vertices);
    placed.triangle_count = (int)problem->triangle_count;
    placed.observations = (int)problem->observation_count;
    placed.padded_observations = (placed.observations + ROW - 1) / ROW * ROW;
    placed.signals = (int)problem->signal_count;
    placed.degree = (int)problem->degree;
    placed.size = dictionary_size(placed.degree);
    placed.sparsity = (int)problem->width;
    placed.width = padded(placed.sparsity);
    placed.legendre = settings->legendre != 0;
    placed.shares = problem->shares;
    return placed;
}

static void lay_out_placed(Placed *placed, Arena *arena) {
    size_t m = (size_t)placed->padded_vertices, t = (size_t)placed->triangle_count;
    size_t count = (size_t)placed->padded_observations, signals = (size_t)placed->signals;
    placed->triangles = take_integers(arena, 3 * t);
    placed->corners = take_integers(arena, 3 * count);
    placed->start = take_doubles(arena, 2 * m);
    placed->values = take_doubles(arena, signals * count);
    placed->weights = take_doubles(arena, count);
    placed->root_weights = take_doubles(arena, count);
    placed->degree_u = take_integers(arena, (size_t)placed->size);
    placed->degree_v = take_integers(arena, (size_t)placed->size);
    placed->hat_u = take_doubles(arena, 3 * t);
    placed->hat_v = take_doubles(arena, 3 * t);
    placed->area = take_doubles(arena, t);
    placed->first = take_integers(arena, m);
    placed->end = take_integers(arena, m);
    placed->neighbour = take_integers(arena, 6 * t + 1);
    placed->triangle_pairs = take_integers(arena, 6 * t);
    placed->pairs = take_integers(arena, 6 * count);
    placed->column_end = take_integers(arena, m);
    placed->column = take_integers(arena, 3 * count);
    placed->column_share = take_doubles(arena, 3 * count);
    placed->laplacian = take_floats(arena, 6 * t + 1);
    placed->laplacian_diagonal = take_floats(arena, m);
}

static void lay_out_fit(const Placed *placed, Fit *fit, Arena *arena) {
    size_t count = (size_t)placed->padded_observations, signals = (size_t)placed->signals;
    size_t width = (size_t)placed->width, table = ((size_t)placed->degree + 1) * count;
    fit->support = take_integers(arena, signals * width);
    fit->coefficients = take_doubles(arena, signals * width);
    fit->inverse_factor = take_doubles(arena, signals * width * width);
    fit->functions = take_floats(arena, count * signals * width);
    fit->residual = take_doubles(arena, signals * count);
    fit->u = take_doubles(arena, table);
    fit->v = take_doubles(arena, table);
}

static void lay_out_choice(const Placed *placed, Choice *choice, Arena *arena) {
    size_t side = (size_t)placed->degree + 1, rows = (2 * (size_t)placed->degree + 4) / 4 * 4;
    size_t count = (size_t)placed->padded_observations, stride = (size_t)padded(placed->size);
    lay_out_pursuit(choice, placed->sparsity, (int)stride, arena);
    choice->gram = take_doubles(arena, stride * stride);
    choice->correlation = take_doubles(arena, (size_t)placed->signals * stride);
    choice->products = take_doubles(arena, side * side * side);
    choice->product_rows = take_doubles(arena, side * side * (size_t)padded((int)side));
    choice->u = take_doubles(arena, rows * count);
    choice->v = take_doubles(arena, rows * count);
    choice->rows = take_doubles(arena, 4 * count);
    choice->moments = take_doubles(arena, rows * rows);
}

static void lay_out_state(const Placed *placed, State *state, Arena *arena) {
    size_t m = (size_t)placed->padded_vertices, t = (size_t)placed->triangle_count;
    size_t count = (size_t)placed->padded_observations, signals = (size_t)placed->signals;
    size_t table = ((size_t)placed->degree + 1) * (count > m ? count : m);
    memset(state, 0, sizeof *state);
    state->domain = take_doubles(arena, 2 * m);
    state->tried = take_doubles(arena, 2 * m);
    lay_out_fit(placed, &state->fit, arena);
    lay_out_fit(placed, &state->other, arena);
    state->jacobian = take_doubles(arena, 4 * t);
    state->changed = take_doubles(arena, 4 * t);
    state->change = take_doubles(arena, 4 * t);
    state->gradient = take_doubles(arena, 2 * signals * count);
    state->slope_u = take_doubles(arena, ((size_t)placed->degree + 1) * STRIP);
    state->slope_v = take_doubles(arena, ((size_t)placed->degree + 1) * STRIP);
    state->table_u = take_doubles(arena, table);
    state->table_v = take_doubles(arena, table);
    state->force = take_doubles(arena, 2 * m);
    state->observed = take_doubles(arena, 2 * (count > m ? count : m));
    state->strip = take_doubles(arena, STRIP * signals * (size_t)placed->width);
    state->gram = take_doubles(arena, signals * (size_t)placed->width * (size_t)placed->width);
    state->sums = take_doubles(arena, signals * (size_t)placed->width);
    state->terms.u = take_integers(arena, (size_t)placed->width);
    state->terms.v = take_integers(arena, (size_t)placed->width);
    state->terms.coefficient = take_doubles(arena, (size_t)placed->width);
    lay_out_system(placed, &state->system, arena);
    lay_out_choice(placed, &state->choice, arena);
}

/* The weights, and the variance that noise has along a function: functions have the weights' root, so the mean is
 * weighted by them. */
static void place_weights(const Problem *problem, Placed *placed) {
    double total = 0.0, squares = 0.0, noise = problem->noise * placed->frame.scale;
    for (int n = 0; n < placed->padded_observations; n++) {
        double weight = n < placed->observations ? problem->weights[n] : 0.0;
        placed->weights[n] = weight;
        placed->root_weights[n] = sqrt(weight);
        placed->weighted_observations += weight > 0.0;
        total += weight;
        squares += weight * weight;
    }
    placed->noise = total > 0.0 ? noise * noise * squares / total : 0.0;
}

/* Put the problem in its frame: everything of `placed` but its sizes. */
static Status place(const Problem *problem, Placed *placed) {
    const Frame *frame = &placed->frame;
    int m = placed->padded_vertices, count = placed->padded_observations, signals = placed->signals;
    placed->frame = problem->warm ? read_frame(problem->frame) : frame_of(problem);
    write_frame(frame, problem->frame);
    for (int k = 0; k < 3 * placed->triangle_count; k++) placed->triangles[k] = (int32_t)problem->triangles[k];
    for (int k = 0; k < 3 * placed->observations; k++) placed->corners[k] = (int32_t)problem->corners[k];
    memset(placed->start, 0, sizeof(double) * 2 * (size_t)m);
    for (int v = 0; v < placed->vertices; v++) {
        double x = problem->domain[2 * v] - frame->centre[0], y = problem->domain[2 * v + 1] - frame->centre[1];
        placed->start[v] = (x * frame->turn[0] + y * frame->turn[2]) * frame->scale;
        placed->start[m + v] = (x * frame->turn[1] + y * frame->turn[3]) * frame->scale;
        problem->start[2 * v] = placed->start[v];
        problem->start[2 * v + 1] = placed->start[m + v];
    }
    memset(placed->values, 0, sizeof(double) * (size_t)signals * (size_t)count);
    for (int n = 0; n < placed->observations; n++)
        for (int d = 0; d < signals; d++)
            placed->values[(size_t)d * count + n] = (problem->values[n * signals + d] - frame->origin[d]) * frame->scale;
    place_weights(problem, placed);
    dictionary_degrees(placed->degree, placed->degree_u, placed->degree_v);
    measure_triangles(placed);
    find_neighbours(placed);
    find_columns(placed);
    measure_laplacian(placed);
    return find_pairs(placed);
}

/* What the Gram matrix of all functions is made with. */
static void prepare_choice(const Placed *placed, Choice *choice) {
    product_coefficients(choice->products, placed->degree, placed->legendre);
    turn_products(choice->products, choice->product_rows, placed->degree);
}

/* Where the solver starts: the initial domain, or an earlier solution. */
static Status start_from(const Problem *problem, const Placed *placed, State *state) {
    int m = placed->padded_vertices;
    memcpy(state->domain, placed->start, sizeof(double) * 2 * (size_t)m);
    if (!problem->warm) {
        prepare_choice(placed, &state->choice);
        return DONE;
    }
    for (int v = 0; v < placed->vertices; v++) {
        state->domain[v] = problem->solved[2 * v];
        state->domain[m + v] = problem->solved[2 * v + 1];
    }
    for (int k = 0; k < placed->signals * placed->sparsity; k++) {
        if (problem->support[k] >= placed->size) return UNKNOWN_FUNCTION;
        state->fit.support[k] = (int32_t)problem->support[k];
    }
    return DONE;
}

/* Fitted values (count, D) in scene units at parameters (2, count); `u` and `v` are memory for tables. */
static void fitted_values(const Placed *placed, const Fit *fit, const double *x, const double *y, int count, int kept,
                          double *u, double *v, double *values, double *out) {
    polynomial_tables(u, x, NULL, placed->degree, placed->legendre, count);
    polynomial_tables(v, y, NULL, placed->degree, placed->legendre, count);
    for (int d = 0; d < placed->signals; d++) {
        const int32_t *support = fit->support + d * placed->sparsity;
        sparse_values(placed, support, fit->coefficients + d * placed->sparsity, u, v, count, values);
        for (int n = 0; n < kept; n++)
            out[n * placed->signals + d] = values[n] / placed->frame.scale + placed->frame.origin[d];
    }
}

/* The surface at the vertices after an iteration. */
static void write_history(const Placed *placed, const State *state, const Problem *problem, int64_t iteration) {
    size_t entry = (size_t)placed->vertices * (size_t)placed->signals;
    fitted_values(placed, &state->fit, state->domain, state->domain + placed->padded_vertices, placed->padded_vertices,
                  placed->vertices, state->table_u, state->table_v, state->observed,
                  problem->history + (size_t)iteration * entry);
}

/* Hand the solution back. */
static void write_solution(const Placed *placed, State *state, const Problem *problem) {
    int m = placed->padded_vertices, count = placed->padded_observations;
    const Fit *fit = &state->fit;
    refine_coefficients(placed, state, &state->fit);
    for (int v = 0; v < placed->vertices; v++) {
        problem->solved[2 * v] = state->domain[v];
        problem->solved[2 * v + 1] = state->domain[m + v];
    }
    for (int k = 0; k < placed->signals * placed->sparsity; k++) {
        problem->support[k] = fit->support[k];
        problem->coefficients[k] = fit->support[k] < 0 ? 0.0 : fit->coefficients[k];
    }
    /* the gradient, (2, D, N), is not needed any more */
    double *x = state->gradient, *y = x + count;
    observe(placed, state->domain, x);
    observe(placed, state->domain + m, y);
    fitted_values(placed, fit, x, y, count, placed->observations, state->table_u, state->table_v, state->observed,
                  problem->fitted);
}
