/* Choosing the few functions that a signal uses (fitting/pursuit.py): pursuits on the Gram matrix G = A A^T of the
 * dictionary and its correlations c = A b with the signal (eq. 2).
 *
 * Sources: Pati, Rezaiifar, Krishnaprasad 1993 (orthogonal matching pursuit); Chen, Cowan, Grant 1991 (orthogonal least
 * squares); Rubinstein, Zibulevsky, Elad 2008 (batch formulation).
 */
#include "kernel.h"

static const double PURSUIT_RIDGE = 1e-12;
static const double INDEPENDENT = 1e-10; /* share of its squared norm that an independent function has left over */
static const double CLEARLY_INDEPENDENT = 1e-5;
static const double NEGLIGIBLE_NORM = 1e-6; /* squared norms count as at least this share of the largest one */
static const double ROUNDING = 1e-13; /* share of a signal's squared length that sums are taken to be wrong by */
static const double ROUNDED_POINTS = 1e-12; /* root mean square, in halves of a domain's width, that is rounding */
static const double BETTER = 1.0 + 1e-9; /* by how much an exchange has to gain */

/* The dictionary as a pursuit sees it: n functions, rows padded to `stride`. */
typedef struct {
    const double *gram, *correlation;
    int size, stride;
} Normal;

static int first_largest(const double *values, int count) {
    int best = 0;
    for (int k = 1; k < count; k++)
        if (values[k] > values[best]) best = k;
    return best;
}

/* The number of functions that minimises the squared residual plus `worth` for each (Mallows 1973; Foster, George
 * 1994). */
static int worthwhile(const double *gain, int found, double worth) {
    double sum = 0.0, most = -INFINITY;
    int count = 0;
    for (int k = 0; k < found; k++) {
        sum += gain[k] - worth;
        if (sum > most) most = sum, count = k + 1;
    }
    return count;
}

/* Take the function `best` as row k of the orthogonal rows; returns the squared length that it explains. */
static double take_function(const Normal *normal, int best, int k, double *rows, double *restrict residual,
                            double *restrict remaining) {
    double *restrict row = rows + (size_t)k * normal->stride;
    memcpy(row, normal->gram + (size_t)best * normal->stride, sizeof(double) * (size_t)normal->size);
    for (int i = 0; i < k; i++) {
        const double *restrict earlier = rows + (size_t)i * normal->stride;
        double share = earlier[best];
        for (int j = 0; j < normal->size; j++) row[j] -= share * earlier[j];
    }
    double scale = 1.0 / sqrt(remaining[best]), step = residual[best] * scale;
    for (int j = 0; j < normal->size; j++) {
        row[j] *= scale;
        residual[j] -= step * row[j];
        remaining[j] -= row[j] * row[j];
    }
    return step * step;
}

/* Forward selection of at most s functions; returns how many were found.  `memory` holds (2 s + 4, n). */
static int select_greedily(const Normal *normal, int s, bool ols, double worth, double *memory, int32_t *support) {
    int size = normal->size, stride = normal->stride, found = 0;
    double *residual = memory, *remaining = residual + stride, *smallest = remaining + stride;
    double *score = smallest + stride, *rows = score + stride, *gain = rows + (size_t)s * stride;
    for (int j = 0; j < size; j++) {
        residual[j] = normal->correlation[j];
        remaining[j] = normal->gram[(size_t)j * (stride + 1)];
    }
    double negligible = NEGLIGIBLE_NORM * largest(remaining, size);
    for (int j = 0; j < size; j++) smallest[j] = INDEPENDENT * larger(remaining[j], negligible);
    for (; found < s; found++) {
        for (int j = 0; j < size; j++) {
            double scale = ols ? remaining[j] : normal->gram[(size_t)j * (stride + 1)];
            score[j] = remaining[j] > smallest[j] ? residual[j] * residual[j] / scale : -1.0;
        }
        int best = first_largest(score, size);
        if (!(remaining[best] > smallest[best])) break;
        gain[found] = take_function(normal, best, found, rows, residual, remaining);
        smallest[best] = INFINITY;
        support[found] = best;
    }
    if (worth > 0.0) found = worthwhile(gain, found, worth);
    for (int k = found; k < s; k++) support[k] = -1;
    return found;
}

