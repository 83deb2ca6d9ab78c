/* Fitting the problems of a chunk one after the other (fitting/chunks.py). */
#include "kernel.h"

static size_t lay_out(Placed *placed, State *state, Arena *arena) {
    lay_out_placed(placed, arena);
    lay_out_state(placed, state, arena);
    return arena->used;
}

static Status fit_problem(const Problem *problem, const Settings *settings, Arena arena) {
    State state;
    Placed placed = sizes_of(problem, settings);
    lay_out(&placed, &state, &arena);
    Status status = place(problem, &placed);
    if (status == DONE) status = start_from(problem, &placed, &state);
    if (status != DONE) return status;
    if (problem->warm)
        improve(&placed, &state, settings);
    else
        solve(&placed, &state, settings, problem);
    write_solution(&placed, &state, problem);
    return DONE;
}

/* Fit the problems, with memory for the largest of them. */
int ENTRY(fit_problems)(const Problem *problems, int64_t count, const Settings *settings) {
    size_t most = 0;
    for (int64_t k = 0; k < count; k++) {
        State state;
        Arena counting = {NULL, 0};
        Placed placed = sizes_of(problems + k, settings);
        size_t bytes = lay_out(&placed, &state, &counting);
        most = bytes > most ? bytes : most;
    }
    Arena arena = {aligned_memory(most), 0};
    if (!arena.memory) return OUT_OF_MEMORY;
    Status status = DONE;
    for (int64_t k = 0; k < count && status == DONE; k++) status = fit_problem(problems + k, settings, arena);
    free_aligned(arena.memory);
    return status;
}
