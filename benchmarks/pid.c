// Closed PID loops on a motor with exact hold, SIMD over candidates; the twin of benchmarks/pid.py.
// Each block of WIDTH x 8 candidates runs through all samples with its state in registers or first-level cache.
#include <math.h>
#include <stdint.h>

#ifndef WIDTH
#define WIDTH 2 // independent chains that hide each other's latency
#endif
#define LANES 8

typedef double vd __attribute__((vector_size(64)));
typedef int64_t vi __attribute__((vector_size(64)));

static inline vd pick(vi mask, vd yes, vd no) { return (vd)((mask & (vi)yes) | (~mask & (vi)no)); }
static inline vd all(double x) { return (vd){x, x, x, x, x, x, x, x}; }
static inline vd least(vd a, vd b) { return pick(a < b, a, b); }
static inline vd most(vd a, vd b) { return pick(a > b, a, b); }
static inline vd size(vd a) { return (vd)((vi)a & INT64_MAX); }
static inline vd nearest(vd a) { return (a + 0x1.8p52) - 0x1.8p52; } // half to even, for |a| < 2^51

// a (2, 2), b (2): states after one period; gains (3, count): Kp, Ki, Kd; out (5, count): overshoot, rise, settling, peak, error
void pid_metrics(int64_t count, int64_t samples, double period, double reference, double top, double volts, const double *a,
                 const double *b, const double *gains, double *out) {
    const vd high = all(top), none = all(0.0), never = all(INFINITY);
    const double gain = volts / top, low_level = 0.1 * reference, high_level = 0.9 * reference, band = 0.02 * reference;
    const double half = 0.5 * period, rate = 1.0 / period;
    for (int64_t first = 0; first < count; first += WIDTH * LANES) {
        vd kp[WIDTH], ki[WIDTH], kd[WIDTH], i[WIDTH], w[WIDTH], sum[WIDTH], last[WIDTH];
        vd at_low[WIDTH], at_high[WIDTH], settled[WIDTH], peak[WIDTH], at_peak[WIDTH], y[WIDTH];
        for (int j = 0; j < WIDTH; j++) {
            for (int l = 0; l < LANES; l++) {
                int64_t c = first + j * LANES + l;
                c = c < count ? c : count - 1;
                kp[j][l] = gains[c], ki[j][l] = gains[count + c] * half, kd[j][l] = gains[2 * count + c] * rate;
            }
            i[j] = w[j] = sum[j] = last[j] = none;
            at_low[j] = at_high[j] = settled[j] = at_peak[j] = never, peak[j] = -never;
        }
        for (int64_t k = 0; k < samples; k++) {
            const vd t = all(k * period);
            for (int j = 0; j < WIDTH; j++) {
                y[j] = w[j];
                vd error = reference - y[j];
                vd added = ki[j] * (error + last[j]);
                vd integral = sum[j] + added;
                vd wanted = kp[j] * error + integral + kd[j] * (error - last[j]);
                last[j] = error;
                sum[j] = pick(((wanted > high) & (added > none)) | ((wanted < none) & (added < none)), sum[j], integral);
                vd u = gain * nearest(least(most(wanted, none), high));
                vd i1 = a[0] * i[j] + a[1] * w[j] + b[0] * u;
                w[j] = a[2] * i[j] + a[3] * w[j] + b[1] * u;
                i[j] = i1;
                at_low[j] = pick(y[j] >= low_level, least(at_low[j], t), at_low[j]);
                at_high[j] = pick(y[j] >= high_level, least(at_high[j], t), at_high[j]);
                settled[j] = pick(size(y[j] - reference) <= band, least(settled[j], t), never);
                vi higher = y[j] > peak[j];
                peak[j] = pick(higher, y[j], peak[j]);
                at_peak[j] = pick(higher, t, at_peak[j]);
            }
        }
        for (int j = 0; j < WIDTH; j++)
            for (int l = 0; l < LANES; l++) {
                int64_t c = first + j * LANES + l;
                if (c >= count) break;
                double over = peak[j][l] - reference;
                out[c] = 100.0 * (over > 0 ? over : 0) / fabs(reference);
                out[count + c] = isfinite(at_high[j][l]) ? at_high[j][l] - at_low[j][l] : INFINITY;
                out[2 * count + c] = settled[j][l];
                out[3 * count + c] = at_peak[j][l];
                out[4 * count + c] = reference - y[j][l];
            }
    }
}