/* Inverse Gram matrix of the chosen functions, (s, s).  `memory` holds two matrices. */
static void invert_chosen(const Normal *normal, Selection *selection, int s, double *memory) {
    double *factor = memory, *inverse_factor = memory + s * s;
    for (int i = 0; i < s; i++) {
        const double *row = normal->gram + (size_t)selection->support[i] * normal->stride;
        for (int k = 0; k <= i; k++) factor[i * s + k] = row[selection->support[k]];
        /* Functions that depend on each other up to rounding must not stop the others. */
        factor[i * s + i] *= 1.0 + PURSUIT_RIDGE;
    }
    factorise(factor, s, s);
    invert_lower(factor, inverse_factor, s, s);
    memset(selection->inverse, 0, sizeof(double) * (size_t)s * s);
    for (int j = 0; j < s; j++) {
        const double *restrict row = inverse_factor + j * s;
        for (int i = 0; i <= j; i++)
            for (int k = 0; k <= j; k++) selection->inverse[i * s + k] += row[i] * row[k];
    }
}

/* Least squares of the signal and of all functions on the chosen ones. */
static void regress(const Normal *normal, Selection *selection, int s, double *memory) {
    int size = normal->size, stride = normal->stride;
    double *restrict remaining = selection->remaining, *restrict correlation = selection->correlation;
    invert_chosen(normal, selection, s, memory);
    for (int j = 0; j < size; j++) {
        remaining[j] = normal->gram[(size_t)j * (stride + 1)];
        correlation[j] = normal->correlation[j];
    }
    for (int i = 0; i < s; i++) {
        double *restrict regression = selection->regression + (size_t)i * stride;
        double coefficient = 0.0;
        memset(regression, 0, sizeof(double) * (size_t)size);
        for (int k = 0; k < s; k++) {
            double share = selection->inverse[i * s + k];
            const double *restrict row = normal->gram + (size_t)selection->support[k] * stride;
            coefficient += share * normal->correlation[selection->support[k]];
            for (int j = 0; j < size; j++) regression[j] += share * row[j];
        }
        selection->coefficients[i] = coefficient;
        const double *restrict own = normal->gram + (size_t)selection->support[i] * stride;
        for (int j = 0; j < size; j++) {
            remaining[j] -= own[j] * regression[j];
            correlation[j] -= coefficient * own[j];
        }
    }
}

/* The function that does best in place of the one at `position`, or -1 where none does better than that one. */
static int best_exchange(const Normal *normal, const Selection *selection, int position, int s,
                         const double *restrict smallest, double *restrict gain) {
    double pivot = selection->inverse[position * s + position];
    double coefficient = selection->coefficients[position], weight = coefficient / pivot;
    const double *restrict regression = selection->regression + (size_t)position * normal->stride;
    for (int j = 0; j < normal->size; j++) {
        /* what taking the function out gives back to every other function */
        double correlation = selection->correlation[j] + weight * regression[j];
        double remaining = selection->remaining[j] + regression[j] * regression[j] / pivot;
        gain[j] = remaining > smallest[j] ? correlation * correlation / remaining : -1.0;
    }
    for (int k = 0; k < s; k++) gain[selection->support[k]] = -1.0;
    int entering = first_largest(gain, normal->size);
    return gain[entering] > coefficient * weight * BETTER ? entering : -1;
}

/* Take the function at `position` out of the regressions: to all of them it gives back what it explained. */
static void leave_out(Selection *selection, int position, int s, int size, int stride) {
    double pivot = selection->inverse[position * s + position], coefficient = selection->coefficients[position];
    double *restrict inverse = selection->inverse;
    const double *restrict gone = selection->regression + (size_t)position * stride;
    for (int j = 0; j < size; j++) {
        selection->correlation[j] += coefficient / pivot * gone[j];
        selection->remaining[j] += gone[j] * gone[j] / pivot;
    }
    for (int i = 0; i < s; i++) {
        if (i == position) continue;
        double share = inverse[i * s + position] / pivot;
        double *restrict regression = selection->regression + (size_t)i * stride;
        for (int j = 0; j < size; j++) regression[j] -= share * gone[j];
        for (int k = 0; k < s; k++)
            if (k != position) inverse[i * s + k] -= share * inverse[position * s + k];
        selection->coefficients[i] -= share * coefficient;
    }
}

