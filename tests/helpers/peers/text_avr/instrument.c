/* A small instrument on an ATmega328P at 16 MHz: lines of text on its UART, 38400 baud, 8N1.
 *
 *   *IDN?       UMO,AVR-1,328P        OUT n,v   OK; output n (0 to 5, PORTB) to 0 or 1
 *   OUT? n      OUT n=0               LEVEL v   OK; a number from -1999.99 to 1999.99, kept in hundredths
 *   LEVEL?      12.34                 ADC? n    the converter's count of channel n, 0 to 1023
 *   WD ms       OK; after this time without a line the outputs go to 0; 0: off
 *
 * Errors: ERR 1 unknown, ERR 2 range, ERR 3 line too long. It says "ready" after a reset. Lines end with LF, CR is
 * passed over, answers end with CR LF.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LONGEST 40

static volatile uint32_t now_ms;
static volatile char queue[64];
static volatile uint8_t head, tail;
static uint32_t watchdog_ms, heard;
static int32_t level;

ISR(TIMER0_COMPA_vect) { now_ms++; }

ISR(USART_RX_vect) {
    char c = UDR0;
    uint8_t next = (head + 1) & 63;
    if (next != tail) {
        queue[head] = c;
        head = next;
    }
}

static uint32_t now(void) {
    uint8_t flags = SREG;
    cli();
    uint32_t ms = now_ms;
    SREG = flags;
    return ms;
}

static void send(const char *text) {
    for (; *text; text++) {
        while (!(UCSR0A & _BV(UDRE0)))
            ;
        UDR0 = *text;
    }
}

static void answer(const char *text) {
    send(text);
    send("\r\n");
}

static uint16_t converted(uint8_t channel) {
    ADMUX = _BV(REFS0) | channel;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
    while (ADCSRA & _BV(ADSC))
        ;
    return ADC;
}

/* A number with at most two decimals, in hundredths; 0 if it is not one or beyond the range. */
static uint8_t hundredths(const char *text, int32_t *value) {
    char *end;
    uint8_t negative = *text == '-';
    long whole = strtol(text, &end, 10);
    long part = 0;
    if (end == text)
        return 0;
    if (*end == '.')
        end++;
    for (uint8_t digit = 10; digit && *end >= '0' && *end <= '9'; digit /= 10)
        part += (*end++ - '0') * digit;
    if (*end || whole < -1999 || whole > 1999)
        return 0;
    *value = whole * 100 + (negative ? -part : part);
    return 1;
}

static void obey(char *line) {
    char text[32];
    unsigned n, v;
    if (!strcmp(line, "*IDN?")) {
        answer("UMO,AVR-1,328P");
    } else if (sscanf(line, "OUT? %u", &n) == 1) {
        if (n > 5) {
            answer("ERR 2 range");
            return;
        }
        snprintf(text, sizeof text, "OUT %u=%u", n, (PORTB >> n) & 1);
        answer(text);
    } else if (sscanf(line, "OUT %u,%u", &n, &v) == 2) {
        if (n > 5 || v > 1) {
            answer("ERR 2 range");
            return;
        }
        PORTB = v ? PORTB | _BV(n) : PORTB & ~_BV(n);
        answer("OK");
    } else if (sscanf(line, "ADC? %u", &n) == 1) {
        snprintf(text, sizeof text, "%u", converted(n & 7));
        answer(n > 7 ? "ERR 2 range" : text);
    } else if (!strcmp(line, "LEVEL?")) {
        int32_t size = level < 0 ? -level : level;
        snprintf(text, sizeof text, "%s%ld.%02ld", level < 0 ? "-" : "", (long)(size / 100), (long)(size % 100));
        answer(text);
    } else if (!strncmp(line, "LEVEL ", 6)) {
        answer(hundredths(line + 6, &level) ? "OK" : "ERR 2 range");
    } else if (sscanf(line, "WD %u", &n) == 1) {
        answer("OK");
        watchdog_ms = n;
    } else {
        answer("ERR 1 unknown");
    }
}

static void take(char c) {
    static char line[LONGEST + 1];
    static uint8_t length;
    if (c == '\r')
        return;
    if (c != '\n') {
        if (length <= LONGEST)
            line[length++] = c;
        return;
    }
    heard = now();
    if (length > LONGEST) {
        answer("ERR 3 line too long");
    } else {
        line[length] = 0;
        obey(line);
    }
    length = 0;
}

int main(void) {
    DDRB = 0x3f;
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = 249; /* 1 ms */
    TIMSK0 = _BV(OCIE0A);
    UBRR0 = 25; /* 38400 baud */
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    sei();
    answer("ready");
    for (;;) {
        if (head != tail) {
            char c = queue[tail];
            tail = (tail + 1) & 63;
            take(c);
        }
        if (watchdog_ms && now() - heard > watchdog_ms)
            PORTB = 0;
    }
}
