// Mean squared torque error of many candidates, all samples evaluated, SIMD over candidates; the twin of benchmarks/torque.py.
#include <stdint.h>

#define LANES 8
#define WIDTH 3 // vectors of candidates whose coefficients and sums stay in registers
#define COLUMNS 5

typedef double vd __attribute__((vector_size(64)));

static inline vd all(double x) { return (vd){x, x, x, x, x, x, x, x}; }

// base (COLUMNS, count), regressor (samples, COLUMNS), torque (samples); out (count)
void torque_costs(int64_t count, int64_t samples, const double *base, const double *regressor, const double *torque, double *out) {
    for (int64_t first = 0; first < count; first += WIDTH * LANES) {
        vd b[WIDTH][COLUMNS], sum[WIDTH];
        for (int j = 0; j < WIDTH; j++) {
            sum[j] = all(0.0);
            for (int l = 0; l < LANES; l++) {
                int64_t c = first + j * LANES + l;
                c = c < count ? c : count - 1;
                for (int q = 0; q < COLUMNS; q++) b[j][q][l] = base[q * count + c];
            }
        }
        for (int64_t k = 0; k < samples; k++) {
            const double *row = regressor + COLUMNS * k;
            const vd y = all(-torque[k]), f0 = all(row[0]), f1 = all(row[1]), f2 = all(row[2]), f3 = all(row[3]), f4 = all(row[4]);
            for (int j = 0; j < WIDTH; j++) {
                vd r = y + b[j][0] * f0 + b[j][1] * f1 + b[j][2] * f2 + b[j][3] * f3 + b[j][4] * f4;
                sum[j] += r * r;
            }
        }
        for (int j = 0; j < WIDTH; j++)
            for (int l = 0; l < LANES && first + j * LANES + l < count; l++) out[first + j * LANES + l] = sum[j][l] / samples;
    }
}
