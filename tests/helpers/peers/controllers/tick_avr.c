/* tick_avr.c: the tick of an emulated ATmega2560 is that of timer 1, and its second serial port tells the record. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/atomic.h>

#include "io.h"

void record_put(char c);
static volatile uint8_t ticks;
static bool begun;

ISR(TIMER1_COMPA_vect)
{
    ticks++;
}

static void begin(void)
{
    UBRR1 = 1; /* 1 Mbaud */
    UCSR1A = 1 << U2X1;
    UCSR1B = 1 << TXEN1;
    OCR1A = (uint16_t)(F_CPU / 8 * MACHINE_PERIOD) - 1;
    TCCR1B = 1 << WGM12 | 1 << CS11;
    TIMSK1 = 1 << OCIE1A;
    begun = true;
}

int32_t io_wait(void)
{
    uint8_t found = 0;
    if (!begun)
        begin();
    for (;;) {
        cli();
        found = ticks;
        ticks = 0;
        if (found)
            break;
        sleep_enable();
        sei();
        sleep_cpu();
    }
    sei();
    return found;
}

void record_put(char c)
{
    while (!(UCSR1A & 1 << UDRE1))
        continue;
    UDR1 = (uint8_t)c;
}
