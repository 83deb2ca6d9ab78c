/* What the patches of a mesh are fitted to, gathered from the mesh's arrays (patches/observations.py), and the blend of
 * the patches at the observations (approximation/sweeps.py). */
#include "kernel.h"

static const double PLATEAU = 0.05; /* of patches/blending.py */

/* Points inside triangles. */
typedef struct {
    int64_t count;        /* points in each triangle */
    const double *shares; /* (count, 3): barycentric coordinates */
    const int64_t *first; /* (T): number of a triangle's first point */
} Inside;

/* K patches over a mesh.  solver/native/observations.py has the same fields in the same order. */
typedef struct {
    const int64_t *vertex_offsets, *vertices, *nodes;               /* (K + 1), (M), (M) */
    const int64_t *triangle_offsets, *triangles, *mesh_triangles;   /* (K + 1), (S, 3), (S) */
    const int64_t *corners;                                         /* (S, 3): triangles as the mesh turns them */
    const double *positions, *points, *domains;                     /* (V, 3), (O, 3), (M, 2) */
    const double *blending;                                         /* (M) */
    const double *vertex_weights; /* (V), or NULL for ones */
    const int64_t *overlap;       /* (T): patches of each triangle, which count alike; NULL where `blending` counts */
    const uint8_t *dense, *closely; /* (K), (T): which of `inside` a patch has, and a triangle in every patch */
    const double *node_weights;     /* (N): of vertices */
    const double *inside_weights;   /* (K): of all points inside a triangle together */
    Inside inside[2];
} Observed;

/* Where the arrays of some patches go, one patch after the other: m, t, N in all.  NULL where they are not wanted. */
typedef struct {
    double *domain;            /* (m, 2) */
    int64_t *triangles;        /* (t, 3) */
    double *signals;           /* (m, 3) */
    int64_t *corners;          /* (N, 3) */
    double *shares, *values;   /* (N, 3) */
    double *weights;           /* (N) */
    int64_t *number;           /* (N) */
    double *blending;          /* (N) */
} Gathered;

/* A patch's own part of the arrays. */
static Gathered part_of(const Gathered *all, int64_t vertices, int64_t triangles, int64_t observations) {
    Gathered own = {
        all->domain ? all->domain + 2 * vertices : NULL,
        all->triangles ? all->triangles + 3 * triangles : NULL,
        all->signals ? all->signals + 3 * vertices : NULL,
        all->corners ? all->corners + 3 * observations : NULL,
        all->shares ? all->shares + 3 * observations : NULL,
        all->values ? all->values + 3 * observations : NULL,
        all->weights ? all->weights + observations : NULL,
        all->number + observations,
        all->blending + observations,
    };
    return own;
}

/* An observation between three vertices of a patch, with its blending weight and its own weight. */
static void put_observation(const Observed *observed, const Gathered *own, int64_t n, int64_t first_vertex,
                            const int64_t *corners, const double *shares, int64_t number, double weight) {
    double blending = 0.0, given = 0.0;
    for (int k = 0; k < 3; k++) {
        int64_t vertex = first_vertex + corners[k];
        blending += observed->blending[vertex] * shares[k];
        if (observed->vertex_weights) given += observed->vertex_weights[observed->vertices[vertex]] * shares[k];
    }
    own->number[n] = number;
    own->blending[n] = blending;
    if (!own->corners) return;
    for (int k = 0; k < 3; k++) {
        own->corners[3 * n + k] = corners[k];
        own->shares[3 * n + k] = shares[k];
        own->values[3 * n + k] = observed->points[3 * number + k];
    }
    own->weights[n] = observed->vertex_weights ? weight * given : weight;
}

/* The observations of one patch: its vertices, then the points inside its triangles; returns how many. */
static int64_t put_observations(const Observed *observed, const Gathered *own, int64_t patch) {
    static const double at_vertex[3] = {1.0, 0.0, 0.0};
    int64_t first_vertex = observed->vertex_offsets[patch], n = 0;
    for (int64_t v = first_vertex; v < observed->vertex_offsets[patch + 1]; v++, n++) {
        int64_t corners[3] = {n, n, n};
        int64_t node = observed->nodes[v];
        put_observation(observed, own, n, first_vertex, corners, at_vertex, node, observed->node_weights[node]);
    }
    for (int64_t t = observed->triangle_offsets[patch]; t < observed->triangle_offsets[patch + 1]; t++) {
        int64_t triangle = observed->mesh_triangles[t];
        const Inside *inside = observed->inside + (observed->dense[patch] || observed->closely[triangle]);
        double weight = inside->count ? observed->inside_weights[patch] / (double)inside->count : 0.0;
        for (int64_t k = 0; k < inside->count; k++, n++) {
            put_observation(observed, own, n, first_vertex, observed->corners + 3 * t, inside->shares + 3 * k,
                            inside->first[triangle] + k, weight);
            if (observed->overlap) own->blending[n] = 1.0 / (double)observed->overlap[triangle];
        }
    }
    return n;
}

