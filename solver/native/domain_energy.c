/* Regularisation of the domain (fitting/domain_energy.py): Q(U) = beta1 Q1(U) + beta2 Q2(U) (eq. 4).
 *
 * Q1 sums squared distances from the initial domain, Q2 the triangles' areas times |J - R|^2 with J the Jacobian of the
 * domain transformation and R the rotation nearest to it.  Jacobians are (4, t): J11, J12, J21, J22.
 */
#include "kernel.h"

/* Areas of the initial domain's triangles, and the gradients of their hat functions.  Those without area weigh nothing.
 */
static void measure_triangles(Placed *placed) {
    const double *x = placed->start, *y = x + placed->padded_vertices;
    for (int k = 0; k < placed->triangle_count; k++) {
        const int32_t *corner = placed->triangles + 3 * k;
        int a = corner[0], b = corner[1], c = corner[2];
        double doubled = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]);
        double inverse = doubled != 0.0 ? 1.0 / doubled : 0.0;
        double *along_u = placed->hat_u + 3 * k, *along_v = placed->hat_v + 3 * k;
        /* the opposite edge, turned by a right angle, over the doubled area */
        along_u[0] = -(y[c] - y[b]) * inverse, along_v[0] = (x[c] - x[b]) * inverse;
        along_u[1] = -(y[a] - y[c]) * inverse, along_v[1] = (x[a] - x[c]) * inverse;
        along_u[2] = -(y[b] - y[a]) * inverse, along_v[2] = (x[b] - x[a]) * inverse;
        placed->area[k] = fabs(doubled) / 2.0;
    }
}

/* Jacobian (4, t) of the transformation to `domain` (2, m) on every triangle. */
static void jacobian_of(const Placed *placed, const double *domain, double *restrict jacobian) {
    int t = placed->triangle_count;
    const double *x = domain, *y = domain + placed->padded_vertices;
    for (int k = 0; k < t; k++) {
        const int32_t *c = placed->triangles + 3 * k;
        const double *u = placed->hat_u + 3 * k, *v = placed->hat_v + 3 * k;
        jacobian[k] = u[0] * x[c[0]] + u[1] * x[c[1]] + u[2] * x[c[2]];
        jacobian[t + k] = v[0] * x[c[0]] + v[1] * x[c[1]] + v[2] * x[c[2]];
        jacobian[2 * t + k] = u[0] * y[c[0]] + u[1] * y[c[1]] + u[2] * y[c[2]];
        jacobian[3 * t + k] = v[0] * y[c[0]] + v[1] * y[c[1]] + v[2] * y[c[2]];
    }
}

/* Q(U). */
static double regularisation(const Placed *placed, const double *domain, const double *restrict jacobian, double beta1,
                             double beta2) {
    int t = placed->triangle_count;
    double proximity = 0.0, rigidity = 0.0;
    for (int k = 0; k < 2 * placed->padded_vertices; k++) {
        double distance = domain[k] - placed->start[k];
        proximity += distance * distance;
    }
    for (int k = 0; k < t; k++) {
        double a = jacobian[k], b = jacobian[t + k], c = jacobian[2 * t + k], d = jacobian[3 * t + k];
        double length = sqrt((a + d) * (a + d) + (b - c) * (b - c));
        double misfit = a * a + b * b + c * c + d * d + 2.0 - 2.0 * length;
        rigidity += placed->area[k] * (misfit > 0.0 ? misfit : 0.0);
    }
    return beta1 * proximity + beta2 * rigidity;
}

/* Take half the gradient of Q from `force` (2, m): beta1 (U - U0) + beta2 D^T A (J - R). */
static void subtract_regularisation(const Placed *placed, const double *domain, const double *restrict jacobian,
                                    double beta1, double beta2, double *restrict force) {
    int t = placed->triangle_count;
    double *force_v = force + placed->padded_vertices;
    for (int k = 0; k < 2 * placed->padded_vertices; k++) force[k] -= beta1 * (domain[k] - placed->start[k]);
    for (int k = 0; k < t; k++) {
        double a = jacobian[k], b = jacobian[t + k], c = jacobian[2 * t + k], d = jacobian[3 * t + k];
        double cosine = a + d, sine = c - b, length = sqrt(cosine * cosine + sine * sine);
        cosine = length > 0.0 ? cosine / length : 1.0;
        sine = length > 0.0 ? sine / length : 0.0;
        double weight = beta2 * placed->area[k];
        a = weight * (a - cosine), b = weight * (b + sine), c = weight * (c - sine), d = weight * (d - cosine);
        const double *u = placed->hat_u + 3 * k, *v = placed->hat_v + 3 * k;
        for (int corner = 0; corner < 3; corner++) {
            int vertex = placed->triangles[3 * k + corner];
            force[vertex] -= u[corner] * a + v[corner] * b;
            force_v[vertex] -= u[corner] * c + v[corner] * d;
        }
    }
}

/* The part of `largest_step` for `count` triangles: lowers `least` (count). */
static inline void step_until(const double *restrict jacobian, const double *restrict change, int t, int count,
                              double floor, double *restrict least) {
    for (int k = 0; k < count; k++) {
        double a = jacobian[k], b = jacobian[t + k], c = jacobian[2 * t + k], d = jacobian[3 * t + k];
        double da = change[k], db = change[t + k], dc = change[2 * t + k], dd = change[3 * t + k];
        double square = da * dd - db * dc, slope = a * dd + d * da - b * dc - c * db;
        double constant = larger(a * d - b * c - floor, 0.0), inner = slope * slope - 4.0 * square * constant;
        /* the numerically stable form of the smallest positive root of square x^2 + slope x + constant */
        double below = -slope + sqrt(larger(inner, 0.0)), root = 2.0 * constant / below;
        bool ends = (inner >= 0.0) & (below > 0.0) & (root < least[k]);
        least[k] = ends ? root : least[k];
    }
}

/* Largest a >= 0 such that det(J + x dJ) stays at or above `floor` on every triangle for all x in [0, a]; eight
 * triangles at a time, for their roots and divisions to be done together. */
static double largest_step(const double *restrict jacobian, const double *restrict change, int t, double floor) {
    double least[PAD], smallest = INFINITY;
    int k = 0;
    for (int lane = 0; lane < PAD; lane++) least[lane] = INFINITY;
    for (; k + PAD <= t; k += PAD) step_until(jacobian + k, change + k, t, PAD, floor, least);
    step_until(jacobian + k, change + k, t, t - k, floor, least);
    for (int lane = 0; lane < PAD; lane++) smallest = smaller(smallest, least[lane]);
    return smallest;
}

/* ---- for the tests */

double ENTRY(largest_step)(const double *jacobian, const double *change, int64_t triangles, double floor) {
    return largest_step(jacobian, change, (int)triangles, floor);
}
