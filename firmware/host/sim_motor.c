#include "sim_motor.h"

#include <math.h>

#define STEP 50e-6
#define TURN 6.283185307179586
#define SMOOTH 0.1 /* rad/s over which Coulomb friction changes sign */

const struct sim_motor sim_motor_default = {
    .supply = 12.0, .efficiency = 0.98, .R = 2.8, .L = 4e-3, .K = 0.025, .J = 2.5e-5, .C = 1.2e-5, .Tf = 4e-3, .pulses = 500,
};

static void step(struct sim_motor *m, double V, double h)
{
    /* the winding exactly for a held speed, then the rotor with friction taken implicitly: stable for any duty */
    double decay = exp(-m->R / m->L * h);
    double held = (V - m->K * m->speed) / m->R;
    m->current = held + (m->current - held) * decay;
    double friction = m->C + m->Tf * (fabs(m->speed) > 1e-9 ? tanh(m->speed / SMOOTH) / m->speed : 1.0 / SMOOTH);
    m->speed = (m->speed + h / m->J * m->K * m->current) / (1.0 + h / m->J * friction);
    double before = m->angle * m->pulses / TURN;
    m->angle += h * m->speed;
    m->time += h;
    double after = m->angle * m->pulses / TURN, crossed = fabs(floor(after) - floor(before));
    if (crossed > 0) { /* the last pulse within the step, at an even speed */
        double edge = after > before ? floor(after) : floor(after) + 1;
        double at = m->time - h + h * (edge - before) / (after - before);
        m->pulse_period = crossed > 1 ? h / fabs(after - before) : m->pulse_time > 0 ? at - m->pulse_time : 0;
        m->pulse_time = at;
    }
}

void sim_motor_advance(struct sim_motor *m, double time, int16_t duty)
{
    double V = m->supply * m->efficiency * duty / 255.0;
    while (m->time + STEP <= time) step(m, V, STEP);
}

int32_t sim_motor_counts(const struct sim_motor *m)
{
    return (int32_t)floor(m->angle * 4 * m->pulses / TURN);
}

int32_t sim_motor_period_us(const struct sim_motor *m)
{
    return m->time - m->pulse_time > 0.5 ? 0 : (int32_t)lround(m->pulse_period * 1e6);
}
