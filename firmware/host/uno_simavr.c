/* The program of the Arduino Uno, byte for byte, on a simulated ATmega328P (simavr) with its serial line on a pseudo-terminal.
 *
 *     uno_simavr uno.elf [TRUTH]
 *
 * prints the name of the terminal. TRUTH receives every change of the PWM register: "P,us,value of 400,forward,backward".
 */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_uart.h>
#include <simavr/parts/uart_pty.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define HZ 16000000
#define PORTD 0x2B
#define OCR1AL 0x88
#define OCR1AH 0x89

static volatile sig_atomic_t ended;

static void end(int number)
{
    (void)number;
    ended = 1;
}

static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int count, char **words)
{
    elf_firmware_t program;
    memset(&program, 0, sizeof program);
    if (count < 2 || elf_read_firmware(words[1], &program)) {
        fprintf(stderr, "use: uno_simavr uno.elf [TRUTH]\n");
        return 2;
    }
    FILE *truth = count > 2 ? fopen(words[2], "w") : NULL;
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    program.frequency = HZ;
    avr_load_firmware(avr, &program);
    uint32_t flags = 0; /* neither echoed nor slowed down: the pseudo-terminal is the line */
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart_pty_t line;
    uart_pty_init(avr, &line);
    uart_pty_connect(&line, '0');
    printf("%s\n", line.pty.slavename);
    fflush(stdout);
    signal(SIGTERM, end);
    signal(SIGINT, end);

    double begun = seconds();
    int pwm = 0;
    for (unsigned long k = 0; !ended; k++) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return 1;
        if (k % 4096) continue;
        double us = (double)avr->cycle * 1e6 / HZ, ahead = us * 1e-6 - (seconds() - begun);
        int now = avr->data[OCR1AL] | avr->data[OCR1AH] << 8;
        if (truth && now != pwm) fprintf(truth, "P,%.0f,%d,%d,%d\n", us, now, avr->data[PORTD] >> 7 & 1, avr->data[0x25] & 1);
        pwm = now;
        if (ahead > 0) usleep((useconds_t)(ahead * 1e6));
    }
    if (truth) fclose(truth);
    _exit(0); /* the thread of the terminal may wait for ever */
}
