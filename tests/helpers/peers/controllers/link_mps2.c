/* link_mps2.c: an emulated Arm MPS2 board: the first serial port is the link, the second one the record, the tick is
 * that of SysTick. */
#include "io.h"
#include "umo_link.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART(n, at) REGISTER(0x40004000u + 0x1000u * (n) + (at))
#define SYSTICK_CTRL REGISTER(0xE000E010)
#define SYSTICK_LOAD REGISTER(0xE000E014)
#define SYSTICK_VALUE REGISTER(0xE000E018)
#define CLOCK 25e6

enum { ROOM = 2048 };
static uint8_t in[ROOM];
static uint32_t came, gone;

static void listen(void)
{
    while (UART(0, 4) & 2 && came - gone < ROOM)
        in[came++ % ROOM] = (uint8_t)UART(0, 0);
}

static void put(uint32_t port, uint8_t byte)
{
    while (UART(port, 4) & 1)
        listen();
    UART(port, 0) = byte;
}

void link_begin(void)
{
    for (uint32_t n = 0; n < 2; n++) {
        UART(n, 0x10) = 16;
        UART(n, 8) = 3;
    }
    SYSTICK_LOAD = (uint32_t)(CLOCK * MACHINE_PERIOD) - 1;
    SYSTICK_VALUE = 0;
    SYSTICK_CTRL = 5;
}

int link_get(void)
{
    listen();
    return came == gone ? -1 : in[gone++ % ROOM];
}

void link_put(uint8_t byte)
{
    put(0, byte);
}

void link_end(void)
{
}

int32_t io_wait(void)
{
    while (!(SYSTICK_CTRL & 1u << 16))
        listen();
    return 1;
}

void record_put(char c)
{
    put(1, (uint8_t)c);
}
