/* The sparse fit on a fixed domain (fitting/sparse_fit.py): observing it, choosing functions, least squares on them. */
#include "kernel.h"

static const double FIT_RIDGE = 1e-11;
static const double NEGLIGIBLE = 1e-8; /* length of a function, beside the longest chosen, below which it takes no part */
static const double LARGEST_NOISE_GAIN = 2.0;

/* W: parameters of the observations (N) from those of the vertices (m). */
static void observe(const Placed *placed, const double *restrict domain, double *restrict observed) {
    for (int n = 0; n < placed->observations; n++) {
        const int32_t *corner = placed->corners + 3 * n;
        const double *share = placed->shares + 3 * (size_t)n;
        observed[n] = share[0] * domain[corner[0]] + share[1] * domain[corner[1]] + share[2] * domain[corner[2]];
    }
    for (int n = placed->observations; n < placed->padded_observations; n++) observed[n] = 0.0;
}

/* Four rows times four rows, over `count` numbers: results (4, 4), rows of which are `stride` apart. */
static void four_by_four(const double *one, const double *other, int count, double *results, int stride) {
    Lanes sum[4][4] = {{{0.0}}};
    int steps = count / LANES;
    const Lanes *a = (const Lanes *)one, *b = (const Lanes *)other;
    for (int n = 0; n < steps; n++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) sum[i][j] += a[i * steps + n] * b[j * steps + n];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) results[i * stride + j] = sum_of(sum[i][j]);
}

/* Moments sum_n w q_a(u) q_b(v) for a + b <= 2 t, in blocks of four by four; tables have rows for them. */
static void moments_of(Choice *choice, int highest, int stride, int count) {
    for (int a = 0; a <= highest; a += 4)
        for (int b = 0; b <= highest - a; b += 4)
            four_by_four(choice->u + (size_t)a * count, choice->v + (size_t)b * count, count,
                         choice->moments + a * stride + b, stride);
}

/* Correlations (D, n) of the weighted dictionary with the weighted signals. */
static void correlations_of(const Placed *placed, Choice *choice, int stride, int count) {
    int degree = placed->degree;
    double *rows = choice->rows;
    for (int d = 0; d < placed->signals; d++) {
        const double *restrict values = placed->values + (size_t)d * count;
        for (int i = 0; i <= degree; i += 4) {
            for (int row = 0; row < 4; row++) {
                const double *restrict along = choice->u + (size_t)(i + row) * count;
                for (int n = 0; n < count; n++) rows[(size_t)row * count + n] = values[n] * along[n];
            }
            for (int j = 0; j <= degree - i; j += 4) {
                double block[16];
                four_by_four(rows, choice->v + (size_t)j * count, count, block, 4);
                for (int k = 0; k < 16; k++)
                    if (i + k / 4 + j + k % 4 <= degree)
                        choice->correlation[d * stride + function_number(i + k / 4, j + k % 4)] = block[k];
            }
        }
    }
}

/* Sums of q_j q_l, for as many l as a vector holds from l on, with numbers that belong to q_0, q_1, ...; those before
 * the first have to be zero. */
static inline Lanes product_sums(const double *rows, int width, int j, int l, const double *numbers) {
    Lanes sum = {0.0};
    for (int r = 0; r <= j && r < l + (int)LANES; r++) {
        Lanes own;
        memcpy(&own, numbers + j + l - 2 * r, sizeof own);
        sum += *(const Lanes *)(rows + (size_t)r * width + l) * own;
    }
    return sum;
}

/* Gram matrix of all pairs q_i(u) q_j(v), q_k(u) q_l(v) of given i and k, from the moments. */
static void gram_of(Choice *choice, int degree, int i, int k, int moment_stride, int stride) {
    int side = degree + 1, width = padded(side), highest = 2 * degree - i - k;
    double numbers[3 * 64 + 2 * PAD] = {0.0}, *along = numbers + degree;
    const double *of_u = choice->products + (size_t)(i * side + k) * side;
    for (int r = 0; r <= k; r++) {
        const double *moments = choice->moments + (i + k - 2 * r) * moment_stride;
        for (int b = 0; b <= highest; b++) along[b] += of_u[r] * moments[b];
    }
    for (int j = 0; j <= degree - i; j++) {
        const double *rows = choice->product_rows + (size_t)j * side * width;
        int one = function_number(i, j);
        for (int first = 0; first <= degree - k; first += LANES) {
            Lanes sums = product_sums(rows, width, j, first, along);
            int end = first + LANES <= degree - k + 1 ? (int)LANES : degree - k + 1 - first;
            for (int l = 0; l < end; l++) {
                int other = function_number(k, first + l);
                choice->gram[(size_t)one * stride + other] = choice->gram[(size_t)other * stride + one] = sums[l];
            }
        }
    }
}

