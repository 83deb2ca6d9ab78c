/* What known values suggest for the next ones: means over links (surface/format/positions.py and domains.py). */
#include "kernel.h"

/* The links of a round.  solver/native/predicted.py has the same fields in the same order. */
typedef struct {
    int64_t links, owners; /* q, n */
    const int64_t *link;   /* (q): which of all */
    const int64_t *owner;  /* (q): below n; each of n has one at least */
} Round;

static int64_t *counted(const Round *round) {
    int64_t *count = calloc((size_t)round->owners + 1, sizeof *count);
    if (count)
        for (int64_t q = 0; q < round->links; q++) count[round->owner[q]]++;
    return count;
}

/* Divide the sums (n, width) of all owners by how many links each has. */
static int32_t divide(const Round *round, int64_t *count, double *mean, int width) {
    if (!count) return OUT_OF_MEMORY;
    for (int64_t n = 0; n < round->owners; n++)
        for (int k = 0; k < width; k++) mean[width * n + k] /= (double)count[n];
    free(count);
    return DONE;
}

/* Means (n, 6) of a + b - c and of the sizes of the three, for corners (target, a, b, c) of all links (Q, 4). */
static ONE_COPY int32_t sum_positions(const Round *round, const int32_t *corner, const double *position /* (V, 3) */,
                                      const double *size /* (V, 3) */, double *mean) {
    memset(mean, 0, (size_t)round->owners * 6 * sizeof *mean);
    for (int64_t q = 0; q < round->links; q++) {
        const int32_t *own = corner + 4 * round->link[q];
        double *sum = mean + 6 * round->owner[q];
        for (int k = 0; k < 3; k++) {
            int64_t a = 3 * (int64_t)own[1] + k, b = 3 * (int64_t)own[2] + k, c = 3 * (int64_t)own[3] + k;
            sum[k] += position[a] + position[b] - position[c];
            sum[3 + k] += (size[a] + size[b] + size[c]) / 3.0;
        }
    }
    return divide(round, counted(round), mean, 6);
}

int32_t ENTRY(positions_across)(const Round *round, const int32_t *corner, const double *position, const double *size,
                                double *mean) {
    return sum_positions(round, corner, position, size, mean);
}

/* S patch triangles, and where the third corner of a mesh triangle lies: solver/surface/format/domains.py. */
typedef struct {
    int64_t patch_triangles, mesh_triangles; /* S, T */
    const int32_t *link;                     /* (3 S, 3): patch vertices that are target, a and b of each link */
    const int64_t *triangle;                 /* (S): the mesh's triangle */
    const double *share, *height;            /* (3, T) */
} Unfolded;

/* Means (n, 5) of where links suggest domains, by what their ends were off, and of how large that was.  Link k S + s
 * leads from the corners a = k + 1 and b = k + 2 of patch triangle s to its corner k. */
static ONE_COPY int32_t sum_domains(const Round *round, const Unfolded *own, const double *domain /* (M, 2) */,
                                    const double *off /* (M, 2) */, const double *size /* (M, 2) */, double *mean) {
    memset(mean, 0, (size_t)round->owners * 5 * sizeof *mean);
    for (int64_t q = 0; q < round->links; q++) {
        int64_t link = round->link[q], side = (link >= own->patch_triangles) + (link >= 2 * own->patch_triangles);
        int64_t a = 2 * (int64_t)own->link[3 * link + 1], b = 2 * (int64_t)own->link[3 * link + 2];
        int64_t triangle = side * own->mesh_triangles + own->triangle[link - side * own->patch_triangles];
        double share = own->share[triangle], height = own->height[triangle];
        double along_u = domain[b] - domain[a], along_v = domain[b + 1] - domain[a + 1];
        double *sum = mean + 5 * round->owner[q];
        sum[0] += domain[a] + share * along_u - height * along_v;
        sum[1] += domain[a + 1] + share * along_v + height * along_u;
        sum[2] += (off[a] + off[b]) / 2.0;
        sum[3] += (off[a + 1] + off[b + 1]) / 2.0;
        sum[4] += (size[a] + size[b] + (size[a + 1] + size[b + 1])) / 4.0;
    }
    return divide(round, counted(round), mean, 5);
}

int32_t ENTRY(domains_across)(const Round *round, const Unfolded *own, const double *domain, const double *off,
                              const double *size, double *mean) {
    return sum_domains(round, own, domain, off, size, mean);
}
