/* Disks that grow node by node where a ring closes around something thin (patches/strips.py). */
#include "kernel.h"

/* One disk while it grows, and what is left of the mesh for it.  All numbers are zero between disks. */
typedef struct {
    const Surface *surface;
    int32_t *at_node, *at_edge, *at_twin; /* (N), (E), (E): how many of its triangles are there */
    int32_t *seen, *inside;               /* (N), (T): whether the walk met it; whether the disk has it */
    int32_t *front, *next;                /* (N) both: nodes to go on from, and those beside them */
    int64_t *found;                       /* its triangles */
    int64_t count;
    char *memory;
} Growth;

static void lay_out_growth(const Surface *surface, Growth *growth, Arena *arena) {
    size_t nodes = (size_t)surface->nodes, edges = (size_t)surface->edges;
    growth->at_node = take_integers(arena, nodes + 1);
    growth->seen = take_integers(arena, nodes + 1);
    growth->front = take_integers(arena, nodes + 1);
    growth->next = take_integers(arena, nodes + 1);
    growth->at_edge = take_integers(arena, edges + 1);
    growth->at_twin = take_integers(arena, edges + 1);
    growth->inside = take_integers(arena, (size_t)surface->triangles + 1);
}

static bool memory_for_growth(const Surface *surface, Growth *growth) {
    Arena arena = {NULL, 0};
    growth->surface = surface;
    lay_out_growth(surface, growth, &arena);
    size_t bytes = arena.used;
    arena.memory = growth->memory = aligned_memory(bytes);
    if (!arena.memory) return false;
    memset(arena.memory, 0, bytes);
    arena.used = 0;
    lay_out_growth(surface, growth, &arena);
    return true;
}

/* Add a triangle to the disk, or with -1 take it away. */
static void change_disk(Growth *growth, int64_t triangle, int32_t by) {
    for (int k = 0; k < 3; k++) {
        int64_t edge = growth->surface->triangle_edges[3 * triangle + k], twin = growth->surface->twin[edge];
        growth->at_node[growth->surface->corners[3 * triangle + k]] += by;
        growth->at_edge[edge] += by;
        if (twin >= 0) growth->at_twin[twin] += by;
    }
    growth->inside[triangle] = by > 0;
    growth->count += by;
}

/* Whether the disk with one more triangle is a disk: it joins at one edge, opposite to a new node, or at two. */
static bool fits_disk(const Growth *growth, int64_t triangle) {
    const int64_t *edges = growth->surface->triangle_edges + 3 * triangle;
    int joined = 0, one = 0, open = 0;
    for (int k = 0; k < 3; k++) {
        if (growth->at_edge[edges[k]]) joined++, one = k;
        else open = k;
    }
    if (joined == 1) return !growth->at_node[growth->surface->corners[3 * triangle + (one + 2) % 3]];
    int64_t twin = growth->surface->twin[edges[open]];
    return joined == 2 && (twin < 0 || !growth->at_twin[twin]);
}

/* Take in all triangles around a node, or none; a disk of more than `most` takes none. */
static bool hold_node(Growth *growth, int64_t node, int64_t most) {
    const int64_t *fan = growth->surface->fan_triangles + growth->surface->fan_offsets[node];
    int64_t size = growth->surface->fan_offsets[node + 1] - growth->surface->fan_offsets[node];
    int64_t before = growth->count, missing = 0;
    for (int64_t k = 0; k < size; k++) missing += !growth->inside[fan[k]];
    if (!missing) return true;
    if (before && before + missing > most) return false;
    for (bool more = true; more;) {
        more = false;
        for (int64_t k = 0; k < size; k++) {
            if (growth->inside[fan[k]] || (growth->count && !fits_disk(growth, fan[k]))) continue;
            growth->found[growth->count] = fan[k];
            change_disk(growth, fan[k], 1);
            more = true;
        }
    }
    if (growth->count == before + missing) return true;
    while (growth->count > before) change_disk(growth, growth->found[growth->count - 1], -1);
    return false;
}

/* Put the neighbours of `from` nodes of the front that were not met before into `next`; returns how many. */
static int64_t step_outwards(Growth *growth, int64_t from) {
    int64_t count = 0;
    for (int64_t k = 0; k < from; k++)
        for (int64_t e = growth->surface->offsets[growth->front[k]]; e < growth->surface->offsets[growth->front[k] + 1]; e++) {
            int32_t node = growth->surface->neighbours[e];
            if (growth->seen[node]) continue;
            growth->seen[node] = 1;
            growth->next[count++] = node;
        }
    return count;
}

/* Grow a disk around a node; returns its radius in edges, 0 where there is none. */
static int64_t grow_disk(Growth *growth, int64_t centre, int64_t radius, int64_t most, const uint8_t *wanted) {
    int64_t held = 1, reached = 1;
    growth->count = 0;
    if (!hold_node(growth, centre, most)) return 0;
    growth->front[0] = (int32_t)centre;
    growth->seen[centre] = 1;
    for (int64_t step = 2; step <= radius && held; step++) {
        int64_t met = step_outwards(growth, held);
        held = 0;
        for (int turn = 1; turn >= 0; turn--)
            for (int64_t k = 0; k < met; k++)
                if ((wanted[growth->next[k]] != 0) == turn && hold_node(growth, growth->next[k], most))
                    growth->front[held++] = growth->next[k];
        if (held) reached = step;
    }
    return reached;
}

/* Forget a disk; whatever was met lies on one of its triangles. */
static void clear_disk(Growth *growth, int64_t centre) {
    growth->seen[centre] = 0;
    for (int64_t k = growth->count; k-- > 0;) {
        for (int corner = 0; corner < 3; corner++)
            growth->seen[growth->surface->corners[3 * growth->found[k] + corner]] = 0;
        change_disk(growth, growth->found[k], -1);
    }
}

/* Grow disks of up to `radius` around centres, (K), of at most `most` triangles each, (K), at first over nodes that are
 * `wanted`, (N).  Their triangles begin at `members->offsets`, which leave room for whole rings; their numbers go to
 * `sizes`, their radii to `radii`, (K). */
int ENTRY(grow_disks)(const Surface *surface, const int64_t *centres, int64_t radius, const int64_t *most,
                      const uint8_t *wanted, const Members *members, int64_t *sizes, int64_t *radii) {
    Growth growth;
    if (!memory_for_growth(surface, &growth)) return OUT_OF_MEMORY;
    for (int64_t k = 0; k < members->count; k++) {
        growth.found = members->triangles + members->offsets[k];
        radii[k] = grow_disk(&growth, centres[k], radius, most[k], wanted);
        sizes[k] = growth.count;
        qsort(growth.found, (size_t)growth.count, sizeof(int64_t), ascending_numbers);
        clear_disk(&growth, centres[k]);
    }
    free_aligned(growth.memory);
    return DONE;
}