/* Gram matrix of the weighted dictionary (n, n), and its correlations with the weighted signals (D, n).
 *
 * A product of two polynomials is a sum of polynomials of up to twice the degree, so all n^2 / 2 sums follow from
 * (2 t + 1)(t + 1) moments: 435 instead of 7,260 sums over the observations at t = 14.
 */
static void normal_equations(const Placed *placed, Choice *choice, const double *domain, double *observed) {
    int count = placed->padded_observations, highest = 2 * placed->degree;
    int rows = (highest + 4) / 4 * 4, stride = padded(placed->size), moment_stride = rows;
    observe(placed, domain, observed);
    polynomial_tables(choice->u, observed, placed->weights, rows - 1, placed->legendre, count);
    observe(placed, domain + placed->padded_vertices, observed);
    polynomial_tables(choice->v, observed, NULL, rows - 1, placed->legendre, count);
    moments_of(choice, highest, moment_stride, count);
    correlations_of(placed, choice, stride, count);
    for (int i = 0; i <= placed->degree; i++)
        for (int k = 0; k <= i; k++) gram_of(choice, placed->degree, i, k, moment_stride, stride);
}

/* Choose the functions of all signals, (D, s). */
static void select_functions(const Placed *placed, Choice *choice, bool ols, int32_t *support) {
    int stride = padded(placed->size);
    /* the largest gain that the best of this many functions has on noise alone */
    double worth = LARGEST_NOISE_GAIN * log(placed->size > 2 ? placed->size : 2) * placed->noise;
    for (int d = 0; d < placed->signals; d++) {
        Normal normal = {choice->gram, choice->correlation + d * stride, placed->size, stride};
        pursue(&normal, choice, placed->sparsity, ols, worth, support + d * placed->sparsity);
    }
}

/* Weighted values of as many functions as a vector holds, where `columns` of them begin, for observations from `first`
 * to `end`; functions without a number are zero. */
static void some_functions(const Placed *placed, const Fit *fit, const int32_t *number, int first, int end, int columns,
                           double *functions) {
    const double *u[LANES], *v[LANES];
    for (int k = 0; k < LANES; k++) {
        u[k] = fit->u + (size_t)(number[k] < 0 ? 0 : placed->degree_u[number[k]]) * placed->padded_observations;
        v[k] = fit->v + (size_t)(number[k] < 0 ? 0 : placed->degree_v[number[k]]) * placed->padded_observations;
    }
    for (int n = first; n < end; n += LANES) {
        Lanes square[LANES];
        for (int k = 0; k < LANES; k++) {
            square[k] = (Lanes){0.0};
            if (number[k] >= 0) square[k] = *(const Lanes *)(u[k] + n) * *(const Lanes *)(v[k] + n);
        }
        turn(square);
        for (int k = 0; k < LANES; k++) *(Lanes *)(functions + (size_t)(n - first + k) * columns) = square[k];
    }
}

/* Weighted values of the chosen functions, (end - first, D s), for a strip of observations. */
static void functions_of(const Placed *placed, const Fit *fit, int first, int end, double *functions) {
    int columns = placed->signals * placed->width;
    for (int column = 0; column < columns; column += LANES) {
        int32_t number[LANES];
        for (int k = 0; k < LANES; k++) {
            int place = (column + k) % placed->width, signal = column / placed->width;
            number[k] = place < placed->sparsity ? fit->support[signal * placed->sparsity + place] : -1;
        }
        some_functions(placed, fit, number, first, end, columns, functions + column);
    }
}

/* Add to the lower part of the Gram matrix (s, s) of one signal's functions, eight rows by one vector at a time. */
static void add_to_gram(const double *functions, int count, int columns, int s, double *restrict gram) {
    for (int i = 0; i < s; i += PAD)
        for (int j = 0; j < i + PAD; j += LANES) {
            Lanes sum[PAD];
            for (int k = 0; k < PAD; k++) sum[k] = *(const Lanes *)(gram + (i + k) * s + j);
            const double *row = functions;
            for (int n = 0; n < count; n++, row += columns) {
                Lanes others = *(const Lanes *)(row + j);
                for (int k = 0; k < PAD; k++) sum[k] += row[i + k] * others;
            }
            for (int k = 0; k < PAD; k++) *(Lanes *)(gram + (i + k) * s + j) = sum[k];
        }
}

