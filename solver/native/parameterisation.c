/* Least squares conformal maps of patches (patches/parameterisation.py): Dirichlet's energy less the area of the map,
 * a Hermitian form in half the unknowns, factorised by Cholesky within the envelope of its rows.
 */
#include "kernel.h"

#define MOST_PRODUCTS 3e7 /* of one factorisation: beyond that NumPy's general sparse one is faster */

/* One patch: m vertices, t triangles. */
typedef struct {
    int64_t vertices, triangle_count;
    const double *positions;  /* (m, 3) */
    const int64_t *triangles; /* (t, 3) */
    const double *lengths;    /* (t, 3): of the sides opposite to each corner */
    const double *areas;      /* (t) */
} Disk;

/* The form: neighbours of vertex v stand from first[v] to end[v]. */
typedef struct {
    int32_t *first, *end, *neighbour;
    double *weight, *turn; /* off the diagonal it is turn i - weight; no turn inside the patch */
    double *diagonal;      /* (m) */
    int32_t *following;    /* (m): along the border; -1 inside */
    int32_t *order, *place; /* unknowns in the order of elimination, and where each vertex stands there */
    int32_t *loop, *seen;  /* (m) */
} Form;

/* Rows of the factor between their first entry and the diagonal: real and imaginary parts. */
typedef struct {
    int64_t *row;            /* (n + 1): where rows begin */
    double *real, *imaginary;
    double *right_real, *right_imaginary; /* (n) */
} Envelope;

static size_t lay_out_form(const Disk *disk, Form *form, Envelope *own, Arena *arena) {
    size_t size = (size_t)disk->vertices + 1, sides = 6 * (size_t)disk->triangle_count;
    int32_t **integers[] = {&form->first, &form->end,  &form->following, &form->order,
                            &form->place, &form->loop, &form->seen};
    for (size_t k = 0; k < sizeof(integers) / sizeof(integers[0]); k++) *integers[k] = take_integers(arena, size);
    form->neighbour = take_integers(arena, sides);
    form->weight = take_doubles(arena, sides);
    form->turn = take_doubles(arena, sides);
    form->diagonal = take_doubles(arena, size);
    own->row = take(arena, size, sizeof(int64_t));
    own->right_real = take_doubles(arena, size);
    own->right_imaginary = take_doubles(arena, size);
    return arena->used;
}

static void join(Form *form, int32_t one, int32_t other, double weight, double turn) {
    int32_t at = form->first[one];
    while (at < form->end[one] && form->neighbour[at] != other) at++;
    if (at == form->end[one]) {
        form->end[one]++;
        form->neighbour[at] = other;
        form->weight[at] = form->turn[at] = 0.0;
    }
    form->weight[at] += weight;
    form->turn[at] += turn;
}

static void assemble_form(const Disk *disk, Form *form) {
    int64_t size = disk->vertices;
    memset(form->first, 0, sizeof(int32_t) * (size_t)(size + 1));
    for (int64_t k = 0; k < 3 * disk->triangle_count; k++) form->first[disk->triangles[k] + 1] += 2;
    for (int64_t v = 0; v < size; v++) {
        form->first[v + 1] += form->first[v];
        form->end[v] = form->first[v];
        form->diagonal[v] = 0.0;
    }
    for (int64_t t = 0; t < disk->triangle_count; t++) {
        const double *length = disk->lengths + 3 * t;
        double squares = length[0] * length[0] + length[1] * length[1] + length[2] * length[2];
        for (int k = 0; k < 3; k++) {
            int32_t one = (int32_t)disk->triangles[3 * t + (k + 1) % 3];
            int32_t other = (int32_t)disk->triangles[3 * t + (k + 2) % 3];
            double weight = 0.5 * (squares - 2.0 * length[k] * length[k]) / (4.0 * disk->areas[t]);
            join(form, one, other, weight, 0.5);
            join(form, other, one, weight, -0.5);
            form->diagonal[one] += weight;
            form->diagonal[other] += weight;
        }
    }
}

/* The longest border, from its lowest vertex on: its number of vertices; 0 where borders meet each other. */
static int64_t outer_border(const Disk *disk, Form *form) {
    int64_t longest = 0, start = -1;
    for (int64_t v = 0; v < disk->vertices; v++) {
        form->following[v] = -1;
        form->seen[v] = 0;
        for (int32_t at = form->first[v]; at < form->end[v]; at++)
            if (form->turn[at] > 0.0) form->following[v] = form->neighbour[at];
    }
    for (int32_t v = 0; v < disk->vertices; v++) {
        int64_t count = 0;
        int32_t at = v;
        if (form->following[v] < 0) continue;
        for (; at >= 0 && !form->seen[at]; at = form->following[at], count++) form->seen[at] = 1;
        if (count && at != v) return 0;
        if (count > longest) longest = count, start = v;
    }
    for (int64_t k = 0; k < longest; k++, start = form->following[start]) form->loop[k] = (int32_t)start;
    return longest;
}

