/* lines_avr.c: the serial port of an ATmega328P at BAUD. Cycles are those of timer 1, to 8 cycles. */
#include <avr/io.h>
#include <avr/sleep.h>

#include "lines.h"

#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#ifndef BAUD
#define BAUD 38400UL
#endif

static int ungot = -1;
static uint16_t spent;
static bool running;

void line_begin(void)
{
    UBRR0 = (uint16_t)(F_CPU / 8 / BAUD - 1);
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << RXEN0 | 1 << TXEN0;
    TCCR1B = 1 << CS11;
}

int line_get(void)
{
    int c = ungot;
    ungot = -1;
    if (c >= 0)
        return c;
    while (!(UCSR0A & 1 << RXC0))
        continue;
    return UDR0;
}

void line_unget(int c)
{
    ungot = c;
}

void line_put(char c)
{
    while (!(UCSR0A & 1 << UDRE0))
        continue;
    UDR0 = (uint8_t)c;
}

void line_flush(void)
{
}

void line_mark(bool begins)
{
    if (begins)
        TCNT1 = 0;
    else if (running)
        spent = TCNT1;
    running = begins;
}

int32_t line_spent(void)
{
    return 8 * (int32_t)spent;
}

void line_end(void)
{
    for (;;)
        sleep_mode();
}
