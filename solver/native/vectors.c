/* Memory and sums that several files use. */
#include "kernel.h"

/* The widest vectors of the instruction set.  Most loops are left to the compiler; only sums of products that have to
 * keep many results in registers are written with these (measured: 2.5 times as fast as the plain loops). */
#if defined(__AVX512F__)
enum { LANES = 8 };
#elif defined(__AVX__)
enum { LANES = 4 };
#else
enum { LANES = 2 };
#endif
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double)), may_alias));
typedef float SingleLanes __attribute__((vector_size(LANES * sizeof(float)), may_alias));
typedef float Singles __attribute__((vector_size(2 * LANES * sizeof(float)), may_alias));

/* How many numbers of a row stay in registers: two vectors of PAD, as far as an instruction set has room for them. */
enum { ROW = (int)LANES > 2 ? 2 * PAD : PAD };

/* Turn a square of numbers: rows become columns.  (Shuffled vectors make functions_of 1.6 times as
 * fast as the plain loops: measured.) */
static inline void turn(Lanes square[LANES]) {
#if defined(__clang__) || __GNUC__ >= 12
#if defined(__AVX512F__)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11)
#define HIGH(a, b) __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15)
#elif defined(__AVX__)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 4, 1, 5)
#define HIGH(a, b) __builtin_shufflevector(a, b, 2, 6, 3, 7)
#else
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 2)
#define HIGH(a, b) __builtin_shufflevector(a, b, 1, 3)
#endif
    /* Shuffling the first half of the rows with the second, like cards, takes log2(LANES) rounds. */
    for (int round = 1; round < LANES; round *= 2) {
        Lanes shuffled[LANES];
        for (int k = 0; k < LANES / 2; k++) {
            shuffled[2 * k] = LOW(square[k], square[k + LANES / 2]);
            shuffled[2 * k + 1] = HIGH(square[k], square[k + LANES / 2]);
        }
        for (int k = 0; k < LANES; k++) square[k] = shuffled[k];
    }
#undef LOW
#undef HIGH
#else
    for (int i = 0; i < LANES; i++)
        for (int j = 0; j < i; j++) {
            double number = square[i][j];
            square[i][j] = square[j][i], square[j][i] = number;
        }
#endif
}

static void *take(Arena *arena, size_t count, size_t bytes) {
    void *piece = arena->memory ? arena->memory + arena->used : NULL;
    arena->used += (count * bytes + 63) / 64 * 64;
    return piece;
}

static double *take_doubles(Arena *arena, size_t count) { return take(arena, count, sizeof(double)); }

static float *take_floats(Arena *arena, size_t count) { return take(arena, count, sizeof(float)); }

static int32_t *take_integers(Arena *arena, size_t count) { return take(arena, count, sizeof(int32_t)); }

static double sum_of(Lanes lanes) {
    double sum = 0.0;
    for (int k = 0; k < LANES; k++) sum += lanes[k];
    return sum;
}

static float sum_of_singles(Singles lanes) {
    float sum = 0.0f;
    for (int k = 0; k < 2 * LANES; k++) sum += lanes[k];
    return sum;
}

/* Unlike fmax and fmin these are not calls: they need not look for NaN. */
static double larger(double a, double b) { return a > b ? a : b; }

static double smaller(double a, double b) { return a < b ? a : b; }

static double dot(const double *restrict a, const double *restrict b, int count) {
    double sum = 0.0;
    for (int k = 0; k < count; k++) sum += a[k] * b[k];
    return sum;
}

static float dot_single(const float *restrict a, const float *restrict b, int count) {
    float sum = 0.0f;
    for (int k = 0; k < count; k++) sum += a[k] * b[k];
    return sum;
}

static double largest(const double *values, int count) {
    double most = 0.0;
    for (int k = 0; k < count; k++) most = larger(most, values[k]);
    return most;
}

/* Lower Cholesky factor of `matrix` (s, s), in place; returns the smallest pivot.  Rows have `stride` numbers. */
static double factorise(double *matrix, int s, int stride) {
    double smallest = INFINITY;
    for (int j = 0; j < s; j++) {
        double *row = matrix + (size_t)j * stride;
        double pivot = row[j] - dot(row, row, j);
        smallest = pivot < smallest ? pivot : smallest;
        row[j] = sqrt(pivot > 1e-300 ? pivot : 1e-300);
        for (int i = j + 1; i < s; i++) {
            double *below = matrix + (size_t)i * stride;
            below[j] = (below[j] - dot(below, row, j)) / row[j];
        }
    }
    return smallest;
}

/* Inverse (s, s) of a lower triangular matrix; zero above the diagonal. */
static void invert_lower(const double *factor, double *restrict inverse, int s, int stride) {
    memset(inverse, 0, sizeof(double) * (size_t)s * stride);
    for (int i = 0; i < s; i++) {
        const double *row = factor + (size_t)i * stride;
        double *out = inverse + (size_t)i * stride;
        double scale = 1.0 / row[i];
        for (int k = 0; k < i; k++) {
            const double *above = inverse + (size_t)k * stride;
            for (int j = 0; j <= k; j++) out[j] -= row[k] * above[j];
        }
        for (int j = 0; j < i; j++) out[j] *= scale;
        out[i] = scale;
    }
}

/* Memory that begins at a multiple of 64 bytes: the address that `malloc` returned stands before it. */
static char *aligned_memory(size_t bytes) {
    char *memory = malloc(bytes + 64 + sizeof(char *));
    if (!memory) return NULL;
    uintptr_t begin = ((uintptr_t)memory + sizeof(char *) + 63) / 64 * 64;
    ((char **)begin)[-1] = memory;
    return (char *)begin;
}

static void free_aligned(char *memory) {
    if (memory) free(((char **)memory)[-1]);
}