static double apart(const Disk *disk, int32_t one, int32_t other) {
    const double *a = disk->positions + 3 * one, *b = disk->positions + 3 * other;
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

static int32_t farthest_from(const Disk *disk, const Form *form, int64_t count, int32_t vertex) {
    int32_t farthest = form->loop[0];
    double most = -1.0;
    for (int64_t k = 0; k < count; k++) {
        double distance = apart(disk, form->loop[k], vertex);
        if (distance > most) most = distance, farthest = form->loop[k];
    }
    return farthest;
}

/* Number the vertices by breadth from `start` on, backwards, all but two; returns how many, or -1 where some cannot be
 * reached. */
static int64_t order_unknowns(const Disk *disk, Form *form, int32_t start, int32_t other) {
    int64_t size = disk->vertices, reached = 0, unknowns = 0;
    int32_t *queue = form->loop;
    for (int64_t v = 0; v < size; v++) form->seen[v] = 0;
    queue[reached++] = start;
    form->seen[start] = 1;
    for (int64_t k = 0; k < reached; k++)
        for (int32_t at = form->first[queue[k]]; at < form->end[queue[k]]; at++) {
            int32_t vertex = form->neighbour[at];
            if (!form->seen[vertex]) queue[reached++] = vertex;
            form->seen[vertex] = 1;
        }
    for (int64_t k = reached - 1; k >= 0; k--) {
        int32_t vertex = queue[k];
        bool held = vertex == start || vertex == other;
        form->place[vertex] = held ? -1 : (int32_t)unknowns;
        if (!held) form->order[unknowns++] = vertex;
    }
    return reached == size ? unknowns : -1;
}

/* Where the rows begin: each from its first entry to the diagonal.  Returns how many products a factorisation takes. */
static double shape_of(const Form *form, int64_t unknowns, Envelope *own) {
    double products = 0.0;
    own->row[0] = 0;
    for (int64_t i = 0; i < unknowns; i++) {
        int32_t vertex = form->order[i];
        int64_t first = i;
        for (int32_t at = form->first[vertex]; at < form->end[vertex]; at++) {
            int32_t place = form->place[form->neighbour[at]];
            if (place >= 0 && place < first) first = place;
        }
        own->row[i + 1] = own->row[i] + i - first + 1;
        products += (double)(i - first) * (double)(i - first);
    }
    return products;
}

/* Fill in the rows, and the right side: the vertex `held` lies at `value`, the other held one at zero. */
static void fill_in(const Form *form, int64_t unknowns, int32_t held, double value, Envelope *own) {
    memset(own->real, 0, sizeof(double) * (size_t)own->row[unknowns]);
    memset(own->imaginary, 0, sizeof(double) * (size_t)own->row[unknowns]);
    for (int64_t i = 0; i < unknowns; i++) {
        int32_t vertex = form->order[i];
        int64_t diagonal = own->row[i + 1] - 1;
        own->real[diagonal] = form->diagonal[vertex];
        own->right_real[i] = own->right_imaginary[i] = 0.0;
        for (int32_t at = form->first[vertex]; at < form->end[vertex]; at++) {
            int32_t other = form->neighbour[at], place = form->place[other];
            if (other == held) {
                own->right_real[i] = form->weight[at] * value;
                own->right_imaginary[i] = -form->turn[at] * value;
            } else if (place >= 0 && place < i) {
                own->real[diagonal - i + place] = -form->weight[at];
                own->imaginary[diagonal - i + place] = form->turn[at];
            }
        }
    }
}

/* sum_k a_k conj(b_k) over `count` numbers. */
static void inner_product(const double *a, const double *ai, const double *b, const double *bi, int64_t count,
                          double *real, double *imaginary) {
    double one = 0.0, other = 0.0;
    for (int64_t k = 0; k < count; k++) {
        one += a[k] * b[k] + ai[k] * bi[k];
        other += ai[k] * b[k] - a[k] * bi[k];
    }
    *real = one;
    *imaginary = other;
}

/* Factorise in place; false where rounding made the form indefinite. */
static bool factorise_form(Envelope *own, int64_t unknowns) {
    for (int64_t i = 0; i < unknowns; i++) {
        int64_t first = i + 1 - (own->row[i + 1] - own->row[i]);
        double *real = own->real + own->row[i] - first, *imaginary = own->imaginary + own->row[i] - first;
        double pivot = real[i];
        for (int64_t j = first; j < i; j++) {
            int64_t begins = j + 1 - (own->row[j + 1] - own->row[j]), from = begins > first ? begins : first;
            const double *other = own->real + own->row[j] - begins, *others = own->imaginary + own->row[j] - begins;
            double sum, sums;
            inner_product(real + from, imaginary + from, other + from, others + from, j - from, &sum, &sums);
            real[j] = (real[j] - sum) / other[j];
            imaginary[j] = (imaginary[j] - sums) / other[j];
            pivot -= real[j] * real[j] + imaginary[j] * imaginary[j];
        }
        if (!(pivot > 0.0)) return false;
        real[i] = sqrt(pivot);
    }
    return true;
}

/* Solve with the factor; the right side becomes the solution. */
static void substitute(Envelope *own, int64_t unknowns) {
    double *x = own->right_real, *y = own->right_imaginary;
    for (int64_t i = 0; i < unknowns; i++) {
        int64_t first = i + 1 - (own->row[i + 1] - own->row[i]);
        const double *real = own->real + own->row[i] - first, *imaginary = own->imaginary + own->row[i] - first;
        for (int64_t k = first; k < i; k++) {
            x[i] -= real[k] * x[k] - imaginary[k] * y[k];
            y[i] -= real[k] * y[k] + imaginary[k] * x[k];
        }
        x[i] /= real[i];
        y[i] /= real[i];
    }
    for (int64_t i = unknowns - 1; i >= 0; i--) {
        int64_t first = i + 1 - (own->row[i + 1] - own->row[i]);
        const double *real = own->real + own->row[i] - first, *imaginary = own->imaginary + own->row[i] - first;
        x[i] /= real[i];
        y[i] /= real[i];
        for (int64_t k = first; k < i; k++) {
            x[k] -= real[k] * x[i] + imaginary[k] * y[i];
            y[k] -= real[k] * y[i] - imaginary[k] * x[i];
        }
    }
}

/* Map one patch; `solved` says whether it could be. */
static Status map_disk(const Disk *disk, Arena arena, double *points, uint8_t *solved) {
    Form form;
    Envelope own;
    lay_out_form(disk, &form, &own, &arena);
    assemble_form(disk, &form);
    *solved = 0;
    int64_t count = outer_border(disk, &form);
    if (count == 0) return DONE;
    int32_t first = farthest_from(disk, &form, count, form.loop[0]);
    int32_t second = farthest_from(disk, &form, count, first);
    if (first == second) second = form.loop[count / 2];
    double value = apart(disk, first, second);
    if (value == 0.0) value = 1.0;
    int64_t unknowns = order_unknowns(disk, &form, first, second);
    if (unknowns < 0 || shape_of(&form, unknowns, &own) > MOST_PRODUCTS) return DONE;
    own.real = malloc(2 * sizeof(double) * (size_t)(own.row[unknowns] + 1));
    if (!own.real) return OUT_OF_MEMORY;
    own.imaginary = own.real + own.row[unknowns];
    fill_in(&form, unknowns, second, value, &own);
    if (factorise_form(&own, unknowns)) {
        substitute(&own, unknowns);
        points[2 * first] = points[2 * first + 1] = points[2 * second + 1] = 0.0;
        points[2 * second] = value;
        for (int64_t i = 0; i < unknowns; i++) {
            points[2 * form.order[i]] = own.right_real[i];
            points[2 * form.order[i] + 1] = own.right_imaginary[i];
        }
        *solved = 1;
    }
    free(own.real);
    return DONE;
}

/* K patches; vertices and triangles of patch k begin at `offsets[k]` and `triangle_offsets[k]`, (K + 1).  `points`
 * (M, 2) of patches that are not `solved`, (K), are left alone. */
typedef struct {
    int64_t patches;
    const int64_t *offsets, *triangle_offsets;
    const double *positions;
    const int64_t *triangles;
    const double *lengths, *areas;
    double *points;
    uint8_t *solved;
} Maps;

static Disk disk_of(const Maps *maps, int64_t k) {
    int64_t vertex = maps->offsets[k], triangle = maps->triangle_offsets[k];
    return (Disk){maps->offsets[k + 1] - vertex,    maps->triangle_offsets[k + 1] - triangle,
                  maps->positions + 3 * vertex,     maps->triangles + 3 * triangle,
                  maps->lengths + 3 * triangle,     maps->areas + triangle};
}

int ENTRY(conformal_maps)(const Maps *maps) {
    size_t most = 0;
    for (int64_t k = 0; k < maps->patches; k++) {
        Form form;
        Envelope own;
        Arena counting = {NULL, 0};
        Disk disk = disk_of(maps, k);
        size_t bytes = lay_out_form(&disk, &form, &own, &counting);
        most = bytes > most ? bytes : most;
    }
    Arena arena = {aligned_memory(most), 0};
    if (!arena.memory) return OUT_OF_MEMORY;
    Status status = DONE;
    for (int64_t k = 0; k < maps->patches && status == DONE; k++) {
        Disk disk = disk_of(maps, k);
        status = map_disk(&disk, arena, maps->points + 2 * maps->offsets[k], maps->solved + k);
    }
    free_aligned(arena.memory);
    return status;
}
