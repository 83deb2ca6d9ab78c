/* The frame that a problem is put in (fitting/batch.py, frame_of): its initial domain lies in [-1, 1]^2 and is turned to
 * the signals' principal directions. */
#include "kernel.h"

enum { TERMS = 6, ROTATIONS = 30 };

static const double SINGULAR = 1e-14; /* eigenvalues below this share of the largest are rounding errors */

/* Eigenvalues and eigenvectors (columns) of a symmetric matrix (6, 6), by Jacobi's rotations; `matrix` is destroyed. */
static void eigenvectors_of(double matrix[TERMS][TERMS], double vectors[TERMS][TERMS]) {
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j < TERMS; j++) vectors[i][j] = i == j;
    for (int round = 0; round < ROTATIONS; round++)
        for (int p = 0; p < TERMS; p++)
            for (int q = p + 1; q < TERMS; q++) {
                if (matrix[p][q] == 0.0) continue;
                double theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
                double tangent = (theta >= 0.0 ? 1.0 : -1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                double cosine = 1.0 / sqrt(tangent * tangent + 1.0), sine = tangent * cosine;
                for (int k = 0; k < TERMS; k++) {
                    double a = matrix[k][p], b = matrix[k][q];
                    matrix[k][p] = cosine * a - sine * b, matrix[k][q] = sine * a + cosine * b;
                }
                for (int k = 0; k < TERMS; k++) {
                    double a = matrix[p][k], b = matrix[q][k];
                    matrix[p][k] = cosine * a - sine * b, matrix[q][k] = sine * a + cosine * b;
                    a = vectors[k][p], b = vectors[k][q];
                    vectors[k][p] = cosine * a - sine * b, vectors[k][q] = sine * a + cosine * b;
                }
                matrix[p][q] = matrix[q][p] = 0.0;
            }
}

/* Quadratics 1, u, v, u^2, uv, v^2 that fit the signals best, (6, D), with the least coefficients where several do.
 *
 * The normal equations are exact enough: parameters lie in [-1, 1], and the result only decides about a direction.
 */
static void fit_quadratics(const Problem *problem, const double *mean, double reach, const double *origin,
                           double quadratic[TERMS][3]) {
    double gram[TERMS][TERMS] = {{0.0}}, right[TERMS][3] = {{0.0}}, vectors[TERMS][TERMS], most = 0.0;
    int signals = (int)problem->signal_count;
    for (int64_t n = 0; n < problem->vertex_count; n++) {
        double u = (problem->domain[2 * n] - mean[0]) / reach, v = (problem->domain[2 * n + 1] - mean[1]) / reach;
        double term[TERMS] = {1.0, u, v, u * u, u * v, v * v};
        for (int i = 0; i < TERMS; i++) {
            for (int j = 0; j < TERMS; j++) gram[i][j] += term[i] * term[j];
            for (int d = 0; d < signals; d++) right[i][d] += term[i] * (problem->signals[n * signals + d] - origin[d]);
        }
    }
    eigenvectors_of(gram, vectors);
    for (int i = 0; i < TERMS; i++) most = larger(most, gram[i][i]);
    memset(quadratic, 0, sizeof(double) * TERMS * 3);
    for (int i = 0; i < TERMS; i++) {
        if (!(gram[i][i] > SINGULAR * most)) continue;
        for (int d = 0; d < signals; d++) {
            double share = 0.0;
            for (int j = 0; j < TERMS; j++) share += vectors[j][i] * right[j][d];
            for (int j = 0; j < TERMS; j++) quadratic[j][d] += vectors[j][i] * share / gram[i][i];
        }
    }
}

/* Rotation (2, 2) whose columns are the eigenvectors of the sum of the signals' squared Hessians, the larger first. */
static void principal_axes(double quadratic[TERMS][3], int signals, double *turn) {
    double uu = 0.0, uv = 0.0, vv = 0.0;
    for (int d = 0; d < signals; d++) {
        double a = 2.0 * quadratic[3][d], b = quadratic[4][d], c = 2.0 * quadratic[5][d];
        uu += a * a + b * b, uv += b * (a + c), vv += b * b + c * c;
    }
    /* half the angle of (uu - vv, 2 uv), by formulas that do not cancel */
    double difference = uu - vv, length = sqrt(difference * difference + 4.0 * uv * uv);
    double cosine = 1.0, sine = 0.0;
    if (length > 0.0) {
        cosine = sqrt(larger(0.5 * (1.0 + fabs(difference) / length), 0.0));
        sine = uv / (length * cosine);
        if (difference < 0.0) {
            double other = cosine;
            cosine = fabs(sine), sine = sine < 0.0 ? -other : other;
        }
    }
    turn[0] = cosine, turn[1] = -sine, turn[2] = sine, turn[3] = cosine;
}

/* Centre and reach of the turned domain. */
static void enclose(const Problem *problem, Frame *frame) {
    const double *turn = frame->turn;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (int64_t n = 0; n < problem->vertex_count; n++)
        for (int k = 0; k < 2; k++) {
            double turned = problem->domain[2 * n] * turn[k] + problem->domain[2 * n + 1] * turn[2 + k];
            low[k] = smaller(low[k], turned), high[k] = larger(high[k], turned);
        }
    double reach = larger(high[0] - low[0], high[1] - low[1]) / 2.0, x = (low[0] + high[0]) / 2.0;
    double y = (low[1] + high[1]) / 2.0;
    frame->centre[0] = x * turn[0] + y * turn[1];
    frame->centre[1] = x * turn[2] + y * turn[3];
    frame->scale = reach > 0.0 ? 1.0 / reach : 1.0;
}

static Frame frame_of(const Problem *problem) {
    Frame frame = {{0.0, 0.0}, {1.0, 0.0, 0.0, 1.0}, {0.0, 0.0, 0.0}, 1.0};
    double mean[2] = {0.0, 0.0}, reach = 0.0, quadratic[TERMS][3];
    int signals = (int)problem->signal_count;
    for (int64_t n = 0; n < problem->vertex_count; n++) {
        for (int k = 0; k < 2; k++) mean[k] += problem->domain[2 * n + k] / (double)problem->vertex_count;
        for (int d = 0; d < signals; d++)
            frame.origin[d] += problem->signals[n * signals + d] / (double)problem->vertex_count;
    }
    for (int64_t n = 0; n < problem->vertex_count; n++)
        for (int k = 0; k < 2; k++) reach = larger(reach, fabs(problem->domain[2 * n + k] - mean[k]));
    if (reach > 0.0) {
        fit_quadratics(problem, mean, reach, frame.origin, quadratic);
        principal_axes(quadratic, signals, frame.turn);
    }
    enclose(problem, &frame);
    return frame;
}

static void write_frame(const Frame *frame, double *out) {
    memcpy(out, frame->centre, sizeof frame->centre);
    memcpy(out + 2, frame->turn, sizeof frame->turn);
    memcpy(out + 6, frame->origin, sizeof frame->origin);
    out[9] = frame->scale;
}

static Frame read_frame(const double *in) {
    Frame frame;
    memcpy(frame.centre, in, sizeof frame.centre);
    memcpy(frame.turn, in + 2, sizeof frame.turn);
    memcpy(frame.origin, in + 6, sizeof frame.origin);
    frame.scale = in[9];
    return frame;
}

/* ---- for the tests */

void ENTRY(frame_of)(const Problem *problem) {
    Frame frame = frame_of(problem);
    write_frame(&frame, problem->frame);
}
