/* The default patch solver, compiled: what its files share.
 *
 * One problem at a time is solved from beginning to end, so that all it needs stays in a processor's second cache;
 * NumPy needs many problems at once instead, to make up for its calls.  Names and steps are those of the Python modules
 * in solver/fitting, which say more about the method.  Rows are padded to a multiple of eight numbers and begin at
 * multiples of 64 bytes; what pads observations has no weight, so no loop needs a remainder.
 *
 * There is no global state: every entry takes plain arrays and returns a `Status`.
 */
#ifndef SPARSE_SURFACE_KERNEL_H
#define SPARSE_SURFACE_KERNEL_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* kernel.c is compiled once for each instruction set, under names that end in it. */
#ifndef INSTRUCTIONS
#define INSTRUCTIONS baseline
#endif
#define JOINED(name, suffix) name##_##suffix
#define WITH_SUFFIX(name, suffix) JOINED(name, suffix)
#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif
/* A function that is called often from several places: a copy at each would only make the library larger. */
#define ONE_COPY __attribute__((noinline))
#define ENTRY(name) EXPORTED WITH_SUFFIX(name, INSTRUCTIONS)

typedef enum {
    DONE = 0,
    OUT_OF_MEMORY = 1,
    NOT_IN_A_TRIANGLE = 2,
    UNKNOWN_FUNCTION = 3,
    CUT_SHORT = 4, /* a file ends too early, or holds numbers that lead nowhere */
    NO_TABLE = 5,  /* it has a number in a context that it has no table for */
    TOO_LARGE = 6, /* or a value that is too large, or none */
} Status;

enum { PAD = 8, FRAME_SIZE = 10 };

static inline int padded(int count) { return (count + PAD - 1) / PAD * PAD; }

/* Observations that are gone through together: what belongs to them stays in the first cache. */
enum { STRIP = 8 * PAD };

/* One domain with N observations of its D signals, in scene units (fitting/batch.py, Problem), and where its solution
 * goes.  fitting/native_chunks.py has the same fields in the same order. */
typedef struct {
    int64_t vertex_count, triangle_count, observation_count, signal_count; /* m, t, N, D */
    int64_t degree;           /* highest total degree */
    int64_t width;            /* s: places of `support` and `coefficients` */
    int64_t warm;             /* whether frame, domain_out and support hold an earlier solution */
    int64_t ends_early;       /* whether a good fit may end before the regularisation is annealed */
    double noise;             /* standard deviation, scene units */
    const double *domain;     /* (m, 2) */
    const int64_t *triangles; /* (t, 3) */
    const double *signals;    /* (m, D) */
    const int64_t *corners;   /* (N, 3) */
    const double *shares;     /* (N, 3) */
    const double *values;     /* (N, D) */
    const double *weights;    /* (N) */
    double *frame;            /* (10): centre (2), turn (2, 2), origin (3), scale */
    double *start;            /* (m, 2), in the frame */
    double *solved;           /* (m, 2), in the frame */
    int64_t *support;         /* (D, s); -1 where none was chosen */
    double *coefficients;     /* (D, s) */
    double *fitted;           /* (N, D), scene units */
    double *energy;           /* (max(iterations, 1)); NULL for warm starts */
    double *squared_error;    /* (max(iterations, 1)), scene units */
    double *history;          /* (max(iterations, 1), m, D), scene units; or NULL */
} Problem;

typedef struct {
    int64_t sparsity, iterations;
    int64_t legendre; /* the basis: Legendre polynomials, or monomials */
    int64_t ols;      /* the pursuit: orthogonal least squares, or matching pursuit */
    double beta1, beta2, rigidity_decay;
} Settings;

/* How a problem was moved, turned and scaled: domain = (u - centre) turn scale, values = (b - origin) scale. */
typedef struct {
    double centre[2], turn[4], origin[3], scale;
} Frame;

/* Memory that is given out piece by piece; without any it only counts how much is needed. */
typedef struct {
    char *memory;
    size_t used;
} Arena;

