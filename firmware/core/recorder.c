#include "recorder.h"

#include "hal.h"
#include "line.h"

#define NO_HELLO 255

static struct {
    enum pf_state state;
    bool streaming;
    uint32_t session;
    uint32_t counter;   /* of the next sample; runs on until a reset */
    uint32_t divide;    /* ticks to a sample */
    uint32_t hold;      /* samples to a value */
    uint32_t tick, held;
    uint32_t total;     /* values of the excitation */
    uint32_t want;      /* index of the next value to receive */
    uint32_t play;      /* index of the next value to play */
    int16_t values[PF_BUFFER];
    int16_t drive;
    uint32_t tick_us, next_tick, last_heard;
    uint32_t dropped, bad, starved, watchdogs;
    uint8_t hello; /* next line of the hello, or NO_HELLO */
} now;

static struct line_reader reader;
static struct line_writer writer;

static bool send(void)
{
    uint8_t count = line_end(&writer);
    return hal_send(writer.text, count);
}

static void drive(int16_t raw)
{
    if (raw > hal_board()->drive_limit) raw = hal_board()->drive_limit;
    if (raw < -hal_board()->drive_limit) raw = (int16_t)-hal_board()->drive_limit;
    now.drive = raw;
    hal_drive(raw);
}

static void refuse(const char *reason)
{
    line_begin(&writer, 'E');
    line_add_text(&writer, reason);
    send();
}

static void acknowledge(const char *command, uint32_t value)
{
    line_begin(&writer, 'K');
    line_add_text(&writer, command);
    line_add_unsigned(&writer, now.session);
    line_add_unsigned(&writer, value);
}

/* One line of the hello in each round, so that a short transmit buffer can hold it. */
static void hello(void)
{
    const struct pf_board *b = hal_board();
    if (now.hello == 0) {
        line_begin(&writer, 'H');
        line_add_unsigned(&writer, PF_VERSION);
        line_add_text(&writer, b->name);
        line_add_text(&writer, PF_FIRMWARE);
        line_add_unsigned(&writer, hal_boot_id());
        line_add_unsigned(&writer, b->tick_hz);
        line_add_unsigned(&writer, b->watchdog_ms);
        line_add_unsigned(&writer, PF_BUFFER);
        line_add_unsigned(&writer, b->channel_count);
    } else if (now.hello == 1) {
        line_begin(&writer, 'A');
        line_add_text(&writer, b->drive_name);
        line_add_text(&writer, b->drive_unit);
        line_add_text(&writer, b->drive_scale);
        line_add_integer(&writer, b->drive_limit);
    } else {
        const struct pf_channel *c = &b->channels[now.hello - 2];
        line_begin(&writer, 'C');
        line_add_unsigned(&writer, now.hello - 2u);
        line_add_text(&writer, c->name);
        line_add_text(&writer, c->unit);
        line_add_text(&writer, c->scale);
        line_add_text(&writer, c->offset);
    }
    if (send()) now.hello = now.hello + 1 < 2 + b->channel_count ? (uint8_t)(now.hello + 1) : NO_HELLO;
}

static void start(const char *p)
{
    uint32_t session, divide, hold, total, from;
    if (!(line_unsigned(&p, &session) && line_unsigned(&p, &divide) && line_unsigned(&p, &hold) && line_unsigned(&p, &total) &&
          line_unsigned(&p, &from)) || !divide || !hold || from > total) {
        refuse("S wants session,divide,hold,total,from");
        return;
    }
    if (!(now.streaming && now.session == session)) { /* a repeated command changes nothing */
        drive(0);
        if (!now.streaming) now.dropped = now.bad = now.starved = now.watchdogs = 0; /* a new recording, not one that goes on */
        now.session = session;
        now.divide = divide;
        now.hold = hold;
        now.total = total;
        now.want = now.play = from;
        now.tick = now.held = 0;
        now.state = PF_RESTING;
        now.streaming = true;
    }
    acknowledge("S", now.counter);
    send();
}

static void values(const char *p)
{
    uint32_t session, index;
    int32_t value;
    if (!line_unsigned(&p, &session) || !line_unsigned(&p, &index)) return;
    if (session != now.session || !now.streaming) return;
    for (; line_integer(&p, &value); index++) {
        if (index != now.want || now.want >= now.total || now.want - now.play >= PF_BUFFER) continue;
        if (value > hal_board()->drive_limit) value = hal_board()->drive_limit;
        if (value < -hal_board()->drive_limit) value = -hal_board()->drive_limit;
        now.values[now.want++ % PF_BUFFER] = (int16_t)value;
    }
    acknowledge("U", now.want);
    send();
}

