// As much of the Arduino core as the sketch of docs/driver-text.md uses, for the ATmega328P at 16 MHz.
#pragma once
#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint8_t byte;
enum { LOW, HIGH };
enum { INPUT, OUTPUT };
enum { A0 = 14 };

static volatile unsigned long ticks;
ISR(TIMER0_COMPA_vect) { ticks++; }

static unsigned long millis() {
    cli();
    unsigned long now = ticks;
    sei();
    return now;
}

static volatile uint8_t &port(uint8_t pin) { return pin < 8 ? PORTD : PORTB; }
static uint8_t mask(uint8_t pin) { return 1 << (pin < 8 ? pin : pin - 8); }

static void pinMode(uint8_t pin, uint8_t mode) {
    volatile uint8_t &direction = pin < 8 ? DDRD : DDRB;
    direction = mode == OUTPUT ? direction | mask(pin) : direction & ~mask(pin);
}

static void digitalWrite(uint8_t pin, uint8_t level) {
    port(pin) = level ? port(pin) | mask(pin) : port(pin) & ~mask(pin);
}

static int digitalRead(uint8_t pin) { return ((pin < 8 ? PIND : PINB) & mask(pin)) != 0; }

static int analogRead(uint8_t pin) {
    ADMUX = _BV(REFS0) | (pin - A0);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
    while (ADCSRA & _BV(ADSC))
        ;
    return ADC;
}

static volatile char received[64];
static volatile uint8_t head, tail;
ISR(USART_RX_vect) {
    char c = UDR0;
    if (((head + 1) & 63) != tail) {
        received[head] = c;
        head = (head + 1) & 63;
    }
}

struct SerialPort {
    void begin(unsigned long baud) {
        UBRR0 = F_CPU / 8 / baud - 1;
        UCSR0A = _BV(U2X0);
        UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    }
    bool available() { return head != tail; }
    int read() {
        char c = received[tail];
        tail = (tail + 1) & 63;
        return c;
    }
    void print(char c) {
        while (!(UCSR0A & _BV(UDRE0)))
            ;
        UDR0 = c;
    }
    void print(const char *text) {
        while (*text)
            print(*text++);
    }
    void print(int number) {
        char text[8];
        print(itoa(number, text, 10));
    }
    template <typename T> void println(T thing) {
        print(thing);
        print("\r\n");
    }
};
static SerialPort Serial;

void setup();
void loop();

int main() {
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = 249; // 1 ms
    TIMSK0 = _BV(OCIE0A);
    sei();
    setup();
    for (;;)
        loop();
}
