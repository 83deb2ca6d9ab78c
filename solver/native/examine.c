/* Intermediate results of one problem at a given domain, for the tests. */
#include "kernel.h"

/* What is handed out; see the functions that compute it. */
typedef struct {
    double *gram, *correlation; /* (n, n), (D, n): normal_equations */
    double *energy;             /* (1): misfit and regularisation at the domain, with the weights of the settings */
    double *force, *move;       /* (2, m): downhill, gauss_newton_move */
} Examination;

static void copy_rows(double *out, const double *rows, int count, int size, int stride) {
    for (int k = 0; k < count; k++) memcpy(out + (size_t)k * size, rows + (size_t)k * stride, sizeof(double) * size);
}

static void examine(const Placed *placed, State *state, const Settings *settings, const Examination *out) {
    int stride = padded(placed->size), m = placed->padded_vertices;
    Weights weights = {settings->beta1, settings->beta2};
    prepare_choice(placed, &state->choice); /* a warm start holds its functions, and goes without */
    normal_equations(placed, &state->choice, state->domain, state->observed);
    copy_rows(out->gram, state->choice.gram, placed->size, placed->size, stride);
    copy_rows(out->correlation, state->choice.correlation, placed->signals, placed->size, stride);
    least_squares(placed, state->domain, state, &state->fit);
    jacobian_of(placed, state->domain, state->jacobian);
    *out->energy = state->fit.misfit +
                   regularisation(placed, state->domain, state->jacobian, weights.beta1, weights.beta2);
    function_gradient(placed, state);
    downhill(placed, state, weights);
    gauss_newton_move(placed, state, weights.beta1, weights.beta2, state->tried);
    copy_rows(out->force, state->force, 2, placed->vertices, m);
    copy_rows(out->move, state->tried, 2, placed->vertices, m);
}

/* Examine a problem at its warm start. */
int ENTRY(examine)(const Problem *problem, const Settings *settings, const Examination *out) {
    State state;
    Arena arena = {NULL, 0};
    Placed placed = sizes_of(problem, settings);
    arena.memory = aligned_memory(lay_out(&placed, &state, &arena));
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out(&placed, &state, &arena);
    Status status = place(problem, &placed);
    if (status == DONE) status = start_from(problem, &placed, &state);
    if (status == DONE) examine(&placed, &state, settings, out);
    free_aligned(arena.memory);
    return status;
}
