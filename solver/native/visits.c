/* Which patches lie over the triangles that are looked at: pairs of a thing and a patch triangle over it, a patch after
 * the other.  What is done takes as long as there are pairs, however large the mesh is.
 */
#include "kernel.h"

/* The patch triangles with weight over each mesh triangle.  solver/native/surface.py has the same fields. */
typedef struct {
    const int64_t *starts; /* (T + 1) */
    const int32_t *held;   /* (H): patch triangles, ascending over each mesh triangle */
    const int32_t *patch;  /* (H): their patches */
} Holders;

/* The pairs of patch k stand from starts[k] to starts[k + 1], in the order of the things. */
typedef struct {
    int64_t *starts;       /* (K + 1) */
    int64_t *thing, *held; /* (n) */
} Visits;

static void forget_visits(Visits *visits) {
    free(visits->starts);
    free(visits->thing);
    free(visits->held);
}

/* Find the pairs of things that lie in these mesh triangles, sorted by counting; tells whether memory sufficed. */
static ONE_COPY bool find_visits(int64_t patches, const Holders *holders, const int64_t *triangle, int64_t things,
                                 Visits *visits) {
    int64_t pairs = 0;
    for (int64_t k = 0; k < things; k++) pairs += holders->starts[triangle[k] + 1] - holders->starts[triangle[k]];
    visits->starts = calloc((size_t)patches + 2, sizeof(int64_t));
    visits->thing = malloc(sizeof(int64_t) * (size_t)(pairs + 1));
    visits->held = malloc(sizeof(int64_t) * (size_t)(pairs + 1));
    if (!visits->starts || !visits->thing || !visits->held) {
        forget_visits(visits);
        return false;
    }
    int64_t *next = visits->starts + 1;
    for (int64_t k = 0; k < things; k++)
        for (int64_t h = holders->starts[triangle[k]]; h < holders->starts[triangle[k] + 1]; h++)
            next[holders->patch[h] + 1]++;
    for (int64_t k = 0; k < patches; k++) next[k + 1] += next[k];
    /* next[k] becomes the end of patch k, which is where the next one starts */
    for (int64_t k = 0; k < things; k++)
        for (int64_t h = holders->starts[triangle[k]]; h < holders->starts[triangle[k] + 1]; h++) {
            int64_t place = next[holders->patch[h]]++;
            visits->thing[place] = k;
            visits->held[place] = holders->held[h];
        }
    return true;
}
