/* Rings around centres, which of them are disks (patches/disks.py), and how their nodes are numbered
 * (patches/patches.py): one patch at a time, with marks on the mesh that tell one patch from the other. */
#include "kernel.h"

/* A mesh of N nodes, T triangles and E edges.  solver/native/disks.py has the same fields in the same order. */
typedef struct {
    int64_t nodes, triangles, edges, holes;
    const int64_t *offsets;        /* (N + 1): where the neighbours of each node begin */
    const int32_t *neighbours;
    const int64_t *fan_offsets, *fan_triangles; /* (N + 1): triangles around each node */
    const int64_t *corners;        /* (T, 3): nodes */
    const int64_t *triangle_edges; /* (T, 3) */
    const int64_t *ends;           /* (E, 2): nodes of each edge */
    const int64_t *hole;           /* (E): hole of the mesh that an edge lies on; -1 on most */
    const int64_t *hole_sides;     /* (H): edges around each hole */
    const int64_t *twin;           /* (E): first edge between the same nodes where there are more; else -1 */
} Surface;

/* K sets of triangles: those of patch k stand from offsets[k] to offsets[k + 1], ascending. */
typedef struct {
    int64_t count;
    const int64_t *offsets; /* (K + 1) */
    int64_t *triangles;     /* (S) */
} Members;

/* Marks: a node, triangle or edge was met by the patch whose number, from 1 on, stands there. */
typedef struct {
    int32_t *node, *triangle, *edge, *hole, *twin; /* (N), (T), (E), (H), (E) */
    int32_t *at_node, *at_edge, *at_hole;          /* how often */
    int32_t *queue;                                /* (N) */
    char *memory;
} Marks;

static void lay_out_marks(const Surface *surface, Marks *marks, Arena *arena) {
    size_t nodes = (size_t)surface->nodes, edges = (size_t)surface->edges, holes = (size_t)surface->holes;
    int32_t **all[] = {&marks->node, &marks->triangle, &marks->edge,    &marks->twin, &marks->hole,
                       &marks->at_node, &marks->at_edge, &marks->at_hole, &marks->queue};
    size_t sizes[] = {nodes, (size_t)surface->triangles, edges, edges, holes, nodes, edges, holes, nodes};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) *all[k] = take_integers(arena, sizes[k] + 1);
}

static bool memory_for_marks(const Surface *surface, Marks *marks) {
    Arena arena = {NULL, 0};
    lay_out_marks(surface, marks, &arena);
    size_t bytes = arena.used;
    arena.memory = marks->memory = aligned_memory(bytes);
    if (!arena.memory) return false;
    memset(arena.memory, 0, bytes);
    arena.used = 0;
    lay_out_marks(surface, marks, &arena);
    return true;
}

/* Put the triangles that touch the (radius - 1)-ring of a node into `found`, or only count them where that is NULL. */
static int64_t walk(const Surface *surface, Marks *marks, int32_t patch, int64_t centre, int64_t radius, int64_t *found) {
    int64_t reached = 1, ring = 0, count = 0;
    marks->queue[0] = (int32_t)centre;
    marks->node[centre] = patch;
    for (int64_t step = 1; step < radius; step++) {
        int64_t end = reached;
        for (; ring < end; ring++) {
            int64_t node = marks->queue[ring];
            for (int64_t e = surface->offsets[node]; e < surface->offsets[node + 1]; e++) {
                int32_t next = surface->neighbours[e];
                if (marks->node[next] == patch) continue;
                marks->node[next] = patch;
                marks->queue[reached++] = next;
            }
        }
    }
    for (int64_t k = 0; k < reached; k++) {
        int64_t node = marks->queue[k];
        for (int64_t e = surface->fan_offsets[node]; e < surface->fan_offsets[node + 1]; e++) {
            int64_t triangle = surface->fan_triangles[e];
            if (marks->triangle[triangle] == patch) continue;
            marks->triangle[triangle] = patch;
            if (found) found[count] = triangle;
            count++;
        }
    }
    return count;
}

