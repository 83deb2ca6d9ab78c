/* Covers by farthest-point sampling in edge hops (patches/cover.py): the same centres in the same order. */
#include "kernel.h"

enum { FAR = INT32_MAX };

/* N nodes; the neighbours of node n stand from offsets[n] to offsets[n + 1]. */
typedef struct {
    int64_t nodes;
    const int64_t *offsets;  /* (N + 1) */
    const int32_t *neighbours;
} Graph;

/* Nodes that are to be covered, in a linked list for each distance: the farthest are found without looking at all. */
typedef struct {
    int32_t *distance;        /* (N): hops to the nearest centre */
    int32_t *listed;          /* (N): list that a node is in; -1 where it need not be covered */
    int32_t *next, *previous; /* (N): -1 at the ends */
    int32_t *first;           /* (N + 1): of each list; those that no path leads to are in the last */
} Lists;

static void take_out(Lists *lists, int32_t node) {
    int32_t after = lists->next[node], before = lists->previous[node];
    if (before >= 0)
        lists->next[before] = after;
    else
        lists->first[lists->listed[node]] = after;
    if (after >= 0) lists->previous[after] = before;
}

static void put_in(Lists *lists, int32_t node, int32_t list) {
    int32_t after = lists->first[list];
    lists->listed[node] = list;
    lists->next[node] = after;
    lists->previous[node] = -1;
    if (after >= 0) lists->previous[after] = node;
    lists->first[list] = node;
}

/* Lower the distances to the hops from some nodes; returns how many nodes were reached, which `queue` (N) names. */
static int64_t lower(const Graph *graph, int32_t *distance, const int32_t *from, int64_t count, int32_t *queue) {
    int64_t reached = 0;
    for (int64_t k = 0; k < count; k++) {
        if (distance[from[k]] == 0) continue;
        distance[from[k]] = 0;
        queue[reached++] = from[k];
    }
    for (int64_t k = 0; k < reached; k++) {
        int32_t step = distance[queue[k]] + 1;
        for (int64_t e = graph->offsets[queue[k]]; e < graph->offsets[queue[k] + 1]; e++) {
            int32_t node = graph->neighbours[e];
            if (distance[node] <= step) continue;
            distance[node] = step;
            queue[reached++] = node;
        }
    }
    return reached;
}

static int ascending(const void *one, const void *other) {
    int32_t a = *(const int32_t *)one, b = *(const int32_t *)other;
    return (a > b) - (a < b);
}

/* Memory of `mutually_distant`: the highest rank that has reached each node, and two fronts of such nodes. */
typedef struct {
    int32_t *highest, *seen, *front, *values, *after; /* (N) */
} Ranks;

/* Keep those of the candidates that outrank every other one within less than `hops` edges. */
static int64_t mutually_distant(const Graph *graph, Ranks *own, const int32_t *rank, int32_t hops, int32_t *candidates,
                                int64_t count) {
    memset(own->highest, 0xff, sizeof(int32_t) * (size_t)graph->nodes);
    memset(own->seen, 0, sizeof(int32_t) * (size_t)graph->nodes);
    int64_t size = count, kept = 0;
    for (int64_t k = 0; k < count; k++) {
        own->highest[candidates[k]] = rank[candidates[k]];
        own->front[k] = candidates[k];
    }
    for (int32_t step = 1; step < hops && size; step++) {
        int64_t more = 0;
        for (int64_t k = 0; k < size; k++) own->values[k] = own->highest[own->front[k]];
        for (int64_t k = 0; k < size; k++)
            for (int64_t e = graph->offsets[own->front[k]]; e < graph->offsets[own->front[k] + 1]; e++) {
                int32_t node = graph->neighbours[e];
                if (own->highest[node] >= own->values[k]) continue;
                own->highest[node] = own->values[k];
                if (own->seen[node] != step) own->after[more++] = node;
                own->seen[node] = step;
            }
        int32_t *front = own->front;
        own->front = own->after;
        own->after = front;
        size = more;
    }
    for (int64_t k = 0; k < count; k++)
        if (own->highest[candidates[k]] == rank[candidates[k]]) candidates[kept++] = candidates[k];
    return kept;
}

