/* lines_mps2.c: the first serial port of an Arm MPS2 board (qemu-system-arm -M mps2-an385 or mps2-an386). Cycles are
 * those of the SysTick timer: under `-icount shift=0` of instructions. */
#include "lines.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART_DATA REGISTER(0x40004000)
#define UART_STATE REGISTER(0x40004004) /* bit 0: cannot send; bit 1: has received */
#define UART_CTRL REGISTER(0x40004008)
#define UART_BAUD REGISTER(0x40004010)
#define SYSTICK_CTRL REGISTER(0xE000E010)
#define SYSTICK_LOAD REGISTER(0xE000E014)
#define SYSTICK_VALUE REGISTER(0xE000E018)
#define SYSTICK_MASK 0xFFFFFFu

static int ungot = -1;
static uint32_t began, spent;
static bool running;

void line_begin(void)
{
    UART_BAUD = 16;
    UART_CTRL = 3;
    SYSTICK_LOAD = SYSTICK_MASK;
    SYSTICK_VALUE = 0;
    SYSTICK_CTRL = 5; /* the clock of the processor, no interrupt */
}

int line_get(void)
{
    int c = ungot;
    ungot = -1;
    if (c >= 0)
        return c;
    while (!(UART_STATE & 2))
        continue;
    return (int)(UART_DATA & 0xFF);
}

void line_unget(int c)
{
    ungot = c;
}

void line_put(char c)
{
    while (UART_STATE & 1)
        continue;
    UART_DATA = (uint32_t)(unsigned char)c;
}

void line_flush(void)
{
}

void line_mark(bool begins)
{
    uint32_t now = SYSTICK_VALUE; /* it counts down */
    if (begins)
        began = now;
    else if (running)
        spent = (began - now) & SYSTICK_MASK;
    running = begins;
}

int32_t line_spent(void)
{
    return (int32_t)spent;
}

void line_end(void)
{
    for (;;)
        __asm volatile("wfi");
}