/* Turn a Gram matrix (s, s) into the inverse of its lower Cholesky factor, columns scaled before that. */
static void invert_gram(double *gram, double *norm, int s, int width, double *inverse_factor) {
    double longest = 0.0;
    for (int k = 0; k < s; k++) {
        norm[k] = sqrt(gram[k * width + k]);
        longest = larger(longest, norm[k]);
    }
    for (int k = 0; k < s; k++) {
        /* What a function has left after weights changed may be nothing: it must not get a huge coefficient for that. */
        norm[k] = larger(norm[k], NEGLIGIBLE * longest);
        norm[k] = norm[k] > 0.0 ? norm[k] : 1.0;
    }
    for (int i = 0; i < s; i++) {
        for (int j = 0; j < i; j++) gram[i * width + j] /= norm[i] * norm[j];
        /* unused places get a unit diagonal */
        gram[i * width + i] = 1.0 + FIT_RIDGE;
    }
    factorise(gram, s, width);
    memset(inverse_factor + s * width, 0, sizeof(double) * (size_t)(width - s) * (size_t)width);
    invert_lower(gram, inverse_factor, s, width);
    for (int i = 0; i < s; i++)
        for (int j = 0; j <= i; j++) inverse_factor[i * width + j] /= norm[j];
}

/* Add to sums (s) of the functions of one signal times `values` (N). */
static void correlate(const double *functions, const double *values, int count, int columns, int width, double *sums) {
    for (int k = 0; k < width; k += LANES) {
        Lanes sum = {0.0}, other = {0.0};
        const double *row = functions + k;
        for (int n = 0; n < count; n += 2, row += 2 * columns) {
            sum += values[n] * *(const Lanes *)row;
            other += values[n + 1] * *(const Lanes *)(row + columns);
        }
        *(Lanes *)(sums + k) += sum + other;
    }
}

/* Coefficients (s) that belong to sums of functions times values: L^-T L^-1. */
static void solve_normal(const double *inverse_factor, const double *sums, int s, int width, double *coefficients) {
    for (int k = 0; k < s; k++) coefficients[k] = 0.0;
    for (int i = 0; i < s; i++) {
        const double *row = inverse_factor + i * width;
        double share = dot(row, sums, i + 1);
        for (int k = 0; k <= i; k++) coefficients[k] += share * row[k];
    }
}

/* List a signal's functions. */
static void list_terms(const Placed *placed, const Fit *fit, int d, Terms *terms) {
    terms->count = 0;
    for (int k = d * placed->sparsity; k < (d + 1) * placed->sparsity; k++) {
        if (fit->support[k] < 0) continue;
        terms->u[terms->count] = placed->degree_u[fit->support[k]];
        terms->v[terms->count] = placed->degree_v[fit->support[k]];
        terms->coefficient[terms->count++] = fit->coefficients[k];
    }
}

/* Take the listed functions off `residual` (N); sums stay in registers. */
static void subtract_terms(const Terms *terms, const Fit *fit, int count, double *residual) {
    enum { VECTORS = ROW / LANES };
    for (int n = 0; n < count; n += ROW) {
        Lanes sum[VECTORS] = {{0.0}}, *own = (Lanes *)(residual + n);
        for (int k = 0; k < terms->count; k++) {
            const Lanes *u = (const Lanes *)(fit->u + (size_t)terms->u[k] * count + n);
            const Lanes *v = (const Lanes *)(fit->v + (size_t)terms->v[k] * count + n);
            for (int i = 0; i < VECTORS; i++) sum[i] += terms->coefficient[k] * u[i] * v[i];
        }
        for (int i = 0; i < VECTORS; i++) own[i] -= sum[i];
    }
}

/* Sums over the strip of observations from `first` to `end`, whose tables are made: products of the functions with
 * `values` (D, N) and, if `all`, the functions' Gram matrices.  The functions stay in single precision, which does for
 * the system. */
