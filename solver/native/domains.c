/* Where sparse functions come nearest to given points: steps through a domain (surface/format/domains.py).
 */
#include "kernel.h"

/* The sparse functions of K patches.  solver/native/domains.py has the same fields in the same order. */
typedef struct {
    int64_t signals, width, degree, legendre; /* r, s, t */
    const int32_t *degree_u, *degree_v;       /* (K, r, s): degrees (i, j) of the functions */
    const double *coefficients;               /* (K, r, s); 0 where fewer functions are used */
} SparsePatches;

/* How Gauss-Newton steps are damped: by a share of the diagonal; and the longest, and those that are followed by another.
 */
typedef struct {
    double share, tiny, longest, far;
} Damping;

/* Values and first derivatives of the one-variable polynomials at one x, (t + 1) both. */
static void polynomials_and_slopes(double x, const SparsePatches *own, double *value, double *slope) {
    polynomial_tables(value, &x, NULL, (int)own->degree, own->legendre != 0, 1);
    derivative_tables(slope, 1, value, 1, (int)own->degree, own->legendre != 0, 1);
}

/* Tables (t + 1) of the one-variable polynomials and of their slopes, along u and v. */
typedef struct {
    double *u, *v, *du, *dv;
} Tables;

static bool make_tables(Tables *tables, const SparsePatches *own) {
    size_t row = (size_t)own->degree + 1;
    tables->u = malloc(4 * row * sizeof(double));
    tables->v = tables->u + row;
    tables->du = tables->v + row;
    tables->dv = tables->du + row;
    return tables->u != NULL;
}

/* One damped Gauss-Newton step from a place (2) towards a target (r), and how fast the functions move there (2). */
static void step_towards(const SparsePatches *own, const Tables *tables, const Damping *damping, int64_t patch,
                         const double *place, const double *target, double *step, double *speed) {
    polynomials_and_slopes(place[0], own, tables->u, tables->du);
    polynomials_and_slopes(place[1], own, tables->v, tables->dv);
    double uu = 0.0, uv = 0.0, vv = 0.0, ue = 0.0, ve = 0.0;
    for (int64_t r = 0; r < own->signals; r++) {
        size_t first = (size_t)((patch * own->signals + r) * own->width);
        const int32_t *i = own->degree_u + first, *j = own->degree_v + first;
        const double *factor = own->coefficients + first;
        double missing = target[r], along_u = 0.0, along_v = 0.0;
        for (int64_t k = 0; k < own->width; k++) {
            missing -= factor[k] * tables->u[i[k]] * tables->v[j[k]];
            along_u += factor[k] * tables->du[i[k]] * tables->v[j[k]];
            along_v += factor[k] * tables->u[i[k]] * tables->dv[j[k]];
        }
        uu += along_u * along_u;
        uv += along_u * along_v;
        vv += along_v * along_v;
        ue += along_u * missing;
        ve += along_v * missing;
    }
    speed[0] = sqrt(uu);
    speed[1] = sqrt(vv);
    double damped = damping->share * (uu + vv) + damping->tiny;
    uu += damped;
    vv += damped;
    double determinant = uu * vv - uv * uv;
    step[0] = (vv * ue - uv * ve) / determinant;
    step[1] = (uu * ve - uv * ue) / determinant;
}

/* A step of no more than the longest from a place; whether it is a long one. */
static bool walk_step(const Damping *damping, const double *step, const double *place, double *nearer) {
    bool far = false;
    for (int k = 0; k < 2; k++) {
        double move = isfinite(step[k]) ? step[k] : 0.0;
        move = fmax(fmin(move, damping->longest), -damping->longest);
        nearer[k] = place[k] + move;
        far = far || fabs(nearer[k] - place[k]) > damping->far;
    }
    return far;
}

/* From each of n places of domains a step, or two where the first is long, towards the points of their patches'
 * surfaces that are nearest to the targets; and how fast the functions move with each parameter there. */
static ONE_COPY int32_t step_all(const SparsePatches *own, const Damping *damping, int64_t count, const int64_t *patch,
                                 const double *place /* (n, 2) */, const double *target /* (n, r) */,
                                 double *nearer /* (n, 2) */, double *speed /* (n, 2) */) {
    Tables tables;
    if (!make_tables(&tables, own)) return OUT_OF_MEMORY;
    for (int64_t n = 0; n < count; n++) {
        const double *towards = target + n * own->signals;
        double step[2], *to = nearer + 2 * n, first[2];
        step_towards(own, &tables, damping, patch[n], place + 2 * n, towards, step, speed + 2 * n);
        if (!walk_step(damping, step, place + 2 * n, to)) continue;
        memcpy(first, to, sizeof first);
        step_towards(own, &tables, damping, patch[n], first, towards, step, speed + 2 * n);
        walk_step(damping, step, first, to);
    }
    free(tables.u);
    return DONE;
}

int32_t ENTRY(steps_towards)(const SparsePatches *own, const Damping *damping, int64_t count, const int64_t *patch,
                             const double *place, const double *target, double *nearer, double *speed) {
    return step_all(own, damping, count, patch, place, target, nearer, speed);
}
