/* Vectors and memory of the STM32F103C8 before main. */
#include <stdint.h>

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;
int main(void);
void usart1_interrupt(void);

void reset_handler(void)
{
    for (uint32_t *from = &data_load, *to = &data_start; to < &data_end;) *to++ = *from++;
    for (uint32_t *to = &bss_start; to < &bss_end;) *to++ = 0;
    main();
    for (;;) {}
}

static void hang(void)
{
    for (;;) {} /* the hardware watchdog resets the board */
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const handler vectors[16 + 38] = {
    (handler)(uintptr_t)&stack_top, reset_handler, hang, hang, hang, hang, hang, 0, 0, 0, 0, hang, hang, 0, hang, hang,
    [16 + 37] = usart1_interrupt,
};
