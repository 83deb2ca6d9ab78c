/* What closes a surface along its creases (surface/closing.py), at the corners of parts of triangles. */
#include "kernel.h"

/* solver/native/bounds.py has the same fields in the same order. */
typedef struct {
    const int64_t *row;         /* (T): number among the triangles that have a correction, or -1 */
    const double *corners;      /* (R, 3, 3): d_v */
    const int64_t *edge;        /* (R, 3): polynomial of each side, or -1 */
    int64_t terms;              /* n */
    const double *polynomials;  /* (P, n, 3): Chebyshev coefficients of B_e */
    const double *largest, *bend; /* (P): bounds of |B_e| and |B_e''| */
} Closing;

/* Add (lambda_v + lambda_w) B_e(lambda_w / (lambda_v + lambda_w)) for lambda_v = start, lambda_w = end. */
static ONE_COPY void add_along(const Closing *closing, int64_t edge, double start, double end, double *correction) {
    double total = start + end, place = total > 0.0 ? (end - start) / total : 0.0;
    double before = 1.0, now = place, sum[3];
    const double *terms = closing->polynomials + 3 * (size_t)(edge * closing->terms);
    for (int d = 0; d < 3; d++) sum[d] = terms[d];
    for (int64_t j = 1; j < closing->terms; j++) {
        for (int d = 0; d < 3; d++) sum[d] += now * terms[3 * j + d];
        double next = 2.0 * place * now - before;
        before = now;
        now = next;
    }
    for (int d = 0; d < 3; d++) correction[d] += total * sum[d];
}

/* How far the correction of a crease edge is from linear between the corners of a part, whose shares of the edge's ends
 * are (3, 2). */
static double left_out_along(const Closing *closing, int64_t edge, double shares[3][2]) {
    double least = INFINITY, most = 0.0, step = 0.0;
    for (int k = 0; k < 3; k++) {
        double total = shares[k][0] + shares[k][1];
        least = smaller(least, total);
        most = larger(most, total);
        for (int end = 0; end < 2; end++) step = larger(step, fabs(shares[k][end] - shares[(k + 2) % 3][end]));
    }
    double flat = 2.0 * most * closing->largest[edge];
    return least > 0.0 ? smaller(flat, 0.5 * closing->bend[edge] * step * step / least) : flat;
}

/* The correction (3, 3) at the corners of a part, given in the triangle's barycentric coordinates, (3, 3); returns how
 * far it is from linear in between. */
static double correction_at(const Closing *closing, int64_t row, const double *corners, double *correction) {
    const double *own = closing->corners + 9 * row;
    double left_out = 0.0;
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++)
            correction[3 * k + d] =
                corners[3 * k] * own[d] + corners[3 * k + 1] * own[3 + d] + corners[3 * k + 2] * own[6 + d];
    for (int side = 0; side < 3; side++) {
        int64_t edge = closing->edge[3 * row + side];
        if (edge < 0) continue;
        double shares[3][2];
        for (int k = 0; k < 3; k++) {
            shares[k][0] = corners[3 * k + side];
            shares[k][1] = corners[3 * k + (side + 1) % 3];
            add_along(closing, edge, shares[k][0], shares[k][1], correction + 3 * k);
        }
        left_out += left_out_along(closing, edge, shares);
    }
    return left_out;
}