static int ascending_numbers(const void *one, const void *other) {
    int64_t a = *(const int64_t *)one, b = *(const int64_t *)other;
    return (a > b) - (a < b);
}

/* How many triangles the ring of each of `count` centres has, into `sizes` (count). */
int ENTRY(ring_sizes)(const Surface *surface, const int64_t *centres, int64_t count, int64_t radius, int64_t *sizes) {
    Marks marks;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < count; k++)
        sizes[k] = walk(surface, &marks, (int32_t)(k + 1), centres[k], radius, NULL);
    free_aligned(marks.memory);
    return DONE;
}

/* Those triangles themselves. */
int ENTRY(ring_members)(const Surface *surface, const int64_t *centres, int64_t radius, const Members *members) {
    Marks marks;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < members->count; k++) {
        int64_t *own = members->triangles + members->offsets[k];
        int64_t size = walk(surface, &marks, (int32_t)(k + 1), centres[k], radius, own);
        qsort(own, (size_t)size, sizeof(int64_t), ascending_numbers);
    }
    free_aligned(marks.memory);
    return DONE;
}

/* What a patch consists of. */
typedef struct {
    int64_t nodes, edges, holes, border, in_holes, longest_hole;
    bool pinched, doubled; /* its border touches itself; it has two edges between the same nodes */
} Counts;

static void count_triangle(const Surface *surface, Marks *marks, int32_t patch, int64_t triangle, Counts *counts) {
    for (int k = 0; k < 3; k++) {
        int64_t node = surface->corners[3 * triangle + k], edge = surface->triangle_edges[3 * triangle + k];
        if (marks->node[node] != patch) {
            marks->node[node] = patch;
            marks->at_node[node] = 0;
            counts->nodes++;
        }
        if (marks->edge[edge] == patch) {
            marks->at_edge[edge]++;
            continue;
        }
        marks->edge[edge] = patch;
        marks->at_edge[edge] = 1;
        counts->edges++;
        int64_t twin = surface->twin[edge];
        if (twin < 0) continue;
        counts->doubled = counts->doubled || marks->twin[twin] == patch;
        marks->twin[twin] = patch;
    }
}

static void count_border(const Surface *surface, Marks *marks, int32_t patch, int64_t triangle, Counts *counts) {
    for (int k = 0; k < 3; k++) {
        int64_t edge = surface->triangle_edges[3 * triangle + k], hole = surface->hole[edge];
        if (marks->at_edge[edge] != 1) continue;
        counts->border++;
        for (int end = 0; end < 2; end++)
            counts->pinched = ++marks->at_node[surface->ends[2 * edge + end]] > 2 || counts->pinched;
        if (hole < 0) continue;
        marks->at_hole[hole] = marks->hole[hole] == patch ? marks->at_hole[hole] + 1 : 1;
        marks->hole[hole] = patch;
        if (marks->at_hole[hole] < surface->hole_sides[hole]) continue;
        counts->holes++;
        counts->in_holes += marks->at_hole[hole];
        counts->longest_hole = counts->longest_hole > marks->at_hole[hole] ? counts->longest_hole : marks->at_hole[hole];
    }
}

/* Tell which patches are disks, (K). */
int ENTRY(judge_disks)(const Surface *surface, const Members *members, uint8_t *good) {
    Marks marks;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < members->count; k++) {
        Counts own = {0, 0, 0, 0, 0, 0, false, false};
        int64_t first = members->offsets[k], end = members->offsets[k + 1];
        for (int64_t s = first; s < end; s++)
            count_triangle(surface, &marks, (int32_t)(k + 1), members->triangles[s], &own);
        for (int64_t s = first; s < end; s++)
            count_border(surface, &marks, (int32_t)(k + 1), members->triangles[s], &own);
        /* A loop around a small hole in a flat surface is longer by six for each ring; that of a tube's end is not. */
        int64_t shortest = own.holes > 0 ? 2 * own.longest_hole + 6 : 3;
        bool whole = own.border - own.in_holes >= shortest && !own.pinched && !own.doubled;
        good[k] = whole && own.nodes - own.edges + (end - first) + own.holes == 1;
    }
    free_aligned(marks.memory);
    return DONE;
}

