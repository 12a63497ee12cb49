/* What a board must offer. One file for each board implements it; nothing else knows the hardware. */
#ifndef PF_HAL_H
#define PF_HAL_H

#include <stdbool.h>
#include <stdint.h>

#define PF_MOST_CHANNELS 6

/* Texts, so that no floating point is printed on small processors. value = scale * raw + offset. */
struct pf_channel {
    const char *name, *unit, *scale, *offset;
};

struct pf_board {
    const char *name;
    uint16_t tick_hz;     /* a divisor of 1 000 000 */
    uint16_t watchdog_ms; /* the motor stops after so much silence of the host */
    const char *drive_name, *drive_unit, *drive_scale;
    int16_t drive_limit; /* largest raw drive of either sign */
    uint8_t channel_count;
    struct pf_channel channels[PF_MOST_CHANNELS];
};

const struct pf_board *hal_board(void);

uint32_t hal_micros(void);  /* wraps after 71.6 minutes */
uint32_t hal_boot_id(void); /* differs, most likely, after each reset */
int hal_receive(void);      /* the next byte from the host, or -1 */
/* Queues a line, whole or not at all; false where there is no room. */
bool hal_send(const char *bytes, uint8_t count);
void hal_drive(int16_t raw); /* PWM and direction; 0 stops the motor */
void hal_read(int32_t *raw); /* all channels, at one moment */
void hal_alive(void);        /* called in every round: feed the hardware's own watchdog */

#endif