/* Put a function in at `position`, where there is none.  `left` (n) is for what the others leave of it. */
static void bring_in(const Normal *normal, Selection *selection, int entering, int position, int s,
                   double *restrict left) {
    int size = normal->size, stride = normal->stride;
    double *restrict inverse = selection->inverse;
    double *restrict own = selection->regression + (size_t)position * stride;
    memcpy(left, normal->gram + (size_t)entering * stride, sizeof(double) * (size_t)size);
    for (int i = 0; i < s; i++) {
        if (i == position) continue;
        double share = selection->regression[(size_t)i * stride + entering];
        const double *restrict row = normal->gram + (size_t)selection->support[i] * stride;
        for (int j = 0; j < size; j++) left[j] -= share * row[j];
        inverse[i * s + position] = share; /* until it is known by what to divide */
    }
    double scale = 1.0 / left[entering], coefficient = selection->correlation[entering] * scale;
    for (int j = 0; j < size; j++) {
        own[j] = scale * left[j];
        selection->remaining[j] -= own[j] * left[j];
        selection->correlation[j] -= coefficient * left[j];
    }
    for (int i = 0; i < s; i++) {
        if (i == position) continue;
        double share = inverse[i * s + position];
        double *restrict regression = selection->regression + (size_t)i * stride;
        for (int j = 0; j < size; j++) regression[j] -= share * own[j];
        for (int k = 0; k < s; k++)
            if (k != position) inverse[i * s + k] += share * scale * inverse[k * s + position];
        selection->coefficients[i] -= share * coefficient;
    }
    for (int i = 0; i < s; i++)
        if (i != position) inverse[position * s + i] = inverse[i * s + position] *= -scale;
    inverse[position * s + position] = scale;
    selection->coefficients[position] = coefficient;
    selection->support[position] = entering;
}

/* Put the function `entering` in place of the one at `position`.
 *
 * Two changes of rank one save a whole fit 6 % of its time (measured) beside a new regression, which is left for
 * functions that nearly depend on the others: there they would lose too many digits. */
static void exchange(const Normal *normal, Choice *choice, int entering, int position, int s, double *left) {
    Selection *selection = &choice->selection;
    int old = selection->support[position], size = normal->size, stride = normal->stride;
    double alone = 1.0 / selection->inverse[position * s + position];
    leave_out(selection, position, s, size, stride);
    bool clear = alone > CLEARLY_INDEPENDENT * normal->gram[(size_t)old * (stride + 1)];
    if (clear && selection->remaining[entering] > CLEARLY_INDEPENDENT * normal->gram[(size_t)entering * (stride + 1)]) {
        bring_in(normal, selection, entering, position, s, left);
        return;
    }
    selection->support[position] = entering;
    regress(normal, selection, s, choice->small);
}

/* Take out each chosen function in turn and put the best one in its place. */
static void replace_cyclically(const Normal *normal, Choice *choice, int s, int32_t *support) {
    Selection *selection = &choice->selection;
    double *smallest = choice->greedy, *gain = smallest + normal->stride;
    for (int j = 0; j < normal->size; j++) smallest[j] = normal->gram[(size_t)j * (normal->stride + 1)];
    double negligible = NEGLIGIBLE_NORM * largest(smallest, normal->size);
    for (int j = 0; j < normal->size; j++) smallest[j] = INDEPENDENT * larger(smallest[j], negligible);
    selection->support = support;
    regress(normal, selection, s, choice->small);
    for (int position = 0; position < s; position++) {
        int entering = best_exchange(normal, selection, position, s, smallest, gain);
        if (entering >= 0) exchange(normal, choice, entering, position, s, gain);
    }
}

