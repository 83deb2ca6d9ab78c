/* The dictionary of basis functions (fitting/dictionary.py): products q_i(u) q_j(v) of total degree i + j <= t (eq. 1).
 */
#include "kernel.h"

static const double LEGENDRE_SUPPORT = 1.05;

static int dictionary_size(int degree) { return (degree + 1) * (degree + 2) / 2; }

/* Number of the function q_i(u) q_j(v): they are ordered by total degree. */
static int function_number(int i, int j) { return (i + j) * (i + j + 1) / 2 + j; }

/* Degrees (i, j) of the functions, (n) both. */
static void dictionary_degrees(int degree, int32_t *degree_u, int32_t *degree_v) {
    int number = 0;
    for (int total = 0; total <= degree; total++)
        for (int j = 0; j <= total; j++, number++) {
            degree_u[number] = total - j;
            degree_v[number] = j;
        }
}

/* Values (t + 1, count) of the one-variable polynomials q_0 .. q_t at x, times `factor` (count) unless that is NULL: the
 * recursion is linear.  `stride` numbers lie between the beginnings of the rows. */
static void strip_of_tables(double *restrict table, int stride, const double *restrict x,
                            const double *restrict factor, int degree, bool legendre, int count) {
    double stretch = legendre ? 1.0 / LEGENDRE_SUPPORT : 1.0;
    for (int n = 0; n < count; n++) table[n] = factor ? factor[n] : 1.0;
    if (degree < 1) return;
    for (int n = 0; n < count; n++) table[stride + n] = stretch * x[n] * table[n];
    for (int k = 1; k < degree; k++) {
        /* Bonnet's recursion */
        double ahead = legendre ? stretch * (2 * k + 1) / (k + 1) : 1.0, back = legendre ? k / (k + 1.0) : 0.0;
        const double *lower = table + (size_t)(k - 1) * stride, *own = lower + stride;
        double *next = table + (size_t)(k + 1) * stride;
        for (int n = 0; n < count; n++) next[n] = ahead * x[n] * own[n] - back * lower[n];
    }
}

/* The same with rows that follow each other. */
static void polynomial_tables(double *table, const double *x, const double *factor, int degree, bool legendre,
                              int count) {
    strip_of_tables(table, count, x, factor, degree, legendre, count);
}

/* First derivatives (t + 1, count) of the one-variable polynomials from their values; `row` and `stride` numbers lie
 * between the beginnings of their rows. */
static void derivative_tables(double *restrict slope, int row, const double *restrict table, int stride, int degree,
                              bool legendre, int count) {
    memset(slope, 0, sizeof(double) * (size_t)count);
    for (int k = 1; k <= degree; k++) {
        /* P'_k = P'_{k-2} + (2k - 1) P_{k-1}, chain rule for the stretched support */
        double scale = legendre ? (2 * k - 1) / LEGENDRE_SUPPORT : k;
        const double *lower = table + (size_t)(k - 1) * stride;
        double *own = slope + (size_t)k * row;
        if (legendre && k >= 2)
            for (int n = 0; n < count; n++) own[n] = own[n - 2 * row] + scale * lower[n];
        else
            for (int n = 0; n < count; n++) own[n] = scale * lower[n];
    }
}

/* Coefficients of q_i q_k = sum_r c_ikr q_{i+k-2r}, (t + 1, t + 1, t + 1).
 *
 * With a_r = (1/2)_r / r! Legendre polynomials have c = a_r a_{i-r} a_{k-r} / a_{i+k-r} (2i + 2k - 4r + 1) /
 * (2i + 2k - 2r + 1) (Adams 1878), all positive; monomials have the first term alone. */
static void product_coefficients(double *restrict coefficients, int degree, bool legendre) {
    int side = degree + 1;
    double a[2 * 64 + 1] = {1.0};
    for (int r = 1; r <= 2 * degree; r++) a[r] = a[r - 1] * (2 * r - 1) / (2.0 * r);
    memset(coefficients, 0, sizeof(double) * (size_t)side * side * side);
    for (int i = 0; i <= degree; i++)
        for (int k = 0; k <= degree; k++) {
            double *own = coefficients + (size_t)(i * side + k) * side;
            int last = i < k ? i : k;
            own[0] = 1.0;
            for (int r = 0; legendre && r <= last; r++)
                own[r] = a[r] * a[i - r] * a[k - r] / a[i + k - r] * (2 * (i + k) - 4 * r + 1) /
                         (double)(2 * (i + k) - 2 * r + 1);
        }
}

/* The same as (i, r, k), rows padded: many k at once are put into a Gram matrix. */
static void turn_products(const double *coefficients, double *restrict rows, int degree) {
    int side = degree + 1, width = padded(side);
    memset(rows, 0, sizeof(double) * (size_t)side * side * width);
    for (int i = 0; i <= degree; i++)
        for (int k = 0; k <= degree; k++)
            for (int r = 0; r <= (i < k ? i : k); r++)
                rows[(size_t)(i * side + r) * width + k] = coefficients[(size_t)(i * side + k) * side + r];
}

/* Values (count) of a sparse combination of the functions; `u` and `v` are tables (t + 1, count). */
static void sparse_values(const Placed *placed, const int32_t *support, const double *coefficients,
                          const double *restrict u, const double *restrict v, int count, double *restrict values) {
    memset(values, 0, sizeof(double) * (size_t)count);
    for (int k = 0; k < placed->sparsity; k++) {
        if (support[k] < 0) continue;
        const double *along = u + (size_t)placed->degree_u[support[k]] * count;
        const double *across = v + (size_t)placed->degree_v[support[k]] * count;
        for (int n = 0; n < count; n++) values[n] += coefficients[k] * along[n] * across[n];
    }
}

/* ---- for the tests */

void ENTRY(polynomial_tables)(double *table, const double *x, int64_t degree, int64_t legendre, int64_t count) {
    polynomial_tables(table, x, NULL, (int)degree, legendre != 0, (int)count);
}

void ENTRY(derivative_tables)(double *slope, const double *table, int64_t degree, int64_t legendre, int64_t count) {
    derivative_tables(slope, (int)count, table, (int)count, (int)degree, legendre != 0, (int)count);
}

void ENTRY(product_coefficients)(double *coefficients, int64_t degree, int64_t legendre) {
    product_coefficients(coefficients, (int)degree, legendre != 0);
}
