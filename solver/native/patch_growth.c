/* One-sided patches that grow ring after ring as far as normals agree (denoising/patch_growth.py): the same triangles in
 * the same order. */
#include "kernel.h"

/* P patches on a mesh of T triangles and V vertices.  solver/native/patch_growth.py has the same fields in the same
 * order. */
typedef struct {
    int64_t patches, room; /* P, M: triangles that there is room for in each */
    double least_cosine;   /* of the angle between the normal of a triangle that joins and the seed's */
    const int64_t *corners, *neighbours; /* (T, 3): vertices, and the triangle that may join across each side or -1 */
    const double *normals;               /* (T, 3) */
    int64_t *members;                    /* (P, M): from the seed outwards, then those that wait */
    int64_t *sizes;                      /* (P): triangles of each patch, ... */
    int64_t *outermost, *waiting;        /* (P): ... those of its last ring, and of the next one if that did not fit */
    int32_t *triangle_mark, *vertex_mark; /* (T), (V): zero between two calls */
} PatchGrowth;

enum { TAKEN = -1 };

/* Put the free triangles beside the last ring behind the members, and take them; returns how many there are.  One that is
 * met from several sides stands where it is met last. */
static int64_t take_next_ring(const PatchGrowth *own, int64_t *members, int64_t size, int64_t outermost) {
    const double *upright = own->normals + 3 * members[0];
    int64_t *ring = members + size, met = 0, taken = 0;
    for (int64_t side = 3 * (size - outermost); side < 3 * size; side++) {
        int64_t next = own->neighbours[3 * members[side / 3] + side % 3];
        if (next < 0 || own->triangle_mark[next] == TAKEN) continue;
        const double *normal = own->normals + 3 * next;
        double cosine = upright[0] * normal[0] + upright[1] * normal[1] + upright[2] * normal[2];
        if (!(cosine > own->least_cosine)) continue;
        ring[met++] = next;
        own->triangle_mark[next] = (int32_t)met;
    }
    for (int64_t k = 0; k < met; k++) {
        if (own->triangle_mark[ring[k]] != (int32_t)(k + 1)) continue;
        own->triangle_mark[ring[k]] = TAKEN;
        ring[taken++] = ring[k];
    }
    return taken;
}

/* Let a patch grow by at most `most` rings to at most `limit` triangles; returns how many rings there were, the one that
 * did not fit included. */
static int64_t grow_patch(const PatchGrowth *own, int64_t patch, int64_t limit, int64_t most) {
    int64_t *members = own->members + patch * own->room, rings = 0;
    int64_t size = own->sizes[patch], outermost = own->outermost[patch], waiting = own->waiting[patch];
    for (int64_t k = 0; k < size + waiting; k++) own->triangle_mark[members[k]] = TAKEN;
    while (rings < most) {
        if (!waiting) waiting = take_next_ring(own, members, size, outermost);
        if (!waiting) break;
        rings++;
        if (size + waiting > limit) break;
        size += waiting;
        outermost = waiting;
        waiting = 0;
    }
    for (int64_t k = 0; k < size + waiting; k++) own->triangle_mark[members[k]] = 0;
    own->sizes[patch] = size, own->outermost[patch] = outermost, own->waiting[patch] = waiting;
    return rings;
}

/* Let the patches that are `wanted`, (P), grow; returns the number of rings of the one that had most. */
int64_t ENTRY(grow_patches)(const PatchGrowth *own, const uint8_t *wanted, int64_t limit, int64_t most) {
    int64_t rings = 0;
    for (int64_t patch = 0; patch < own->patches; patch++) {
        int64_t these = wanted[patch] ? grow_patch(own, patch, limit, most) : 0;
        rings = these > rings ? these : rings;
    }
    return rings;
}

/* The vertices of some triangles in the order in which they are met last, and the corners' numbers among them; returns
 * how many there are. */
static int64_t number_vertices(const PatchGrowth *own, const int64_t *members, int64_t size, int64_t *vertices,
                               int64_t *numbers) {
    int64_t count = 0;
    for (int64_t c = 0; c < 3 * size; c++) {
        numbers[c] = own->corners[3 * members[c / 3] + c % 3];
        own->vertex_mark[numbers[c]] = (int32_t)(c + 1);
    }
    for (int64_t c = 0; c < 3 * size; c++) {
        if (own->vertex_mark[numbers[c]] != (int32_t)(c + 1)) continue;
        vertices[count] = numbers[c];
        own->vertex_mark[numbers[c]] = (int32_t)(-1 - count++);
    }
    for (int64_t c = 0; c < 3 * size; c++) numbers[c] = -1 - own->vertex_mark[numbers[c]];
    for (int64_t n = 0; n < count; n++) own->vertex_mark[vertices[n]] = 0;
    return count;
}

/* List Q of the patches, `which`, in rows as long as the longest, L, which it returns: their triangles, (Q, K) with the K
 * given, and vertices, (Q, L), -1 where a row is longer than its patch, and where in these, flattened, each triangle
 * corner stands.  `vertices` has room for (Q, 3 K). */
int64_t ENTRY(list_patches)(const PatchGrowth *own, const int64_t *which, int64_t count, int64_t width, int64_t *triangles,
                            int64_t *vertices, int64_t *places) {
    int64_t longest = 0, *rest = places;
    for (int64_t q = 0; q < count; q++) {
        const int64_t *members = own->members + which[q] * own->room, size = own->sizes[which[q]];
        for (int64_t k = 0; k < width; k++) triangles[q * width + k] = k < size ? members[k] : -1;
        int64_t *row = vertices + 3 * q * width, found = number_vertices(own, members, size, row, rest);
        if (found < 3 * width) row[found] = -1;
        longest = found > longest ? found : longest;
        rest += 3 * size;
    }
    for (int64_t q = 0; q < count; q++) {
        int64_t *row = vertices + q * longest, *from = vertices + 3 * q * width, size = own->sizes[which[q]], n = 0;
        for (; n < longest && from[n] >= 0; n++) row[n] = from[n];
        for (; n < longest; n++) row[n] = -1;
        for (int64_t c = 0; c < 3 * size; c++) *places++ += q * longest;
    }
    return longest;
}
