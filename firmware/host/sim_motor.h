/* A brushed DC motor with an incremental encoder, simulated in steps of 50 us. */
#ifndef PF_SIM_MOTOR_H
#define PF_SIM_MOTOR_H

#include <stdint.h>

struct sim_motor {
    double supply, efficiency;          /* V; share of the supply that passes the bridge */
    double R, L, K, J, C, Tf;           /* ohm, H, N m/A and V s/rad, kg m^2, N m s/rad, N m */
    double current, speed, angle, time; /* A, rad/s, rad, s */
    int32_t pulses;                     /* a turn, one edge of one track counted */
    double pulse_time, pulse_period;    /* s; of the last pulse, 0 before the second */
};

extern const struct sim_motor sim_motor_default;

/* Moves on to `time` (s) with `duty` of +-255 steps held. */
void sim_motor_advance(struct sim_motor *motor, double time, int16_t duty);
/* Counts of the quadrature decoder: four a pulse. */
int32_t sim_motor_counts(const struct sim_motor *motor);
/* Period of the last pulse in us, 0 once the motor has stood for half a second. */
int32_t sim_motor_period_us(const struct sim_motor *motor);

#endif
