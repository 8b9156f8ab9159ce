/* io_link.c: the serial line to the host is USART0, by interrupts. It is yours: umo new controller does not write over it. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "umo_link.h"

#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#ifndef BAUD
#define BAUD 115200UL /* as baudrate in the wiring; 250000 and 500000 are exact at 16 MHz */
#endif
#ifdef USART_RX_vect /* the only one of its chip */
#define USART0_RX_vect USART_RX_vect
#define USART0_UDRE_vect USART_UDRE_vect
#endif

/* What comes in during a period, and a whole answer with its end. */
enum { IN = 256, OUT = LINK_LONGEST + LINK_LONGEST / 254 + 8 };
static volatile uint8_t in[IN], came, gone;
static volatile uint8_t out[OUT];
static volatile uint16_t put, sent;

ISR(USART0_RX_vect)
{
    uint8_t byte = UDR0;
    if ((uint8_t)(came + 1) != gone)
        in[came++] = byte;
}

ISR(USART0_UDRE_vect)
{
    if (sent == put) {
        UCSR0B &= (uint8_t)~(1 << UDRIE0);
        return;
    }
    UDR0 = out[sent];
    sent = (uint16_t)(sent + 1 == OUT ? 0 : sent + 1);
}

void link_begin(void)
{
    UBRR0 = (uint16_t)((F_CPU + 4 * BAUD) / (8 * BAUD) - 1);
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << RXCIE0 | 1 << RXEN0 | 1 << TXEN0;
    sei();
}

int link_get(void)
{
    return came == gone ? -1 : in[gone++];
}

void link_put(uint8_t byte)
{
    uint16_t now;
    uint16_t next = (uint16_t)(put + 1 == OUT ? 0 : put + 1);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        now = sent;
    }
    if (next == now)
        return;
    out[put] = byte;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        put = next;
    }
}

void link_end(void)
{
    UCSR0B |= 1 << UDRIE0;
}
