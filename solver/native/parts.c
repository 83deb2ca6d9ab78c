/* The connected parts of a graph (mesh/edges.py), by joining trees of nodes whose roots are their lowest ones. */
#include "kernel.h"

static int64_t root_of(int64_t *parent, int64_t node) {
    while (parent[node] != node) {
        parent[node] = parent[parent[node]];
        node = parent[node];
    }
    return node;
}

/* Number the parts that the edges from `one` to `other` leave of `count` nodes by their lowest node: `part` (count);
 * returns how many there are. */
int64_t ENTRY(connected_parts)(const int64_t *one, const int64_t *other, int64_t edges, int64_t count, int64_t *part) {
    int64_t parts = 0;
    for (int64_t node = 0; node < count; node++) part[node] = node;
    for (int64_t e = 0; e < edges; e++) {
        int64_t a = root_of(part, one[e]), b = root_of(part, other[e]);
        if (a < b)
            part[b] = a;
        else
            part[a] = b;
    }
    /* A root comes before the nodes of its tree, and every node's parent before itself. */
    for (int64_t node = 0; node < count; node++) part[node] = part[node] == node ? parts++ : part[part[node]];
    return parts;
}
