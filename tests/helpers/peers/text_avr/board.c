/* An emulated AVR (simavr), an ATmega328P by default, with the firmware FIRMWARE.elf, its UART on a pseudo-terminal: the
 * output has the line "pty PATH", then what its second UART says, if it has one. Inputs of its ADC, in mV: 0: 500 for
 * each of the outputs PB0 to PB2 that is high; 1: 1250. Ends when standard input is closed.
 *
 *   board FIRMWARE.elf [MCU]
 */
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_time.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define SLICE_US 500

static avr_t *avr;
static int terminal = -1, ready = 1;

static void port_changed(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    uint32_t high = (value & 1) + (value >> 1 & 1) + (value >> 2 & 1);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), 500 * high);
}

static void byte_sent(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    unsigned char byte = value;
    if (write(terminal, &byte, 1) != 1)
        fprintf(stderr, "a byte is lost: nobody reads the terminal\n");
}

static void byte_told(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    putchar((int)value);
    if (value == '\n')
        fflush(stdout);
}

static void flow(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)value;
    ready = param != NULL;
}

static avr_irq_t *uart(char name, int which) {
    return avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), which);
}

/* The emulated line hands the bytes on at its own rate. */
static void feed(void) {
    unsigned char byte;
    while (ready && read(terminal, &byte, 1) == 1)
        avr_raise_irq(uart('0', UART_IRQ_INPUT), byte);
}

/* The slave's end stays open here too, so that its other users may come and go. */
static const char *open_terminal(void) {
    static char path[64];
    struct termios raw;
    uint32_t flags = 0;
    int slave;
    cfmakeraw(memset(&raw, 0, sizeof raw));
    if (openpty(&terminal, &slave, path, &raw, NULL) || fcntl(terminal, F_SETFL, O_NONBLOCK))
        return NULL;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags); /* no copy on standard output */
    avr_irq_register_notify(uart('0', UART_IRQ_OUTPUT), byte_sent, NULL);
    avr_irq_register_notify(uart('0', UART_IRQ_OUT_XON), flow, avr);
    avr_irq_register_notify(uart('0', UART_IRQ_OUT_XOFF), flow, NULL);
    if (uart('1', UART_IRQ_OUTPUT)) {
        avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('1'), &flags);
        avr_irq_register_notify(uart('1', UART_IRQ_OUTPUT), byte_told, NULL);
    }
    return path;
}

/* Keeps the emulated clock from running ahead of the computer's. */
static void keep_pace(const struct timespec *start) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    int64_t real = (now.tv_sec - start->tv_sec) * 1000000LL + (now.tv_nsec - start->tv_nsec) / 1000;
    int64_t ahead = (int64_t)avr_cycles_to_usec(avr, avr->cycle) - real;
    if (ahead > 0)
        usleep(ahead);
}

int main(int argc, char **argv) {
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    if (argc < 2 || argc > 3 || elf_read_firmware(argv[1], &firmware))
        return fprintf(stderr, "usage: board FIRMWARE.elf [MCU]\n"), 2;
    const char *mcu = argc == 3 ? argv[2] : "atmega328p";
    avr = avr_make_mcu_by_name(mcu);
    if (!avr)
        return fprintf(stderr, "this simavr has no %s\n", mcu), 1;
    avr_init(avr);
    avr->log = LOG_ERROR;
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr_load_firmware(avr, &firmware);
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = 5000;

    const char *path = open_terminal();
    if (!path)
        return perror("openpty"), 1;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT), port_changed, NULL);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC1), 1250);
    printf("pty %s\n", path);
    fflush(stdout);

    struct timespec start;
    clock_gettime(CLOCK_MONOTONIC, &start);
    struct pollfd input = {.fd = 0, .events = POLLIN};
    for (avr_cycle_count_t next = 0;;) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return fprintf(stderr, "the emulated CPU stopped\n"), 1;
        if (avr->cycle < next)
            continue;
        feed();
        next = avr->cycle + avr_usec_to_cycles(avr, SLICE_US);
        keep_pace(&start);
        if (poll(&input, 1, 0) > 0)
            break;
    }
    return 0;
}
