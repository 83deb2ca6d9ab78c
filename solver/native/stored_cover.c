/* The cover of a file, found again (surface/format/cover.py): rings of any sizes, and hops within patches. */
#include "kernel.h"

/* Rings around `count` centres, one after the other.  solver/native/stored_cover.py has the same fields in the same
 * order. */
typedef struct {
    int64_t count;
    const int64_t *centre, *radius; /* (count) */
    int64_t room;                   /* how many triangles fit */
    int64_t *size;                  /* (count) */
    int64_t *triangle;              /* (room) */
    int64_t done;                   /* how many rings fitted */
} Rings;

/* Enter the corners of a triangle that no patch of this number has met. */
static int64_t enter_corners(const Surface *surface, Marks *marks, int32_t patch, int64_t triangle, int64_t reached) {
    for (int k = 0; k < 3; k++) {
        int64_t node = surface->corners[3 * triangle + k];
        if (marks->node[node] == patch) continue;
        marks->node[node] = patch;
        marks->queue[reached++] = (int32_t)node;
    }
    return reached;
}

/* Find the triangles that touch the (radius - 1)-ring of a node; returns how many there are, or -1 if they are more than
 * fit. */
static int64_t grow_ring(const Surface *surface, Marks *marks, int32_t patch, int64_t centre, int64_t radius,
                         int64_t *found, int64_t room) {
    int64_t reached = 0, next = 0, count = 0;
    if (radius < 1) return 0;
    marks->queue[reached++] = (int32_t)centre;
    marks->node[centre] = patch;
    for (int64_t step = 0; step < radius && next < reached; step++)
        for (int64_t end = reached; next < end; next++) {
            int64_t node = marks->queue[next];
            for (int64_t e = surface->fan_offsets[node]; e < surface->fan_offsets[node + 1]; e++) {
                int64_t triangle = surface->fan_triangles[e];
                if (marks->triangle[triangle] == patch) continue;
                if (count == room) return -1;
                marks->triangle[triangle] = patch;
                found[count++] = triangle;
                reached = enter_corners(surface, marks, patch, triangle, reached);
            }
        }
    return count;
}

/* Put different numbers in ascending order: as bits of a map (all 0, and again at the end) where these are close enough.
 */
static void put_ascending(int64_t *numbers, int64_t count, uint64_t *bits) {
    int64_t low = INT64_MAX, high = -1, made = 0;
    for (int64_t k = 0; k < count; k++) {
        low = numbers[k] < low ? numbers[k] : low;
        high = numbers[k] > high ? numbers[k] : high;
    }
    if (high / 64 - low / 64 > 16 * count) {
        qsort(numbers, (size_t)count, sizeof *numbers, ascending_numbers);
        return;
    }
    for (int64_t k = 0; k < count; k++) bits[numbers[k] / 64] |= (uint64_t)1 << numbers[k] % 64;
    for (int64_t word = low / 64; word <= high / 64; word++) {
        for (uint64_t left = bits[word]; left; left &= left - 1) numbers[made++] = 64 * word + __builtin_ctzll(left);
        bits[word] = 0;
    }
}

/* Grow rings until one does not fit; the triangles of each ascend. */
int ENTRY(grow_rings)(const Surface *surface, Rings *rings) {
    Marks marks;
    int64_t total = 0, size;
    uint64_t *bits = calloc((size_t)surface->triangles / 64 + 1, sizeof *bits);
    if (!bits || !memory_for_marks(surface, &marks)) {
        free(bits);
        return OUT_OF_MEMORY;
    }
    for (rings->done = 0; rings->done < rings->count; rings->done++) {
        int64_t k = rings->done, *own = rings->triangle + total;
        size = grow_ring(surface, &marks, (int32_t)(k + 1), rings->centre[k], rings->radius[k], own, rings->room - total);
        if (size < 0) break;
        put_ascending(own, size, bits);
        rings->size[k] = size;
        total += size;
    }
    free(bits);
    free_aligned(marks.memory);
    return DONE;
}

/* Within each of K patches the edges from each vertex to the nearest where `distance`, (M), is 0; it is -1 elsewhere, and
 * stays so where none is reached.  `corners` (S, 3) are numbers of vertices over all patches. */
int ENTRY(hops_in_patches)(int64_t patches, const int64_t *offsets, const int64_t *corners, int64_t *distance) {
    for (int64_t k = 0; k < patches; k++) spread_hops(corners + 3 * offsets[k], offsets[k + 1] - offsets[k], distance);
    return DONE;
}

/* Raise shares (M) to half of the largest weight (M) in a triangle of the same patch, for corners (S, 3). */
int ENTRY(shares_nearby)(int64_t count, const int64_t *corners, const double *weight, double *share) {
    for (int64_t c = 0; c < 3 * count; c += 3) {
        double half = fmax(fmax(weight[corners[c]], weight[corners[c + 1]]), weight[corners[c + 2]]) / 2.0;
        for (int k = 0; k < 3; k++) share[corners[c + k]] = fmax(share[corners[c + k]], half);
    }
    return DONE;
}
