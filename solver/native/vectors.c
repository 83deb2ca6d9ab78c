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

/* As many single numbers as rows are padded to. */
typedef float Eight __attribute__((vector_size(PAD * sizeof(float)), may_alias));

#if defined(__clang__) || __GNUC__ >= 12
#define HAS_SHUFFLES
#endif

/* Turn a square of numbers: rows become columns.  (Shuffled vectors make functions_of 1.6 times as
 * fast as the plain loops: measured.) */
static inline void turn(Lanes square[LANES]) {
#if defined(HAS_SHUFFLES) && defined(__AVX__) && !defined(__AVX512F__)
    /* by pairs of rows within the halves of a register, then by halves */
    Lanes low = __builtin_shufflevector(square[0], square[1], 0, 4, 2, 6);
    Lanes high = __builtin_shufflevector(square[0], square[1], 1, 5, 3, 7);
    Lanes other_low = __builtin_shufflevector(square[2], square[3], 0, 4, 2, 6);
    Lanes other_high = __builtin_shufflevector(square[2], square[3], 1, 5, 3, 7);
    square[0] = __builtin_shufflevector(low, other_low, 0, 1, 4, 5);
    square[1] = __builtin_shufflevector(high, other_high, 0, 1, 4, 5);
    square[2] = __builtin_shufflevector(low, other_low, 2, 3, 6, 7);
    square[3] = __builtin_shufflevector(high, other_high, 2, 3, 6, 7);
#elif defined(HAS_SHUFFLES)
#if defined(__AVX512F__)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11)
#define HIGH(a, b) __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15)
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

/* The same of single numbers: by pairs of rows, by pairs of pairs, then by halves. */
static inline void turn_eight(Eight square[PAD]) {
#if defined(HAS_SHUFFLES)
    Eight pair[PAD], four[PAD];
    for (int k = 0; k < PAD; k += 2) {
        pair[k] = __builtin_shufflevector(square[k], square[k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        pair[k + 1] = __builtin_shufflevector(square[k], square[k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int k = 0; k < PAD; k += 4)
        for (int i = 0; i < 2; i++) {
            four[k + 2 * i] = __builtin_shufflevector(pair[k + i], pair[k + i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            four[k + 2 * i + 1] = __builtin_shufflevector(pair[k + i], pair[k + i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int k = 0; k < PAD / 2; k++) {
        square[k] = __builtin_shufflevector(four[k], four[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        square[k + 4] = __builtin_shufflevector(four[k], four[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
#else
    for (int i = 0; i < PAD; i++)
        for (int j = 0; j < i; j++) {
            float number = square[i][j];
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