static void sum_strip(const Placed *placed, State *scratch, Fit *fit, const double *values, int first, int end,
                      bool all) {
    int count = placed->padded_observations, width = placed->width, columns = placed->signals * width;
    double *strip = scratch->strip;
    functions_of(placed, fit, first, end, strip);
    for (int d = 0; d < placed->signals; d++) {
        const double *functions = strip + d * width, *own = values + (size_t)d * count + first;
        correlate(functions, own, end - first, columns, width, scratch->sums + d * width);
        if (all) add_to_gram(functions, end - first, columns, width, scratch->gram + (size_t)d * width * width);
    }
    float *restrict kept = fit->functions + (size_t)first * columns;
    for (int k = 0; all && k < (end - first) * columns; k++) kept[k] = (float)strip[k];
}

/* Go over the observations of `domain` strip by strip, all of a strip in the first cache: tables, functions, Gram
 * matrices and products with the signals, whose weighted values become fit->residual. */
static void sum_observations(const Placed *placed, const double *domain, State *scratch, Fit *fit) {
    int count = placed->padded_observations, columns = placed->signals * placed->width;
    double *u = scratch->observed, *v = u + count;
    observe(placed, domain, u);
    observe(placed, domain + placed->padded_vertices, v);
    memset(scratch->gram, 0, sizeof(double) * (size_t)columns * (size_t)placed->width);
    memset(scratch->sums, 0, sizeof(double) * (size_t)columns);
    for (int first = 0; first < count; first += STRIP) {
        int length = first + STRIP < count ? STRIP : count - first;
        const double *weight = placed->root_weights + first;
        strip_of_tables(fit->u + first, count, u + first, NULL, placed->degree, placed->legendre, length);
        strip_of_tables(fit->v + first, count, v + first, weight, placed->degree, placed->legendre, length);
        for (int d = 0; d < placed->signals; d++) {
            const double *values = placed->values + (size_t)d * count + first;
            double *restrict weighted = fit->residual + (size_t)d * count + first;
            for (int n = 0; n < length; n++) weighted[n] = weight[n] * values[n];
        }
        sum_strip(placed, scratch, fit, fit->residual, first, first + length, true);
    }
}

/* Fit the functions fit->support over `domain`: everything else of `fit` follows. */
static void least_squares(const Placed *placed, const double *domain, State *scratch, Fit *fit) {
    int count = placed->padded_observations, s = placed->sparsity, width = placed->width;
    sum_observations(placed, domain, scratch, fit);
    for (int d = 0; d < placed->signals; d++) {
        double *inverse_factor = fit->inverse_factor + (size_t)d * width * width;
        invert_gram(scratch->gram + (size_t)d * width * width, scratch->choice.small, s, width, inverse_factor);
        solve_normal(inverse_factor, scratch->sums + d * width, s, width, fit->coefficients + d * s);
        list_terms(placed, fit, d, &scratch->terms);
        subtract_terms(&scratch->terms, fit, count, fit->residual + (size_t)d * count);
    }
    fit->misfit = dot(fit->residual, fit->residual, placed->signals * count);
}

/* One step of iterative refinement of the coefficients: it takes back what the ridge cost. */
static void refine_coefficients(const Placed *placed, State *scratch, Fit *fit) {
    int count = placed->padded_observations, s = placed->sparsity, width = placed->width;
    double *correction = scratch->choice.small;
    memset(scratch->sums, 0, sizeof(double) * (size_t)placed->signals * (size_t)width);
    for (int first = 0; first < count; first += STRIP)
        sum_strip(placed, scratch, fit, fit->residual, first, first + STRIP < count ? first + STRIP : count, false);
    for (int d = 0; d < placed->signals; d++) {
        const double *inverse_factor = fit->inverse_factor + (size_t)d * width * width;
        solve_normal(inverse_factor, scratch->sums + d * width, s, width, correction);
        for (int k = 0; k < s; k++) fit->coefficients[d * s + k] += correction[k];
    }
}

/* Generalised cross-validation score: the misfit, dearer the more functions it takes (Golub, Heath, Wahba 1979). */
static double generalises(const Placed *placed, const Fit *fit) {
    int freedom = placed->signals * placed->weighted_observations;
    for (int k = 0; k < placed->signals * placed->sparsity; k++) freedom -= fit->support[k] >= 0;
    freedom = freedom > 1 ? freedom : 1;
    return fit->misfit / ((double)freedom * freedom);
}
