/* startup.c: from reset to main, for any Cortex-M. Memory is that of mps2.ld; a board's own file may stand here. */
#include <stdint.h>

extern uint32_t data_begin, data_end, data_stored, bss_begin, bss_end, stack_top;

int main(void);
void reset(void);

void reset(void)
{
    const uint32_t *from = &data_stored;
    for (uint32_t *to = &data_begin; to < &data_end; to++)
        *to = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end; to++)
        *to = 0;
#if defined(__ARM_FP)
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* the floating-point unit is on */
    __asm volatile("dsb\n isb");
#endif
    (void)main();
}

static void halt(void)
{
    for (;;) /* the watchdog ends it */
        continue;
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))&stack_top, reset, halt, halt, halt, halt, halt, 0, 0, 0, 0, halt, halt, 0, halt, halt,
};
