/* Triangles from a walk over a mesh (surface/format/walk.py, which says what fronts, places, gaps and chords are). */
#include "kernel.h"

enum { GONE = -1 };

/* What a file says of a walk over n vertices, and what comes of it.  solver/native/stored.py has the same fields in the
 * same order. */
typedef struct {
    int64_t vertices, gap_count, chords; /* n, and the lengths of `gap` and `chord` */
    int64_t *left;                       /* (n): triangles of each vertex, less the three of a vertex between two fans */
    const uint8_t *fork;                 /* (n): whether chords begin there */
    const int64_t *gap, *chord;
    int64_t *fan; /* (most_fans, 5): centre, before, behind, number of new vertices, the first of them */
    int64_t most_fans, fans, met;
} StoredWalk;

/* Cycles of places.  A vertex's first place has its number; more of them are listed in the order of their making. */
typedef struct {
    int64_t places;
    int64_t *after, *before, *vertex, *next; /* of each place */
    int64_t *more, *last;                    /* of each vertex: the first and the last of its further places, or GONE */
    int64_t *waiting;
} Front;

static void join_places(Front *front, int64_t one, int64_t two) {
    if (one == two) {
        front->after[one] = GONE;
        return;
    }
    front->after[one] = front->after[two];
    front->before[front->after[two]] = one;
    front->after[two] = GONE;
}

/* Link two places, and close up what is empty: a place between two places of one vertex. */
static void close_gap(Front *front, int64_t before, int64_t behind) {
    front->after[before] = behind;
    front->before[behind] = before;
    for (int side = 0; side < 2; side++) {
        int64_t place = side ? behind : before;
        while (front->after[place] != GONE) {
            int64_t one = front->before[place], two = front->after[place];
            if (front->vertex[one] != front->vertex[two]) break;
            front->after[place] = GONE;
            join_places(front, one, two);
            place = one;
        }
    }
}

/* Draw a chord between two places, and return the new place at `start`, whose gap is the first. */
static int64_t cut_front(Front *front, int64_t start, int64_t end) {
    int64_t first = front->places++, second = front->places++;
    front->vertex[first] = front->vertex[start];
    front->vertex[second] = front->vertex[end];
    front->before[first] = front->before[start];
    front->after[first] = second;
    front->before[second] = first;
    front->after[second] = front->after[end];
    front->after[front->before[start]] = first;
    front->before[front->after[end]] = second;
    front->before[start] = end;
    front->after[end] = start;
    for (int64_t place = first; place <= second; place++) {
        int64_t vertex = front->vertex[place];
        front->next[place] = GONE;
        if (front->more[vertex] == GONE)
            front->more[vertex] = place;
        else
            front->next[front->last[vertex]] = place;
        front->last[vertex] = place;
    }
    return first;
}

/* Fill the gap at a place with a fan that has some new vertices. */
static int32_t fill_gap(StoredWalk *walk, Front *front, int64_t place, int64_t new) {
    int64_t first = walk->met, before = front->before[place], behind = front->after[place];
    if (new < 0 || new > walk->vertices - first || walk->fans == walk->most_fans) return CUT_SHORT;
    int64_t fan[] = {front->vertex[place], front->vertex[before], front->vertex[behind], new, first};
    memcpy(walk->fan + 5 * walk->fans++, fan, sizeof fan);
    walk->left[fan[1]]--;
    walk->left[fan[2]]--;
    walk->met += new;
    front->after[place] = GONE;
    if (!new) {
        close_gap(front, before, behind);
        return DONE;
    }
    front->after[before] = first;
    front->before[first] = before;
    front->after[walk->met - 1] = behind;
    front->before[behind] = walk->met - 1;
    return DONE;
}

/* Fill the gaps of a vertex at which chords begin, or which has several places. */
static int32_t fill_each(StoredWalk *walk, Front *front, int64_t centre, int64_t *gaps, int64_t *chords) {
    int64_t *waiting = front->waiting, count = 0;
    for (int64_t place = front->more[centre]; place != GONE; place = front->next[place])
        if (front->after[place] != GONE) waiting[count++] = place;
    if (front->after[centre] != GONE) waiting[count++] = centre;
    if (count == 1 && !walk->fork[centre]) return fill_gap(walk, front, waiting[0], walk->left[centre]);
    while (count) {
        int64_t place = waiting[--count];
        if (front->after[place] == GONE) continue;
        if (*gaps == walk->gap_count || walk->gap[*gaps] < 0) return CUT_SHORT;
        int64_t new = walk->gap[(*gaps)++] - 1;
        if (new >= 0) {
            if (fill_gap(walk, front, place, new)) return CUT_SHORT;
            continue;
        }
        if (*chords == walk->chords) return CUT_SHORT;
        uint64_t end = (uint64_t)place - (uint64_t)walk->chord[(*chords)++];
        /* it ends at a place that a front has reached */
        bool there = end < (uint64_t)walk->met || (end >= (uint64_t)walk->vertices && end < (uint64_t)front->places);
        if (!there || end == (uint64_t)place || front->after[end] == GONE) return CUT_SHORT;
        waiting[count++] = place;
        waiting[count++] = cut_front(front, place, (int64_t)end);
    }
    return DONE;
}

/* Begin a closed part of the mesh with a triangle. */
static int32_t begin_part(StoredWalk *walk, Front *front) {
    int64_t first = walk->met;
    if (first + 3 > walk->vertices || walk->fans == walk->most_fans) return CUT_SHORT;
    int64_t fan[] = {first, first + 1, first + 2, 0, first};
    memcpy(walk->fan + 5 * walk->fans++, fan, sizeof fan);
    front->before[first] = first + 2;
    front->after[first + 2] = first;
    for (int64_t corner = first; corner < first + 3; corner++) walk->left[corner]++;
    walk->met += 3;
    return DONE;
}

static int32_t fill_fronts(StoredWalk *walk, Front *front) {
    int64_t gaps = 0, chords = 0;
    for (int64_t centre = 0; centre < walk->vertices; centre++) {
        if (centre == walk->met && begin_part(walk, front)) return CUT_SHORT;
        int32_t status = DONE;
        if (front->more[centre] != GONE || walk->fork[centre])
            status = fill_each(walk, front, centre, &gaps, &chords);
        else if (front->after[centre] != GONE)
            status = fill_gap(walk, front, centre, walk->left[centre]);
        if (status) return status;
    }
    return DONE;
}

/* Follow a walk, and note its fans. */
int32_t ENTRY(fans_of_walk)(StoredWalk *walk) {
    size_t vertices = (size_t)walk->vertices, places = vertices + 2 * (size_t)walk->chords;
    int64_t *memory = malloc((5 * places + 2 * vertices + (size_t)walk->chords + 1) * sizeof *memory);
    if (!memory) return OUT_OF_MEMORY;
    Front front = {.places = walk->vertices, .after = memory, .before = memory + places, .vertex = memory + 2 * places};
    front.next = memory + 3 * places;
    front.more = memory + 4 * places;
    front.last = front.more + vertices;
    front.waiting = front.last + vertices;
    for (int64_t place = 0; place < walk->vertices; place++) {
        /* new vertices follow each other, so most places are linked before they are met */
        front.after[place] = place + 1;
        front.before[place] = place - 1;
        front.vertex[place] = place;
        front.more[place] = GONE;
    }
    walk->fans = walk->met = 0;
    int32_t status = fill_fronts(walk, &front);
    free(memory);
    return status;
}
