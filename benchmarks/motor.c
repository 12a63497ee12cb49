// Mean squared speed error of a motor with friction under a held voltage, SIMD over candidates; the twin of benchmarks/motor.py.
// ROS2: Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456, gamma = 1 - 1/sqrt 2, exact Jacobian.
#include <math.h>
#include <stdint.h>

#define LANES 8
#define WIDTH 2 // independent chains that hide each other's latency

typedef double vd __attribute__((vector_size(64)));
typedef int64_t vi __attribute__((vector_size(64)));

static inline vd all(double x) { return (vd){x, x, x, x, x, x, x, x}; }
static inline vd pick(vi mask, vd yes, vd no) { return (vd)((mask & (vi)yes) | (~mask & (vi)no)); }

// exp for -40 <= x <= 0: 2^n times a Taylor polynomial of degree 12 on |x| <= ln(2) / 2
static inline vd exponential(vd x) {
    const vd magic = all(0x1.8p52);
    vd shifted = x * 0x1.71547652b82fep0 + magic, n = shifted - magic;
    vd r = x - n * 0x1.62e42fefa39efp-1 - n * 0x1.abc9e3b39803fp-56;
    vd s = all(1.0 / 479001600);
    s = s * r + 1.0 / 39916800;
    s = s * r + 1.0 / 3628800;
    s = s * r + 1.0 / 362880;
    s = s * r + 1.0 / 40320;
    s = s * r + 1.0 / 5040;
    s = s * r + 1.0 / 720;
    s = s * r + 1.0 / 120;
    s = s * r + 1.0 / 24;
    s = s * r + 1.0 / 6;
    s = s * r + 0.5;
    s = s * r + 1.0;
    s = s * r + 1.0;
    vi power = ((vi)shifted - (vi)magic + 1023) << 52;
    return s * (vd)power;
}

// exact to 2e-16 of 1 (not of itself near 0, which friction does not need)
static inline vd hyperbolic_tangent(vd x) {
    vd a = (vd)((vi)x & INT64_MAX);
    a = pick(a < 20.0, a, all(20.0));
    vd e = exponential(-2.0 * a), t = (1.0 - e) / (1.0 + e);
    return pick(x < 0.0, -t, t);
}

// parameters (6, count): R, L, K, B, J, Tf; voltage (samples) and speed (samples), speed[k] at the end of voltage[k]; out (count);
// when track is not null it receives the speed (samples) of candidate 0
void motor_costs(int64_t count, int64_t samples, int64_t substeps, double period, double width, const double *parameters,
                 const double *voltage, const double *speed, double *out, double *track) {
    const double h = period / substeps, g = (1.0 - 1.0 / sqrt(2.0)) * h;
    for (int64_t first = 0; first < count; first += WIDTH * LANES) {
        vd a11[WIDTH], a12[WIDTH], b1[WIDTH], a21[WIDTH], viscous[WIDTH], coulomb[WIDTH], i[WIDTH], w[WIDTH], sum[WIDTH];
        for (int j = 0; j < WIDTH; j++) {
            for (int l = 0; l < LANES; l++) {
                int64_t c = first + j * LANES + l;
                c = c < count ? c : count - 1;
                const double *p = parameters + c;
                a11[j][l] = -p[0] / p[count], a12[j][l] = -p[2 * count] / p[count], b1[j][l] = 1.0 / p[count];
                a21[j][l] = p[2 * count] / p[4 * count], viscous[j][l] = -p[3 * count] / p[4 * count];
                coulomb[j][l] = -p[5 * count] / p[4 * count];
            }
            i[j] = w[j] = sum[j] = all(0.0);
        }
        for (int64_t k = 0; k < samples; k++) {
            for (int64_t s = 0; s < substeps; s++)
                for (int j = 0; j < WIDTH; j++) {
                    vd t = hyperbolic_tangent(w[j] / width);
                    vd m11 = 1.0 - g * a11[j], m12 = -g * a12[j], m21 = -g * a21[j];
                    vd m22 = 1.0 - g * (viscous[j] + coulomb[j] * (1.0 - t * t) / width);
                    vd inverse = 1.0 / (m11 * m22 - m12 * m21);
                    vd f = a11[j] * i[j] + a12[j] * w[j] + b1[j] * voltage[k], q = a21[j] * i[j] + viscous[j] * w[j] + coulomb[j] * t;
                    vd k1 = (m22 * f - m12 * q) * inverse, l1 = (m11 * q - m21 * f) * inverse;
                    vd i1 = i[j] + h * k1, w1 = w[j] + h * l1;
                    f = a11[j] * i1 + a12[j] * w1 + b1[j] * voltage[k] - 2.0 * k1;
                    q = a21[j] * i1 + viscous[j] * w1 + coulomb[j] * hyperbolic_tangent(w1 / width) - 2.0 * l1;
                    i[j] += h * (1.5 * k1 + 0.5 * (m22 * f - m12 * q) * inverse);
                    w[j] += h * (1.5 * l1 + 0.5 * (m11 * q - m21 * f) * inverse);
                }
            for (int j = 0; j < WIDTH; j++) sum[j] += (w[j] - speed[k]) * (w[j] - speed[k]);
            if (track && first == 0) track[k] = w[0][0];
        }
        for (int j = 0; j < WIDTH; j++)
            for (int l = 0; l < LANES && first + j * LANES + l < count; l++) out[first + j * LANES + l] = sum[j][l] / samples;
    }
}
