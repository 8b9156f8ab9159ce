/* io_board.cpp: the pins of your board. Fill in the tables; umo new controller does not write over it. */
#include <Arduino.h>
#include <avr/wdt.h>

extern "C" {
#include "io.h"
}

/* The pin of each output and input, in the order of machine_outputs and machine_inputs in machine.h: such as
 * {9, true} for PWM on pin 9, {7, false} for a level on pin 7, {A0, true} for the converter, {4, false} for a switch.
 * NO_PIN: it is not wired yet, so an input could not be read and an output is not accepted. */
struct pin {
    uint8_t number;
    bool analog;
};
static const uint8_t NO_PIN = 255;
static const struct pin outputs[MACHINE_OUTPUTS + 1] = {};
static const struct pin inputs[MACHINE_INPUTS + 1] = {};
static const bool wired = false; /* true when both tables are filled in */

static const uint32_t PERIOD = (uint32_t)(MACHINE_PERIOD * 1e6f + 0.5f); /* us */
static uint32_t next_tick;
static bool watched;

bool io_begin(void)
{
    bool by_watchdog = MCUSR & _BV(WDRF);
    MCUSR = 0;
    wdt_disable();
    for (int16_t place = 0; wired && place < MACHINE_OUTPUTS; place++)
        pinMode(outputs[place].number, OUTPUT); /* low; machine_stop follows at once */
    for (int16_t place = 0; wired && place < MACHINE_INPUTS; place++)
        if (!inputs[place].analog)
            pinMode(inputs[place].number, INPUT_PULLUP);
    next_tick = micros() + PERIOD;
    return !by_watchdog;
}

void io_watchdog(void)
{
    if (!watched)
        wdt_enable(WDTO_120MS); /* a multiple of the period */
    watched = true;
    wdt_reset();
}

int32_t io_wait(void)
{
    int32_t ticks = 1;
    while ((int32_t)(micros() - next_tick) < 0)
        continue;
    for (next_tick += PERIOD; (int32_t)(micros() - next_tick) >= 0; next_tick += PERIOD)
        ticks++;
    return ticks;
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    for (int16_t place = 0; place < MACHINE_INPUTS; place++) {
        failed_in[place] = !wired || inputs[place].number == NO_PIN;
        if (!failed_in[place])
            raws_in[place] = inputs[place].analog ? analogRead(inputs[place].number) : digitalRead(inputs[place].number);
    }
}

bool io_write(int16_t place, int32_t raw)
{
    if (!wired || outputs[place].number == NO_PIN)
        return false;
    if (outputs[place].analog)
        analogWrite(outputs[place].number, (int)raw);
    else
        digitalWrite(outputs[place].number, raw ? HIGH : LOW);
    return true;
}

void io_fault(umo_fault fault, int16_t object)
{
    Serial.begin(9600);
    Serial.print(F("fault "));
    Serial.print(fault);
    Serial.print(' ');
    Serial.println(object);
}
