/* Board layer of Arduino Uno and Nano (ATmega328P, 16 MHz).
 *
 *     pin 9       PWM to the bridge, 20 kHz (timer 1)      pins 7, 8   direction to the bridge
 *     pin 2, 3    encoder A, B                             pin A0      current sensor
 */
#include <Arduino.h>
#include <avr/eeprom.h>
#include <avr/wdt.h>

extern "C" {
#include "hal.h"
}

static const uint8_t PIN_A = 2, PIN_B = 3, PIN_FORWARD = 7, PIN_BACKWARD = 8, PIN_PWM = 9;
static const uint16_t PWM_TOP = 400;         /* 16 MHz / (2 * 400) = 20 kHz */
static const uint32_t STANDING_US = 500000;  /* no edge for so long: the motor stands */

/* Change the texts to your bench: supply 12 V, encoder of 500 pulses, 0.185 V/A around 2.5 V (ACS712-05). */
static const struct pf_board board = {
    "arduino motor", 200, 300, "V", "V", "0.0470588235294", 255, 3,
    {
        {"angle", "rad", "0.00314159265359", "0"},
        {"pulse_period", "us", "1", "0"},
        {"current", "A", "0.0263935810811", "-13.5135135135"}, /* 5 V / 1024 / 0.185 V/A; zero at 2.5 V */
    },
};

static volatile int32_t counts;
static volatile uint32_t last_rise, pulse_us;
static volatile uint8_t quadrature;
static uint32_t boot;

static char waiting[256]; /* lines on their way; an index of 8 bits wraps by itself */
static uint8_t first, after_last;

static void edge()
{
    /* new state of A and B with the old one as an index: +1, -1, or 0 for a jump that cannot be told */
    static const int8_t step[16] = {0, -1, 1, 0, 1, 0, 0, -1, -1, 0, 0, 1, 0, 1, -1, 0};
    uint8_t now = (uint8_t)((PIND >> PIN_A) & 3u);
    uint8_t before = quadrature;
    counts += step[(before << 2 | now) & 15];
    quadrature = now;
    if (!(before & 1u) && (now & 1u)) {
        uint32_t us = micros();
        pulse_us = us - last_rise;
        last_rise = us;
    }
}

void hal_begin()
{
    uint32_t *cell = nullptr; /* a counter of resets in the EEPROM */
    boot = eeprom_read_dword(cell) + 1;
    eeprom_update_dword(cell, boot);
    pinMode(PIN_A, INPUT_PULLUP);
    pinMode(PIN_B, INPUT_PULLUP);
    pinMode(PIN_FORWARD, OUTPUT);
    pinMode(PIN_BACKWARD, OUTPUT);
    pinMode(PIN_PWM, OUTPUT);
    TCCR1A = _BV(COM1A1);
    TCCR1B = _BV(WGM13) | _BV(CS10); /* phase and frequency correct, top in ICR1, no prescaler */
    ICR1 = PWM_TOP;
    OCR1A = 0;
    ADMUX = _BV(REFS0);              /* A0 against 5 V, converting all the time */
    ADCSRB = 0;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADATE) | 7;
    attachInterrupt(digitalPinToInterrupt(PIN_A), edge, CHANGE);
    attachInterrupt(digitalPinToInterrupt(PIN_B), edge, CHANGE);
    Serial.begin(1000000);           /* exact at 16 MHz */
    wdt_enable(WDTO_250MS);          /* a program that hangs is reset, and pins let go of the bridge */
}

extern "C" {

const struct pf_board *hal_board(void)
{
    return &board;
}

uint32_t hal_micros(void)
{
    return micros();
}

uint32_t hal_boot_id(void)
{
    return boot;
}

int hal_receive(void)
{
    return Serial.read();
}

static void flush(void)
{
    while (first != after_last && Serial.availableForWrite() > 0) Serial.write(waiting[first++]);
}

bool hal_send(const char *bytes, uint8_t count)
{
    flush();
    if ((uint8_t)(after_last - first) + (uint16_t)count > 255) return false;
    for (uint8_t k = 0; k < count; k++) waiting[after_last++] = bytes[k];
    flush();
    return true;
}

void hal_drive(int16_t raw)
{
    uint16_t size = (uint16_t)(raw < 0 ? -raw : raw);
    if (raw == 0) OCR1A = 0; /* off before the direction changes */
    digitalWrite(PIN_FORWARD, raw > 0 ? HIGH : LOW);
    digitalWrite(PIN_BACKWARD, raw < 0 ? HIGH : LOW);
    OCR1A = (uint16_t)((uint32_t)size * PWM_TOP / 255);
}

void hal_read(int32_t *raw)
{
    uint32_t us = micros();
    noInterrupts();
    raw[0] = counts;
    raw[1] = us - last_rise > STANDING_US ? 0 : (int32_t)pulse_us;
    raw[2] = ADC;
    interrupts();
}

void hal_alive(void)
{
    wdt_reset();
    flush();
}

}
