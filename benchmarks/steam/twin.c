/* Workload S in C: the cost of many candidates on one core, SIMD over lanes, a lane being one opening of one candidate.
 *
 * Lanes are sorted by opening, the longest record first; WIDTH vectors of 8 lanes run together, so that one hides the
 * other's latency. State, residual and the table piece that each lane is on stay in registers. A table piece is
 * value = a + b x; pieces 0 and 10 are the flat ends outside [0, 20], so that no look-up needs a clamp.
 *
 * Scheme 0, exponential-Rosenbrock type, one evaluation f and its exact Jacobian J a step, Z = h J:
 *   x += h (I - 2/3 Z + 1/6 Z^2)^-1 (I - 1/6 Z) f,  with Z^2 = tr(Z) Z - det(Z) I for a 2x2 matrix.
 * Scheme 1, ROS2 with gamma = 1 - 1/sqrt 2, two evaluations a step:
 *   k1 = (I - gamma Z)^-1 f(x), k2 = (I - gamma Z)^-1 (f(x + h k1) - 2 k1), x += h (3/2 k1 + 1/2 k2).
 *
 * KEEP 1 looks the piece up only when some lane has left its own; KEEP 0 looks it up at every evaluation.
 */
#include <math.h>
#include <stdint.h>
#if defined(__AVX512F__) && defined(__AVX512DQ__) && !defined(PLAIN) /* PLAIN: no intrinsics, for other processors as well */
#include <immintrin.h>
#define AVX512 1
#endif

#ifndef WIDTH
#define WIDTH 2
#endif
#ifndef KEEP
#define KEEP 1
#endif
#define LANES 8
#define BLOCK (LANES * WIDTH)
#define OPENINGS 10
#define ROW 31
#define NODES 10
#define PIECES 11
#define FIELDS 8 /* a and b of k u, of A1, of A2; where the piece begins and ends */
#define TOP 20.0
#define INLINE static inline __attribute__((always_inline))

typedef double V __attribute__((vector_size(8 * LANES)));
typedef int64_t I __attribute__((vector_size(8 * LANES)));
typedef struct { V field[FIELDS]; } Piece;
typedef struct { V x, v; } State;
typedef double Table[PIECES][FIELDS][LANES];

INLINE V all(double value) { return (V){} + value; }
INLINE V choose(I mask, V yes, V no) { return (V)((mask & (I)yes) | (~mask & (I)no)); }

/* Which piece of the tables each lane is on; a lane that is not a number goes to piece 0. */
INLINE I piece_of(V x) {
#ifdef AVX512
    V place = _mm512_max_pd(x * all((NODES - 1) / TOP) + all(1.0), all(0.0));
    return (I)_mm512_cvttpd_epi64(_mm512_min_pd(place, all(PIECES - 1.0)));
#else
    I index;
    for (int lane = 0; lane < LANES; lane++) {
        double place = x[lane] * ((NODES - 1) / TOP) + 1.0;
        index[lane] = place > 0.0 ? (int64_t)fmin(place, PIECES - 1.0) : 0;
    }
    return index;
#endif
}

INLINE void look_up(Piece *piece, const Table table, V x, int fields) {
    I index = piece_of(x);
#ifdef AVX512
    const I lane = {0, 1, 2, 3, 4, 5, 6, 7};
    I at = index * (FIELDS * LANES) + lane;
    for (int f = 0; f < fields; f++) piece->field[f] = _mm512_i64gather_pd((__m512i)at, &table[0][f][0], 8);
#else
    for (int f = 0; f < fields; f++)
        for (int lane = 0; lane < LANES; lane++) piece->field[f][lane] = table[index[lane]][f][lane];
#endif
}

INLINE int all_inside(const Piece *piece, V x) {
#ifdef AVX512
    return _mm512_mask_cmp_pd_mask(_mm512_cmp_pd_mask(x, piece->field[6], _CMP_GE_OQ), x, piece->field[7], _CMP_LT_OQ) == 0xff;
#else
    I inside = (x >= piece->field[6]) & (x < piece->field[7]);
    int64_t every = -1;
    for (int lane = 0; lane < LANES; lane++) every &= inside[lane];
    return every != 0;
#endif
}

INLINE void on_piece(Piece *piece, const Table table, V x) {
    if (!KEEP) look_up(piece, table, x, 6);
    else if (__builtin_expect(!all_inside(piece, x), 0)) look_up(piece, table, x, FIELDS);
}