/* Mark the nodes that some patch has with all of their triangles, (N). */
int ENTRY(mark_held)(const Surface *surface, const Members *members, uint8_t *held) {
    Marks marks;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < members->count; k++)
        for (int64_t c = 3 * members->offsets[k]; c < 3 * members->offsets[k + 1]; c++) {
            int64_t node = surface->corners[3 * members->triangles[c / 3] + c % 3];
            marks.at_node[node] = marks.node[node] == (int32_t)(k + 1) ? marks.at_node[node] + 1 : 1;
            marks.node[node] = (int32_t)(k + 1);
            if (marks.at_node[node] == surface->fan_offsets[node + 1] - surface->fan_offsets[node]) held[node] = 1;
        }
    free_aligned(marks.memory);
    return DONE;
}

/* The nodes of patches: how many each has, (K), and one patch after the other, ascending, which they are and how many
 * edges they are from the rim, (M); the triangles' corners as their numbers within the patch, (S, 3). */
typedef struct {
    int64_t *sizes, *nodes, *rim_distance, *corners;
} Numbered;

/* Number the nodes of one patch; returns how many there are. */
static int64_t number_patch(const Surface *surface, Marks *marks, int32_t patch, const int64_t *triangles, int64_t count,
                            int64_t *nodes, int64_t *corners, int64_t *distance) {
    int64_t size = 0;
    for (int64_t c = 0; c < 3 * count; c++) {
        int64_t node = surface->corners[3 * triangles[c / 3] + c % 3];
        if (marks->node[node] != patch) {
            marks->node[node] = patch;
            marks->at_node[node] = 0;
            nodes[size++] = node;
        }
        marks->at_node[node]++;
    }
    qsort(nodes, (size_t)size, sizeof(int64_t), ascending_numbers);
    for (int64_t n = 0; n < size; n++) {
        bool inside = marks->at_node[nodes[n]] >= surface->fan_offsets[nodes[n] + 1] - surface->fan_offsets[nodes[n]];
        distance[n] = inside ? -1 : 0;
        marks->queue[nodes[n]] = (int32_t)n;
    }
    for (int64_t c = 0; c < 3 * count; c++) corners[c] = marks->queue[surface->corners[3 * triangles[c / 3] + c % 3]];
    return size;
}

/* Find the edges from each vertex to the nearest whose distance is 0, where it is -1 now. */
static ONE_COPY void spread_hops(const int64_t *corners, int64_t count, int64_t *distance) {
    bool more = true;
    for (int64_t step = 0; more; step++) {
        more = false;
        for (int64_t c = 0; c < 3 * count; c += 3) {
            int64_t *own[] = {distance + corners[c], distance + corners[c + 1], distance + corners[c + 2]};
            if (*own[0] != step && *own[1] != step && *own[2] != step) continue;
            for (int k = 0; k < 3; k++)
                if (*own[k] < 0) *own[k] = step + 1, more = true;
        }
    }
}

/* Walk inwards from the rim; without a rim all distances are one. */
static void measure_rim_distance(const int64_t *corners, int64_t count, int64_t size, int64_t *distance) {
    spread_hops(corners, count, distance);
    for (int64_t n = 0; n < size; n++)
        if (distance[n] < 0) distance[n] = 1;
}

/* Number the nodes of all patches; the arrays have room for three nodes a triangle. */
int ENTRY(number_nodes)(const Surface *surface, const Members *members, const Numbered *numbered) {
    Marks marks;
    int64_t total = 0;
    if (!memory_for_marks(surface, &marks)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < members->count; k++) {
        int64_t first = members->offsets[k], count = members->offsets[k + 1] - first;
        int64_t *corners = numbered->corners + 3 * first, *distance = numbered->rim_distance + total;
        int64_t size = number_patch(surface, &marks, (int32_t)(k + 1), members->triangles + first, count,
                                    numbered->nodes + total, corners, distance);
        measure_rim_distance(corners, count, size, distance);
        numbered->sizes[k] = size;
        total += size;
    }
    free_aligned(marks.memory);
    return DONE;
}
