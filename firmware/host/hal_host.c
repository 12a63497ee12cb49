/* The board layer on a computer: a pseudo-terminal for the serial line, a simulated motor for the bench.
 *
 *     motor_host [--link PATH] [--truth FILE] [--watchdog MS]
 *
 * prints the name of the terminal; PATH becomes a link to it. FILE receives every line of data that the
 * board made ("D,..."), also those that found no room, and every change of the drive ("M,us,raw").
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "../core/hal.h"
#include "../core/recorder.h"
#include "sim_motor.h"

static int port = -1;
static FILE *truth;
static struct sim_motor motor;
static int16_t duty;
static char waiting[1024]; /* as a transmit buffer: what the terminal did not take yet */
static size_t waiting_count;
static volatile sig_atomic_t ended;

static struct pf_board board = {
    .name = "simulated motor",
    .tick_hz = 1000,
    .watchdog_ms = 300,
    .drive_name = "V",
    .drive_unit = "V",
    .drive_scale = "0.0470588235294", /* 12 V / 255 */
    .drive_limit = 255,
    .channel_count = 3,
    .channels = {
        {"angle", "rad", "0.00314159265359", "0"}, /* 2 pi / (4 * 500) */
        {"pulse_period", "us", "1", "0"},
        {"current", "A", "0.00244140625", "0"}, /* 12 bits over +-5 A */
    },
};

const struct pf_board *hal_board(void)
{
    return &board;
}

static uint64_t nanoseconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* The board's clock follows real time but stops at every tick, so that a busy computer never makes the board
 * miss one: it samples on time by its own clock, as a microcontroller does, and only its lines come late. */
static uint64_t begun, clock_us;

static double seconds(void)
{
    return (double)clock_us * 1e-6;
}

uint32_t hal_micros(void)
{
    return (uint32_t)clock_us;
}

uint32_t hal_boot_id(void)
{
    return (uint32_t)(begun / 1000u) ^ (uint32_t)getpid();
}

int hal_receive(void)
{
    unsigned char byte;
    return read(port, &byte, 1) == 1 ? byte : -1;
}

static void flush(void)
{
    ssize_t sent = waiting_count ? write(port, waiting, waiting_count) : 0;
    if (sent > 0) {
        waiting_count -= (size_t)sent;
        memmove(waiting, waiting + sent, waiting_count);
    }
}

bool hal_send(const char *bytes, uint8_t count)
{
    if (truth && bytes[0] == 'D') fwrite(bytes, 1, count, truth);
    flush();
    if (waiting_count + count > sizeof waiting) return false;
    memcpy(waiting + waiting_count, bytes, count);
    waiting_count += count;
    flush();
    return true;
}

void hal_drive(int16_t raw)
{
    sim_motor_advance(&motor, seconds(), duty);
    if (truth && raw != duty) fprintf(truth, "M,%lu,%d\n", (unsigned long)hal_micros(), raw);
    duty = raw;
}

void hal_read(int32_t *raw)
{
    sim_motor_advance(&motor, seconds(), duty);
    raw[0] = sim_motor_counts(&motor);
    raw[1] = sim_motor_period_us(&motor);
    double steps = motor.current / 0.00244140625;
    raw[2] = (int32_t)(steps > 2047 ? 2047 : steps < -2048 ? -2048 : steps + (steps > 0 ? 0.5 : -0.5));
}

void hal_alive(void)
{
    flush();
}

static void end(int number)
{
    (void)number;
    ended = 1;
}

static int fail(const char *what, const char *where)
{
    fprintf(stderr, "motor_host: %s %s (%s)\n", what, where, strerror(errno));
    return 1;
}

int main(int count, char **words)
{
    const char *link_path = NULL;
    for (int k = 1; k + 1 < count; k += 2) {
        if (!strcmp(words[k], "--link")) link_path = words[k + 1];
        else if (!strcmp(words[k], "--watchdog")) board.watchdog_ms = (uint16_t)atoi(words[k + 1]);
        else if (!strcmp(words[k], "--truth")) {
            if (!(truth = fopen(words[k + 1], "w"))) return fail("cannot write", words[k + 1]);
        } else count = 0;
    }
    if (count % 2 == 0) {
        fprintf(stderr, "use: motor_host [--link PATH] [--truth FILE] [--watchdog MS]\n");
        return 2;
    }
    port = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (port < 0 || grantpt(port) || unlockpt(port)) return fail("cannot open", "a pseudo-terminal");
    const char *name = ptsname(port);
    int kept = open(name, O_RDWR | O_NOCTTY); /* held open, so that the terminal outlives its users */
    struct termios raw_mode;
    if (kept < 0 || tcgetattr(kept, &raw_mode)) return fail("cannot open", name);
    cfmakeraw(&raw_mode);
    tcsetattr(kept, TCSANOW, &raw_mode);
    if (link_path) {
        unlink(link_path);
        if (symlink(name, link_path)) return fail("cannot link", link_path);
    }
    printf("%s\n", name);
    fflush(stdout);
    signal(SIGTERM, end);
    signal(SIGINT, end);

    begun = nanoseconds();
    motor = sim_motor_default;
    recorder_start();
    while (!ended) {
        uint64_t real_us = (nanoseconds() - begun) / 1000u;
        do {
            uint64_t left = real_us - clock_us, idle = recorder_idle_us();
            clock_us += left < idle ? left : idle;
            recorder_poll();
        } while (clock_us < real_us && !ended);
        struct pollfd wait = {.fd = port, .events = POLLIN};
        uint32_t us = recorder_idle_us();
        struct timespec limit = {.tv_sec = us / 1000000u, .tv_nsec = (long)(us % 1000000u) * 1000};
        ppoll(&wait, 1, &limit, NULL);
    }
    if (truth) fclose(truth);
    if (link_path) unlink(link_path);
    return 0;
}