INLINE V acceleration(const Piece *p, State s, V *damping, V *per_inertia) {
    const V *f = p->field;
    *damping = f[2] + f[3] * s.x;
    *per_inertia = 1.0 / (f[4] + f[5] * s.x);
    return (f[0] + f[1] * s.x - s.x - *damping * s.v) * *per_inertia;
}

INLINE State step_exponential(Piece *p, const Table table, State s, V h) {
    on_piece(p, table, s.x);
    V damping, per_inertia, f2 = acceleration(p, s, &damping, &per_inertia), f1 = s.v;
    V g = h * per_inertia;
    V c = g * (p->field[1] - 1.0 - p->field[3] * s.v - p->field[5] * f2), d = -g * damping; /* Z = [[0, h], [c, d]] */
    V q = d * (1.0 / 6) - 2.0 / 3, m = 1.0 + h * c * (1.0 / 6);
    V b1 = f1 - h * f2 * (1.0 / 6), b2 = f2 - (c * f1 + d * f2) * (1.0 / 6);
    V corner = m + q * d, qh = q * h, qc = q * c;
    V scale = h / (m * corner - qh * qc);
    return (State){s.x + scale * (corner * b1 - qh * b2), s.v + scale * (m * b2 - qc * b1)};
}

INLINE State step_ros2(Piece *p, const Table table, State s, V h) {
    const double gamma = 1.0 - 0.70710678118654752440;
    on_piece(p, table, s.x);
    V damping, per_inertia, f2 = acceleration(p, s, &damping, &per_inertia), f1 = s.v;
    V gh = gamma * h, g = gh * per_inertia;
    V c = g * (p->field[1] - 1.0 - p->field[3] * s.v - p->field[5] * f2), corner = 1.0 + g * damping;
    V scale = 1.0 / (corner - gh * c); /* W = [[1, -gh], [-c, corner]] */
    V k1x = scale * (corner * f1 + gh * f2), k1v = scale * (f2 + c * f1);
    State middle = {s.x + h * k1x, s.v + h * k1v};
    on_piece(p, table, middle.x);
    f2 = acceleration(p, middle, &damping, &per_inertia) - 2.0 * k1v;
    f1 = middle.v - 2.0 * k1x;
    V k2x = scale * (corner * f1 + gh * f2), k2v = scale * (f2 + c * f1);
    return (State){s.x + h * (1.5 * k1x + 0.5 * k2x), s.v + h * (1.5 * k1v + 0.5 * k2v)};
}

/* One row of the data, 16 wide, spread over the lanes of a vector. */
INLINE V measured(const double *row, I opening) {
#ifdef AVX512
    return _mm512_permutex2var_pd(_mm512_loadu_pd(row), (__m512i)opening, _mm512_loadu_pd(row + 8));
#else
    V y;
    for (int lane = 0; lane < LANES; lane++) y[lane] = row[opening[lane]];
    return y;
#endif
}

typedef struct {
    Table table[WIDTH];
    V delay[WIDTH];
    I opening[WIDTH], samples[WIDTH];
    int64_t longest, shortest;
    double last_delay;
} Lanes;

INLINE void advance(int scheme, int substeps, const Lanes *lanes, Piece *p, State *s, const V *h) {
    for (int i = 0; i < substeps; i++)
        for (int w = 0; w < WIDTH; w++)
            s[w] = scheme ? step_ros2(&p[w], lanes->table[w], s[w], h[w]) : step_exponential(&p[w], lanes->table[w], s[w], h[w]);
}

/* Mean squared residual of every lane; `response` (samples, BLOCK) is written when it is not null. */
INLINE void simulate(int scheme, int substeps, const Lanes *lanes, const double *y, double period, double *mse, double *response) {
    State s[WIDTH];
    Piece p[WIDTH];
    V sum[WIDTH], h[WIDTH], whole[WIDTH];
    for (int w = 0; w < WIDTH; w++) {
        s[w] = (State){all(0.0), all(0.0)};
        sum[w] = all(0.0);
        whole[w] = all(period / substeps);
        look_up(&p[w], lanes->table[w], s[w].x, FIELDS);
    }
    for (int64_t j = 0; j < lanes->longest; j++) {
        int held = j * period >= lanes->last_delay; /* before, some lane rests for a part of this interval */
        if (__builtin_expect(!held, 0)) {
            for (int w = 0; w < WIDTH; w++) {
                V left = ((j + 1) * period - lanes->delay[w]) / substeps;
                left = choose(left < 0.0, all(0.0), left);
                h[w] = choose(left > whole[w], whole[w], left);
            }
            advance(scheme, substeps, lanes, p, s, h);
        } else {
            advance(scheme, substeps, lanes, p, s, whole);
        }
        for (int w = 0; w < WIDTH; w++) {
            V residual = s[w].x - measured(y + 16 * j, lanes->opening[w]);
            residual = (V)((I)residual & (lanes->samples[w] > j));
            sum[w] += residual * residual;
            if (response) __builtin_memcpy(response + j * BLOCK + w * LANES, &s[w].x, sizeof(V));
        }
    }
    for (int w = 0; w < WIDTH; w++)
        for (int lane = 0; lane < LANES; lane++) mse[w * LANES + lane] = sum[w][lane] / lanes->samples[w][lane];
}

