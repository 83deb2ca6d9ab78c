/* Where sparse functions come nearest to given points: steps through a domain (surface/format/domains.py).
 */
#include "kernel.h"

/* The sparse functions of K patches.  solver/native/domains.py has the same fields in the same order. */
typedef struct {
    int64_t signals, width, degree, legendre; /* r, s, t */
    const int32_t *degree_u, *degree_v;       /* (K, r, s): degrees (i, j) of the functions */
    const double *coefficients;               /* (K, r, s); 0 where fewer functions are used */
} SparsePatches;

/* Values and first derivatives of the one-variable polynomials at one x, (t + 1) both. */
static void polynomials_and_slopes(double x, const SparsePatches *own, double *value, double *slope) {
    polynomial_tables(value, &x, NULL, (int)own->degree, own->legendre != 0, 1);
    derivative_tables(slope, 1, value, 1, (int)own->degree, own->legendre != 0, 1);
}

/* One Gauss-Newton step from each of n places of domains towards the points of their patches' surfaces that are nearest
 * to the targets; and how fast the functions move with each parameter there. */
int32_t ENTRY(steps_towards)(const SparsePatches *own, int64_t count, const int64_t *patch,
                             const double *place /* (n, 2) */, const double *target /* (n, r) */, double damping,
                             double tiny, double *step /* (n, 2) */, double *speed /* (n, 2) */) {
    size_t row = (size_t)own->degree + 1;
    double *u = malloc(4 * row * sizeof(double)), *v = u + row, *du = v + row, *dv = du + row;
    if (!u) return OUT_OF_MEMORY;
    for (int64_t n = 0; n < count; n++) {
        polynomials_and_slopes(place[2 * n], own, u, du);
        polynomials_and_slopes(place[2 * n + 1], own, v, dv);
        double uu = 0.0, uv = 0.0, vv = 0.0, ue = 0.0, ve = 0.0;
        for (int64_t r = 0; r < own->signals; r++) {
            size_t first = (size_t)((patch[n] * own->signals + r) * own->width);
            const int32_t *i = own->degree_u + first, *j = own->degree_v + first;
            const double *factor = own->coefficients + first;
            double missing = target[n * own->signals + r], along_u = 0.0, along_v = 0.0;
            for (int64_t k = 0; k < own->width; k++) {
                missing -= factor[k] * u[i[k]] * v[j[k]];
                along_u += factor[k] * du[i[k]] * v[j[k]];
                along_v += factor[k] * u[i[k]] * dv[j[k]];
            }
            uu += along_u * along_u;
            uv += along_u * along_v;
            vv += along_v * along_v;
            ue += along_u * missing;
            ve += along_v * missing;
        }
        speed[2 * n] = sqrt(uu);
        speed[2 * n + 1] = sqrt(vv);
        double damped = damping * (uu + vv) + tiny;
        uu += damped;
        vv += damped;
        double determinant = uu * vv - uv * uv;
        step[2 * n] = (vv * ue - uv * ve) / determinant;
        step[2 * n + 1] = (uu * ve - uv * ue) / determinant;
    }
    free(u);
    return DONE;
}