/* The farthest nodes that are to be next centres, ascending. */
static int64_t next_centres(const Graph *graph, const Lists *lists, Ranks *ranks, const int32_t *rank, int32_t farthest,
                            int32_t alone, int32_t *centres) {
    int64_t count = 0;
    for (int32_t node = lists->first[farthest]; node >= 0; node = lists->next[node]) centres[count++] = node;
    if (farthest > alone) {
        for (int64_t k = 1; k < count; k++)
            if (rank[centres[k]] > rank[centres[0]]) centres[0] = centres[k];
        return 1;
    }
    qsort(centres, (size_t)count, sizeof(int32_t), ascending);
    return count == 1 ? 1 : mutually_distant(graph, ranks, rank, farthest, centres, count);
}

/* Go on from the first `count` centres until no node is `ring` hops away; returns how many there are then. */
static int64_t choose(const Graph *graph, Lists *lists, Ranks *ranks, const int32_t *rank, int32_t ring, int32_t alone,
                      int32_t *centres, int64_t count, int32_t *queue) {
    int64_t fresh = count, total = 0;
    for (int32_t farthest = (int32_t)graph->nodes;;) {
        int64_t reached = lower(graph, lists->distance, centres + total, fresh, queue);
        total += fresh;
        for (int64_t k = 0; k < reached; k++) {
            int32_t node = queue[k];
            if (lists->listed[node] < 0) continue;
            take_out(lists, node);
            put_in(lists, node, lists->distance[node]);
        }
        while (farthest >= ring && lists->first[farthest] < 0) farthest--;
        if (farthest < ring) return total;
        fresh = next_centres(graph, lists, ranks, rank, farthest, alone, centres + total);
    }
}

static size_t lay_out_cover(int64_t nodes, Lists *lists, Ranks *ranks, int32_t **queue, Arena *arena) {
    int count = (int)nodes;
    int32_t **all[] = {&lists->distance, &lists->listed, &lists->next,   &lists->previous, &ranks->highest,
                       &ranks->seen,     &ranks->front,  &ranks->values, &ranks->after,    queue};
    for (size_t k = 0; k < sizeof(all) / sizeof(all[0]); k++) *all[k] = take_integers(arena, count);
    lists->first = take_integers(arena, count + 1);
    return arena->used;
}

/* Choose centres; `centres` (N) begins with the first `count`.  Nodes are `wanted`, (N), or need not be covered; `rank`
 * (N) breaks ties; beyond `alone` hops centres are placed one at a time.  `total` says how many there are. */
int ENTRY(farthest_points)(const Graph *graph, const uint8_t *wanted, const int32_t *rank, int64_t ring, int64_t alone,
                           int32_t *centres, int64_t count, int64_t *total) {
    Lists lists;
    Ranks ranks;
    int32_t *queue;
    Arena arena = {NULL, 0};
    size_t bytes = lay_out_cover(graph->nodes, &lists, &ranks, &queue, &arena);
    arena.memory = aligned_memory(bytes);
    if (!arena.memory) return OUT_OF_MEMORY;
    arena.used = 0;
    lay_out_cover(graph->nodes, &lists, &ranks, &queue, &arena);
    memset(lists.first, 0xff, sizeof(int32_t) * (size_t)(graph->nodes + 1));
    for (int32_t node = 0; node < graph->nodes; node++) {
        lists.distance[node] = FAR;
        lists.listed[node] = -1;
        if (wanted[node]) put_in(&lists, node, (int32_t)graph->nodes);
    }
    *total = choose(graph, &lists, &ranks, rank, (int32_t)ring, (int32_t)alone, centres, count, queue);
    free_aligned(arena.memory);
    return DONE;
}

/* Hops (N) from some nodes; FAR where there is no path. */
int ENTRY(hops_from)(const Graph *graph, const int32_t *from, int64_t count, int32_t *hops) {
    int32_t *queue = malloc(sizeof(int32_t) * (size_t)(graph->nodes + 1));
    if (!queue) return OUT_OF_MEMORY;
    for (int64_t node = 0; node < graph->nodes; node++) hops[node] = FAR;
    lower(graph, hops, from, count, queue);
    free(queue);
    return DONE;
}
