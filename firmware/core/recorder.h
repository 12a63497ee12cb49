/* The board's side of docs/recording-protocol.md: samples at even times, plays values, stops when the host is silent. */
#ifndef PF_RECORDER_H
#define PF_RECORDER_H

#include <stdint.h>

#define PF_VERSION 1
#define PF_FIRMWARE "0.2"

#ifdef __AVR__
#define PF_BUFFER 128 /* of 2 KiB of memory in all */
#else
#define PF_BUFFER 512 /* values to play that are held ahead; a power of two */
#endif
#define PF_PREFILL (PF_BUFFER / 2)

enum pf_state { PF_RESTING, PF_PLAYING, PF_FINISHED, PF_WATCHDOG, PF_STARVED, PF_DRIVEN };

void recorder_start(void);
/* One round of the main loop: bytes, watchdog, and a sample if one is due. */
void recorder_poll(void);
/* Microseconds until the next tick, 0 when it is due. */
uint32_t recorder_idle_us(void);

#endif