/* A problem in its frame, padded (one of those that fitting/batch.py holds in a Batch). */
typedef struct {
    int vertices, padded_vertices, triangle_count, observations, padded_observations, signals;
    int degree, size;            /* dictionary: highest total degree, number of functions n */
    int sparsity, width;         /* s, and s padded */
    bool legendre;
    Frame frame;
    double noise;                /* variance along a function of the weighted observations */
    int weighted_observations;   /* those that have a weight */
    const double *shares;        /* (N, 3) */
    int32_t *triangles, *corners; /* (t, 3), (N, 3) */
    double *start;               /* (2, m) */
    double *values;              /* (D, N), not weighted */
    double *weights, *root_weights; /* (N) */
    int32_t *degree_u, *degree_v; /* (n): degrees (i, j) of the functions */
    /* regularisation (domain_energy.c) */
    double *hat_u, *hat_v, *area; /* (t, 3) twice, (t) */
    /* The system's sparse part (gauss_newton.c): vertices that share a triangle with vertex v stand from first[v] to end[v]
     * as places in vectors, and the observations of which it has a share end at column_end[v]. */
    int32_t *first, *end, *neighbour;
    int32_t *triangle_pairs, *pairs; /* (t, 6), (N, 6): where pairs of corners stand among the neighbours */
    int32_t *column_end, *column; /* (m), (3 N) */
    double *column_share;        /* (3 N) */
    float *laplacian, *laplacian_diagonal;
} Placed;

/* Least squares of the signals on chosen functions over a given domain (fitting/sparse_fit.py, Fit). */
typedef struct {
    int32_t *support;       /* (D, s) */
    double *coefficients;   /* (D, s) */
    double *inverse_factor; /* (D, s, s): inverse of the lower Cholesky factor of the Gram matrix */
    float *functions;       /* (N, D, s): weighted; functions last, for the sums over observations are over rows */
    double *residual;       /* (D, N): weighted */
    double *u, *v;          /* tables (t + 1, N); v weighted */
    double misfit;
} Fit;

/* Functions chosen so far and all functions' least squares on them (fitting/pursuit.py, _Selection). */
typedef struct {
    int32_t *support;
    double *inverse;      /* (s, s) */
    double *regression;   /* (s, n) */
    double *coefficients; /* (s) */
    double *remaining, *correlation; /* (n) */
} Selection;

/* What the choice of functions needs. */
typedef struct {
    double *gram, *correlation; /* (n, n), (D, n); rows padded */
    double *products;           /* (t + 1, t + 1, t + 1): coefficients of products of polynomials */
    double *product_rows;       /* the same, (i, r, k) instead of (i, k, r), rows padded */
    double *u, *v, *rows;       /* tables up to twice the degree; rows that are summed up */
    double *moments;            /* (2 t + 1, 2 t + 1), padded */
    double *greedy;             /* (s + 5, n): orthogonalised rows, and what goes with them */
    double *small;              /* (3, s, s + 1): small systems */
    int32_t *low, *previous;    /* (s), (D, s) */
    Selection selection;
} Choice;

/* A block of the system: uu, uv, vu, vv. */
typedef float Quad __attribute__((vector_size(4 * sizeof(float)), may_alias));

/* The Gauss-Newton system (gauss_newton.c), and the conjugate gradients' vectors: u and v of a vertex side by side. */
typedef struct {
    Quad *blocks, *diagonal; /* (neighbours), (m): the sparse part */
    Quad *inverse;           /* (m): of the blocks on the diagonal */
    float *collected;         /* (D s, 2 m): functions times slopes, collected at the vertices */
    float *tile;              /* some columns of them, (PAD, D s) */
    double *normal_inverse;   /* (D, s, s): inverse Gram matrices of the functions */
    double *sums;             /* (s) */
    float *move, *residual, *direction, *applied, *preconditioned; /* (2 m) */
} System;

/* The functions of one signal: their degrees along u and v, and their coefficients, (s) each. */
typedef struct {
    int count;
    int32_t *u, *v;
    double *coefficient;
} Terms;

/* Where the solver stands (fitting/methods/variable_projection.py, State), and its scratch memory. */
typedef struct {
    double *domain, *tried; /* (2, m) */
    Fit fit, other;
    double damping;
    bool settled;
    double *jacobian, *changed, *change; /* (4, t) */
    double *gradient;                    /* (2, D, N) */
    double *slope_u, *slope_v;           /* (t + 1, STRIP): of a strip of observations */
    double *table_u, *table_v;           /* (t + 1, max(m, N)): at other places */
    double *strip, *gram, *sums;         /* (STRIP, D, s): functions; (D, s, s), (D, s): what is summed over strips */
    Terms terms;
    double *force, *observed;            /* (2, m), (2, max(m, N)) */
    System system;
    Choice choice;
} State;

#endif