/* Squared length of the signal's projection on the chosen functions, and whether these are independent. */
static double explained(const Normal *normal, const int32_t *support, int s, double *memory, bool *independent) {
    double *factor = memory, *norm = factor + s * s, *step = norm + s, total = 0.0;
    for (int i = 0; i < s; i++) {
        double squared = support[i] < 0 ? 0.0 : normal->gram[(size_t)support[i] * (normal->stride + 1)];
        norm[i] = squared > 0.0 ? 1.0 / sqrt(squared) : 0.0;
    }
    for (int i = 0; i < s; i++) {
        for (int k = 0; k < i; k++) {
            bool both = support[i] >= 0 && support[k] >= 0;
            double entry = both ? normal->gram[(size_t)support[i] * normal->stride + support[k]] : 0.0;
            factor[i * s + k] = entry * norm[i] * norm[k];
        }
        factor[i * s + i] = 1.0 + PURSUIT_RIDGE;
    }
    *independent = factorise(factor, s, s) > INDEPENDENT;
    for (int i = 0; i < s; i++) {
        double own = support[i] < 0 ? 0.0 : normal->correlation[support[i]] * norm[i];
        step[i] = (own - dot(factor + i * s, step, i)) / factor[i * s + i];
        total += step[i] * step[i];
    }
    return total;
}

/* Take all functions up to the highest total degree that has room, where they leave no more than those chosen: a
 * polynomial of low degree is reproduced whatever its domain.  A lower degree is tried where they depend on each other. */
static void prefer_low_degrees(const Normal *normal, Choice *choice, int s, int32_t *support) {
    int room = s < normal->size ? s : normal->size;
    int highest = (int)((sqrt(8.0 * room + 1.0) - 3.0) / 2.0);
    bool unused, independent;
    double present = explained(normal, support, s, choice->small, &unused);
    double rounded = ROUNDED_POINTS * ROUNDED_POINTS * normal->gram[0]; /* the first function is one everywhere */
    for (int degree = highest; degree >= 0; degree--) {
        for (int k = 0; k < s; k++) choice->low[k] = k < dictionary_size(degree) ? k : -1;
        double possible = explained(normal, choice->low, s, choice->small, &independent);
        if (independent && possible >= present * (1.0 - ROUNDING) - rounded) {
            memcpy(support, choice->low, sizeof(int32_t) * (size_t)s);
            break;
        }
    }
}

/* Choose at most s functions for one signal; -1 where the rest depends on those chosen, or is not worth it.
 *
 * `worth` is by how much a function has to lower the squared residual; where it is more than nothing the fewest
 * functions count, not the smallest residual.
 */
static void pursue(const Normal *normal, Choice *choice, int s, bool ols, double worth, int32_t *support) {
    int found = select_greedily(normal, s, ols, worth, choice->greedy, support);
    if (!ols) return;
    if (found == s) replace_cyclically(normal, choice, s, support);
    if (!(worth > 0.0)) prefer_low_degrees(normal, choice, s, support);
}

/* Scratch memory of a pursuit among n functions, padded to `stride`. */
static void lay_out_pursuit(Choice *choice, int s, int stride, Arena *arena) {
    choice->greedy = take_doubles(arena, ((size_t)s + 4) * (size_t)stride + (size_t)s);
    choice->small = take_doubles(arena, 2 * (size_t)padded(s) * ((size_t)padded(s) + 1));
    choice->low = take_integers(arena, (size_t)s);
    choice->selection.inverse = take_doubles(arena, (size_t)s * (size_t)s);
    choice->selection.regression = take_doubles(arena, (size_t)s * (size_t)stride);
    choice->selection.coefficients = take_doubles(arena, (size_t)s);
    choice->selection.remaining = take_doubles(arena, (size_t)stride);
    choice->selection.correlation = take_doubles(arena, (size_t)stride);
}

/* ---- for the tests */

/* One signal's choice among n functions: gram (n, n), correlation (n), support (s). */
int ENTRY(pursue)(const double *gram, const double *correlation, int64_t size, int64_t s, int64_t ols, double worth,
                  int64_t *support) {
    Choice choice;
    Arena arena = {NULL, 0};
    lay_out_pursuit(&choice, (int)s, (int)size, &arena);
    int32_t *chosen = take_integers(&arena, (size_t)s);
    arena.memory = aligned_memory(arena.used);
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out_pursuit(&choice, (int)s, (int)size, &arena);
    chosen = take_integers(&arena, (size_t)s);
    Normal normal = {gram, correlation, (int)size, (int)size};
    pursue(&normal, &choice, (int)s, ols != 0, worth, chosen);
    for (int k = 0; k < s; k++) support[k] = chosen[k];
    free_aligned(arena.memory);
    return DONE;
}
