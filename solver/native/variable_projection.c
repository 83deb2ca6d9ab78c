/* The default patch solver (fitting/methods/variable_projection.py): Gauss-Newton on the domain with the coefficients
 * eliminated.
 *
 * r_d(U) = (I - A_d A_d^+) b_d (Golub, Pereyra 1973) with Kaufman's approximation (1975) of its Jacobian.  The
 * regularisation is annealed over the first steps; from then on the problem goes on until a step gains it little.
 */
#include "kernel.h"

enum { ANNEALING_STEPS = 8, RESELECT_AT = 2, SWEEP_ITERATIONS = 3 };

static const double PROXIMITY_DECAY = 0.26;
static const double SETTLED = 0.05; /* share of its energy that a step has to gain a problem for it to go on */
/* of a problem that may end early: the misfit's least gain from an annealing step, and its largest root mean squares */
static const double EARLY_GAIN = 0.4, EARLY_MISFIT = 1.5e-3, EXACT_MISFIT = 1e-8;
static const double DETERMINANT_FLOOR = 0.02;
static const double STEP_SHARE = 0.8;
static const double FARTHEST = 100.0; /* a domain that wants to go so far has no surface to follow */
static const double LEAST_DAMPING = 1e-3, DAMPING_UP = 8.0, DAMPING_DOWN = 0.3;

/* beta1 and beta2 of eq. 4. */
typedef struct {
    double beta1, beta2;
} Weights;

static Weights annealed_weights(const Settings *settings, int64_t iteration) {
    double step = (double)(iteration < ANNEALING_STEPS - 1 ? iteration : ANNEALING_STEPS - 1);
    Weights weights = {settings->beta1 * pow(PROXIMITY_DECAY, step), settings->beta2 * pow(settings->rigidity_decay, step)};
    return weights;
}

static Weights final_weights(const Settings *settings) {
    return annealed_weights(settings, settings->iterations > 0 ? settings->iterations - 1 : 0);
}

/* Gradients (2, N) of the listed functions at the observations from `first` to `end`, whose derivatives are given; sums
 * stay in registers. */
static void gradient_of_terms(const State *state, const Terms *terms, int count, int first, int end, double *along_u,
                              double *along_v) {
    enum { VECTORS = ROW / LANES };
    for (int n = first; n < end; n += ROW) {
        Lanes by_u[VECTORS] = {{0.0}}, by_v[VECTORS] = {{0.0}};
        for (int k = 0; k < terms->count; k++) {
            const Lanes *u = (const Lanes *)(state->fit.u + (size_t)terms->u[k] * count + n);
            const Lanes *v = (const Lanes *)(state->fit.v + (size_t)terms->v[k] * count + n);
            const Lanes *slope_u = (const Lanes *)(state->slope_u + terms->u[k] * STRIP + n - first);
            const Lanes *slope_v = (const Lanes *)(state->slope_v + terms->v[k] * STRIP + n - first);
            for (int i = 0; i < VECTORS; i++) {
                by_u[i] += terms->coefficient[k] * slope_u[i] * v[i];
                by_v[i] += terms->coefficient[k] * u[i] * slope_v[i];
            }
        }
        memcpy(along_u + n, by_u, sizeof by_u);
        memcpy(along_v + n, by_v, sizeof by_v);
    }
}

/* Weighted gradients of the fitted functions at the observations, (2, D, N). */
static void function_gradient(const Placed *placed, State *state) {
    int count = placed->padded_observations;
    for (int first = 0; first < count; first += STRIP) {
        int length = first + STRIP < count ? STRIP : count - first;
        derivative_tables(state->slope_u, STRIP, state->fit.u + first, count, placed->degree, placed->legendre, length);
        derivative_tables(state->slope_v, STRIP, state->fit.v + first, count, placed->degree, placed->legendre, length);
        for (int d = 0; d < placed->signals; d++) {
            list_terms(placed, &state->fit, d, &state->terms);
            double *along_u = state->gradient + (size_t)d * count;
            double *along_v = state->gradient + (size_t)(placed->signals + d) * count;
            gradient_of_terms(state, &state->terms, count, first, first + length, along_u, along_v);
        }
    }
}

/* Minus half the gradient of the objective with respect to the domain, (2, m), into state->force.
 *
 * Exact: with the coefficients at their optimum, moving a domain changes the misfit only through the fitted functions.
 */
static void downhill(const Placed *placed, State *state, Weights weights) {
    int count = placed->padded_observations, across = placed->padded_vertices;
    memset(state->force, 0, sizeof(double) * 2 * (size_t)across);
    for (int along = 0; along < 2; along++) {
        double *restrict pull = state->observed;
        memset(pull, 0, sizeof(double) * (size_t)count);
        for (int d = 0; d < placed->signals; d++) {
            const double *restrict gradient = state->gradient + (size_t)(along * placed->signals + d) * count;
            const double *restrict residual = state->fit.residual + (size_t)d * count;
            for (int n = 0; n < count; n++) pull[n] += gradient[n] * residual[n];
        }
        double *force = state->force + along * across;
        for (int n = 0; n < placed->observations; n++) {
            const int32_t *corner = placed->corners + 3 * n;
            const double *share = placed->shares + 3 * (size_t)n;
            for (int k = 0; k < 3; k++) force[corner[k]] += share[k] * pull[n];
        }
    }
    subtract_regularisation(placed, state->domain, state->jacobian, weights.beta1, weights.beta2, state->force);
}