/* A controller on the host: the drive from now on. A motor that the watchdog stopped stays so until a new S. */
static void driven(const char *p)
{
    uint32_t session;
    int32_t value;
    if (!line_unsigned(&p, &session) || !line_integer(&p, &value)) return;
    if (session != now.session || !now.streaming || now.total || now.state == PF_WATCHDOG) return;
    if (value > hal_board()->drive_limit) value = hal_board()->drive_limit;
    if (value < -hal_board()->drive_limit) value = -hal_board()->drive_limit;
    now.state = PF_DRIVEN;
    drive((int16_t)value);
}

static void stop(const char *p)
{
    uint32_t session;
    drive(0); /* before anything that could fail */
    now.streaming = false;
    now.state = PF_RESTING;
    now.total = now.want = now.play = 0;
    if (line_unsigned(&p, &session)) now.session = session;
    acknowledge("X", now.counter);
    line_add_unsigned(&writer, now.dropped);
    line_add_unsigned(&writer, now.bad);
    line_add_unsigned(&writer, now.starved);
    line_add_unsigned(&writer, now.watchdogs);
    send();
}

static void obey(const char *text)
{
    uint32_t version;
    const char *p = text + 1;
    now.last_heard = hal_micros();
    switch (text[0]) {
    case 'H':
        if (line_unsigned(&p, &version) && version != PF_VERSION) refuse("protocol version");
        now.hello = 0; /* says the version in any case */
        break;
    case 'S': start(p); break;
    case 'U': values(p); break;
    case 'V': driven(p); break;
    case 'W': break; /* only a sign of life */
    case 'X': stop(p); break;
    default: refuse("unknown command");
    }
}

static void watch(void)
{
    bool able = now.streaming && now.state != PF_WATCHDOG && now.state != PF_FINISHED;
    if (able && hal_micros() - now.last_heard > 1000u * (uint32_t)hal_board()->watchdog_ms) {
        drive(0);
        now.state = PF_WATCHDOG;
        now.want = now.play; /* what is buffered is forgotten; only a new S starts the motor again */
        now.watchdogs++;
    }
}

/* What the motor gets from this sample on; returns the index of that value, or -1. */
static int32_t play(void)
{
    if ((now.state == PF_RESTING || now.state == PF_STARVED) && now.play < now.total) {
        uint32_t left = now.total - now.play;
        if (now.want - now.play >= (left < PF_PREFILL ? left : PF_PREFILL)) {
            now.state = PF_PLAYING;
            now.held = 0;
        }
    }
    if (now.state != PF_PLAYING) return -1;
    if (now.held == 0) {
        if (now.play == now.total || now.play == now.want) {
            now.state = now.play == now.total ? PF_FINISHED : PF_STARVED;
            now.starved += now.state == PF_STARVED;
            drive(0);
            return -1;
        }
        drive(now.values[now.play++ % PF_BUFFER]);
    }
    now.held = now.held + 1 < now.hold ? now.held + 1 : 0;
    return (int32_t)(now.play - 1);
}

static void sample(bool missed)
{
    int32_t raw[PF_MOST_CHANNELS];
    uint32_t us = hal_micros();
    hal_read(raw);
    int32_t index = play();
    if (!missed) {
        line_begin(&writer, 'D');
        line_add_unsigned(&writer, now.counter);
        line_add_unsigned(&writer, us);
        line_add_integer(&writer, now.drive);
        line_add_integer(&writer, index);
        line_add_unsigned(&writer, (uint32_t)now.state);
        for (uint8_t k = 0; k < hal_board()->channel_count; k++) line_add_integer(&writer, raw[k]);
        if (!send()) now.dropped++;
    }
    now.counter++;
}

void recorder_start(void)
{
    drive(0);
    now.hello = NO_HELLO;
    now.tick_us = 1000000u / hal_board()->tick_hz;
    now.next_tick = hal_micros() + now.tick_us;
    now.last_heard = hal_micros();
}

void recorder_poll(void)
{
    int byte;
    hal_alive();
    while ((byte = hal_receive()) >= 0) {
        switch (line_feed(&reader, (char)byte)) {
        case LINE_GOOD: obey(reader.text); break;
        case LINE_BAD: now.bad++; break;
        case LINE_NONE: break;
        }
    }
    watch();
    while (recorder_idle_us() == 0) {
        now.next_tick += now.tick_us;
        if (!now.streaming) continue;
        /* a tick whose successor is due too comes too late to be sampled: it is counted, and shows as a gap */
        if (now.tick == 0) sample(recorder_idle_us() == 0);
        now.tick = now.tick + 1 < now.divide ? now.tick + 1 : 0;
    }
    if (now.hello != NO_HELLO) hello();
}

uint32_t recorder_idle_us(void)
{
    int32_t left = (int32_t)(now.next_tick - hal_micros());
    return left > 0 ? (uint32_t)left : 0;
}