/* Domain, triangles and signals at the vertices of one patch. */
static void put_patch(const Observed *observed, const Gathered *own, int64_t patch) {
    int64_t first = observed->vertex_offsets[patch], count = observed->vertex_offsets[patch + 1] - first;
    int64_t triangle = observed->triangle_offsets[patch], end = observed->triangle_offsets[patch + 1];
    memcpy(own->domain, observed->domains + 2 * first, sizeof(double) * 2 * (size_t)count);
    memcpy(own->triangles, observed->triangles + 3 * triangle, sizeof(int64_t) * 3 * (size_t)(end - triangle));
    for (int64_t v = 0; v < count; v++)
        for (int k = 0; k < 3; k++)
            own->signals[3 * v + k] = observed->positions[3 * observed->vertices[first + v] + k];
}

/* Gather what `count` patches are fitted to. */
int ENTRY(observe_patches)(const Observed *observed, const int64_t *patches, int64_t count, const Gathered *all) {
    int64_t vertices = 0, triangles = 0, observations = 0;
    for (int64_t k = 0; k < count; k++) {
        Gathered own = part_of(all, vertices, triangles, observations);
        observations += put_observations(observed, &own, patches[k]);
        if (own.domain) put_patch(observed, &own, patches[k]);
        vertices += observed->vertex_offsets[patches[k] + 1] - observed->vertex_offsets[patches[k]];
        triangles += observed->triangle_offsets[patches[k] + 1] - observed->triangle_offsets[patches[k]];
    }
    return DONE;
}

/* Scale weights to a sum. */
static void scale_to(double *weights, int64_t count, double total) {
    double sum = 0.0;
    for (int64_t n = 0; n < count; n++) sum += weights[n];
    if (!(sum > 0.0)) return;
    for (int64_t n = 0; n < count; n++) weights[n] *= total / sum;
}

/* Turn weights of observations into those of a fit (patches/blending.py, fitting_weights); rows end at `offsets`. */
int ENTRY(fitting_weights)(const int64_t *offsets, int64_t count, const double *blending, double *weights) {
    for (int64_t k = 0; k < count; k++) {
        double total = 0.0;
        for (int64_t n = offsets[k]; n < offsets[k + 1]; n++) {
            total += weights[n];
            weights[n] *= blending[n] * blending[n] + PLATEAU;
        }
        scale_to(weights + offsets[k], offsets[k + 1] - offsets[k], total);
    }
    return DONE;
}

/* The blend of all patches at the observations. */
typedef struct {
    const double *points; /* (O, 3): the data */
    double *blended;      /* (O, 3) */
} Blended;

/* Turn the data of patches, `values` and `weights`, into what a sweep fits them to (sweeps.py, against_remainder);
 * `fitted` are their values so far. */
int ENTRY(against_remainder)(const int64_t *offsets, int64_t count, const int64_t *number, const double *blending,
                             const Blended *blend, const double *fitted, double anti_drift, double *values,
                             double *weights) {
    for (int64_t k = 0; k < count; k++) {
        double total = 0.0;
        for (int64_t n = offsets[k]; n < offsets[k + 1]; n++) {
            double phi = blending[n], share = phi * phi + anti_drift;
            total += weights[n];
            weights[n] *= share;
            for (int axis = 0; axis < 3; axis++) {
                int64_t there = 3 * number[n] + axis;
                double left = blend->points[there] - blend->blended[there] + phi * fitted[3 * n + axis];
                values[3 * n + axis] = (phi * left + anti_drift * values[3 * n + axis]) / share;
            }
        }
        scale_to(weights + offsets[k], offsets[k + 1] - offsets[k], total);
    }
    return DONE;
}

/* Replace the part that patches have in the blend; without earlier values, NULL, that part is the data. */
int ENTRY(exchange)(int64_t count, const int64_t *number, const double *blending, const double *before,
                    const double *after, const Blended *blend) {
    for (int64_t n = 0; n < count; n++)
        for (int axis = 0; axis < 3; axis++) {
            int64_t there = 3 * number[n] + axis;
            double earlier = before ? before[3 * n + axis] : blend->points[there];
            blend->blended[there] += blending[n] * (after[3 * n + axis] - earlier);
        }
    return DONE;
}