/* Put tried = domain + length * move, where move stands in `tried`; whether that stays near where domains belong. */
static bool try_move(const Placed *placed, State *state, double length) {
    bool near = true;
    for (int v = 0; v < 2 * placed->padded_vertices; v++) {
        state->tried[v] = state->domain[v] + length * state->tried[v];
        /* written so that what overflowed counts as too far, too */
        near = near && fabs(state->tried[v]) < FARTHEST;
    }
    for (int k = 0; k < 4 * placed->triangle_count; k++)
        state->changed[k] = state->jacobian[k] + length * state->change[k];
    return near;
}

static void accept(State *state) {
    double *domain = state->domain;
    state->domain = state->tried;
    state->tried = domain;
    Fit fit = state->fit;
    state->fit = state->other;
    state->other = fit;
}

/* One damped Gauss-Newton step; returns the energy. */
static double step(const Placed *placed, State *state, Weights weights) {
    jacobian_of(placed, state->domain, state->jacobian);
    double before =
        state->fit.misfit + regularisation(placed, state->domain, state->jacobian, weights.beta1, weights.beta2);
    function_gradient(placed, state);
    downhill(placed, state, weights);
    gauss_newton_move(placed, state, weights.beta1, weights.beta2, state->tried);
    jacobian_of(placed, state->tried, state->change);
    double limit = largest_step(state->jacobian, state->change, placed->triangle_count, DETERMINANT_FLOOR);
    bool near = try_move(placed, state, smaller(1.0, STEP_SHARE * limit));
    double after = INFINITY;
    if (near) {
        memcpy(state->other.support, state->fit.support,
               sizeof(int32_t) * (size_t)placed->signals * (size_t)placed->sparsity);
        least_squares(placed, state->tried, state, &state->other);
        after = state->other.misfit +
                regularisation(placed, state->tried, state->changed, weights.beta1, weights.beta2);
    }
    if (after < before) {
        accept(state);
        state->damping *= DAMPING_DOWN;
    } else {
        after = before;
        state->damping = larger(state->damping, LEAST_DAMPING) * DAMPING_UP;
    }
    state->settled = !(after < (1.0 - SETTLED) * before);
    return after;
}

/* Choose functions for the domain and fit them into `fit`. */
static void choose_and_fit(const Placed *placed, State *state, const Settings *settings, Fit *fit) {
    normal_equations(placed, &state->choice, state->domain, state->observed);
    select_functions(placed, &state->choice, settings->ols != 0, fit->support);
    least_squares(placed, state->domain, state, fit);
}

/* Write down what an iteration ended with. */
static void note(const Placed *placed, const State *state, const Problem *problem, int64_t iteration, double energy) {
    double squared = 0.0;
    for (int d = 0; d < placed->signals; d++)
        for (int n = 0; n < placed->observations; n++) {
            double root = placed->root_weights[n];
            double misfit = root > 0.0 ? state->fit.residual[(size_t)d * placed->padded_observations + n] / root : 0.0;
            squared += misfit * misfit;
        }
    problem->energy[iteration] = energy;
    problem->squared_error[iteration] = squared / (placed->frame.scale * placed->frame.scale);
    if (problem->history) write_history(placed, state, problem, iteration);
}

/* Nothing moves any more: the rest of the iterations ended as the last one did. */
static void hold(const Problem *problem, int64_t iteration, int64_t iterations) {
    size_t entry = (size_t)(problem->vertex_count * problem->signal_count);
    for (; iteration < iterations; iteration++) {
        problem->energy[iteration] = problem->energy[iteration - 1];
        problem->squared_error[iteration] = problem->squared_error[iteration - 1];
        if (problem->history)
            memcpy(problem->history + (size_t)iteration * entry, problem->history + (size_t)(iteration - 1) * entry,
                   sizeof(double) * entry);
    }
}

/* Whether a good fit ends at an annealing step that found it with this misfit. */
static bool ends_early(const Placed *placed, double before, double misfit) {
    double weight = 0.0;
    for (int n = 0; n < placed->observations; n++) weight += placed->weights[n];
    bool little = misfit > (1.0 - EARLY_GAIN) * before && misfit < EARLY_MISFIT * EARLY_MISFIT * weight;
    return little || misfit < EXACT_MISFIT * EXACT_MISFIT * weight;
}

/* Minimise eq. 3 from the initial domain. */
static void solve(const Placed *placed, State *state, const Settings *settings, const Problem *problem) {
    choose_and_fit(placed, state, settings, &state->fit);
    if (settings->iterations == 0) note(placed, state, problem, 0, state->fit.misfit);
    int64_t iteration = 0;
    if (problem->ends_early && settings->iterations > 0 && ends_early(placed, INFINITY, state->fit.misfit))
        note(placed, state, problem, iteration++, state->fit.misfit);
    bool ended = iteration > 0;
    for (; !ended && iteration < settings->iterations; iteration++) {
        if (iteration >= ANNEALING_STEPS && state->settled) break;
        if (iteration == RESELECT_AT) {
            choose_and_fit(placed, state, settings, &state->other);
            if (generalises(placed, &state->other) < generalises(placed, &state->fit)) {
                Fit fit = state->fit;
                state->fit = state->other;
                state->other = fit;
            }
        }
        double before = state->fit.misfit;
        note(placed, state, problem, iteration, step(placed, state, annealed_weights(settings, iteration)));
        ended = problem->ends_early && iteration < ANNEALING_STEPS && ends_early(placed, before, state->fit.misfit);
    }
    hold(problem, iteration, settings->iterations);
}

/* Go on from an earlier solution, with its functions held and the regularisation fixed. */
static void improve(const Placed *placed, State *state, const Settings *settings) {
    int64_t steps = settings->iterations < SWEEP_ITERATIONS ? settings->iterations : SWEEP_ITERATIONS;
    least_squares(placed, state->domain, state, &state->fit);
    for (int64_t k = 0; k < steps; k++) step(placed, state, final_weights(settings));
}
