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

/* Grow rings until one does not fit; the triangles of each ascend. */
int ENTRY(grow_rings)(const Surface *surface, Rings *rings) {
    Marks marks;
    int64_t total = 0, size;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (rings->done = 0; rings->done < rings->count; rings->done++) {
        int64_t k = rings->done, *own = rings->triangle + total;
        size = grow_ring(surface, &marks, (int32_t)(k + 1), rings->centre[k], rings->radius[k], own, rings->room - total);
        if (size < 0) break;
        qsort(own, (size_t)size, sizeof(int64_t), ascending_numbers);
        rings->size[k] = size;
        total += size;
    }
    free_aligned(marks.memory);
    return DONE;
}

/* Within each of K patches the edges from each vertex to the nearest where `distance`, (M), is 0; it is -1 elsewhere, and
 * stays so where none is reached.  `corners` (S, 3) are numbers of vertices over all patches. */
int ENTRY(hops_in_patches)(int64_t patches, const int64_t *offsets, const int64_t *corners, int64_t *distance) {
    for (int64_t k = 0; k < patches; k++) spread_hops(corners + 3 * offsets[k], offsets[k + 1] - offsets[k], distance);
    return DONE;
}