static void load_lane(Lanes *lanes, int w, int lane, const double *row, double input, int64_t opening, int64_t samples) {
    const double width = TOP / (NODES - 1);
    for (int t = 0; t < 3; t++) {
        const double *node = row + NODES * t, factor = t == 0 ? input : 1.0;
        for (int i = 0; i < PIECES; i++) {
            int end = i == 0 || i == PIECES - 1;
            double slope = end ? 0.0 : (node[i] - node[i - 1]) / width;
            double start = end ? node[i == 0 ? 0 : NODES - 1] : node[i - 1] - slope * width * (i - 1);
            lanes->table[w][i][2 * t][lane] = factor * start;
            lanes->table[w][i][2 * t + 1][lane] = factor * slope;
        }
    }
    for (int i = 0; i < PIECES; i++) {
        lanes->table[w][i][6][lane] = i == 0 ? -INFINITY : width * (i - 1);
        lanes->table[w][i][7][lane] = i == PIECES - 1 ? INFINITY : width * i;
    }
    lanes->delay[w][lane] = row[ROW - 1];
    lanes->opening[w][lane] = opening;
    lanes->samples[w][lane] = samples;
}

static void load(Lanes *lanes, int64_t first, int64_t count, const double *theta, const double *input, const int64_t *samples) {
    lanes->longest = 0;
    lanes->last_delay = 0.0;
    for (int slot = 0; slot < BLOCK; slot++) {
        int64_t pair = first + slot < OPENINGS * count ? first + slot : OPENINGS * count - 1; /* the last lane fills up */
        int64_t opening = pair / count, candidate = pair % count;
        const double *row = theta + (candidate * OPENINGS + opening) * ROW;
        load_lane(lanes, slot / LANES, slot % LANES, row, input[opening], opening, samples[opening]);
        if (samples[opening] > lanes->longest) lanes->longest = samples[opening];
        if (row[ROW - 1] > lanes->last_delay) lanes->last_delay = row[ROW - 1];
    }
}

/* theta (count, 10, 31); y (longest, 16), any number after the end of a record; means (10, count) squared residuals;
 * responses null or (longest, BLOCK) for the first BLOCK lanes only. */
__attribute__((flatten)) static void run(int scheme, int substeps, int64_t count, const double *theta, const double *input,
                                         const int64_t *samples, const double *y, double period, double *means, double *responses) {
    static __thread Lanes lanes;
    double mse[BLOCK];
    for (int64_t first = 0; first < OPENINGS * count; first += BLOCK) {
        load(&lanes, first, count, theta, input, samples);
        if (responses) simulate(scheme, substeps, &lanes, y, period, mse, responses);
        else if (scheme == 0 && substeps == 1) simulate(0, 1, &lanes, y, period, mse, 0);
        else if (scheme == 1 && substeps == 1) simulate(1, 1, &lanes, y, period, mse, 0);
        else simulate(scheme, substeps, &lanes, y, period, mse, 0);
        for (int slot = 0; slot < BLOCK && first + slot < OPENINGS * count; slot++) means[first + slot] = mse[slot];
    }
}

void steam_costs(int64_t scheme, int64_t substeps, int64_t count, const double *theta, const double *input, const int64_t *samples,
                 const double *y, double period, double *means, double *costs) {
    run((int)scheme, (int)substeps, count, theta, input, samples, y, period, means, 0);
    for (int64_t candidate = 0; candidate < count; candidate++) {
        costs[candidate] = 0.0;
        for (int opening = 0; opening < OPENINGS; opening++) costs[candidate] += means[opening * count + candidate];
    }
}

/* The ten responses of one candidate; lanes 0..9 of (longest, BLOCK). */
void steam_responses(int64_t scheme, int64_t substeps, const double *theta, const double *input, const int64_t *samples, const double *y,
                     double period, double *means, double *responses) {
    run((int)scheme, (int)substeps, 1, theta, input, samples, y, period, means, responses);
}

int64_t steam_block(void) { return BLOCK; }
