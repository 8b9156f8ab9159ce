/* avr.c: an emulated ATmega328P (simavr) with a firmware, its serial port on standard input and output, as fast as it
 * goes. Ends with standard input.
 *
 *   avr FIRMWARE.elf
 */
#include <fcntl.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define UCSR0B 0xC1
#define RXEN0 4
#define STEPS 200 /* instructions between two looks at standard input */

static avr_t *avr;
static int ready = 1;

static void byte_sent(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    unsigned char byte = (unsigned char)value;
    if (write(1, &byte, 1) != 1)
        _exit(1);
}

static void flow(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    ready = param != NULL;
}

static avr_irq_t *uart(int which)
{
    return avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), which);
}

/* 0 at the end of standard input. */
static int feed(void)
{
    unsigned char byte;
    if (!(avr->data[UCSR0B] & 1 << RXEN0))
        return 1; /* what comes before would be lost */
    while (ready) {
        ssize_t n = read(0, &byte, 1);
        if (n == 0)
            return 0;
        if (n < 0)
            return 1;
        avr_raise_irq(uart(UART_IRQ_INPUT), byte);
    }
    return 1;
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware;
    uint32_t flags = 0;
    memset(&firmware, 0, sizeof firmware);
    if (argc != 2 || elf_read_firmware(argv[1], &firmware))
        return fprintf(stderr, "usage: avr FIRMWARE.elf\n"), 2;
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr)
        return fprintf(stderr, "this simavr has no atmega328p\n"), 1;
    avr_init(avr);
    avr->frequency = 16000000;
    avr_load_firmware(avr, &firmware);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags); /* no copy on standard output, no sleeping */
    avr_irq_register_notify(uart(UART_IRQ_OUTPUT), byte_sent, NULL);
    avr_irq_register_notify(uart(UART_IRQ_OUT_XON), flow, avr);
    avr_irq_register_notify(uart(UART_IRQ_OUT_XOFF), flow, NULL);
    (void)fcntl(0, F_SETFL, fcntl(0, F_GETFL) | O_NONBLOCK);
    while (feed())
        for (int i = 0; i < STEPS; i++) {
            int state = avr_run(avr);
            if (state == cpu_Done || state == cpu_Crashed)
                return fprintf(stderr, "the firmware has crashed\n"), 1;
        }
    return 0;
}
