/* Board layer of the STM32F103 ("Blue Pill"), 72 MHz from an 8 MHz crystal.
 *
 *     PA9, PA10    serial line, 1 000 000 baud           PA8          PWM to the bridge, 20 kHz (timer 1)
 *     PA0, PA1     encoder A, B (timer 2)                PB12, PB13   direction to the bridge
 *     PA6          encoder A again (timer 3: period)     PA2          current sensor
 */
#include "../../core/hal.h"
#include "../../core/recorder.h"
#include "registers.h"

#define PWM_TOP 3600u      /* 72 MHz / 20 kHz */
#define STANDING_US 60000u /* below the 65.5 ms after which the 16-bit capture is ambiguous */

/* Change the texts to your bench: supply 12 V, encoder of 500 pulses, 0.4 V/A around 1.65 V. */
static const struct pf_board board = {
    .name = "stm32 motor", .tick_hz = 1000, .watchdog_ms = 300,
    .drive_name = "V", .drive_unit = "V", .drive_scale = "0.0470588235294", .drive_limit = 255,
    .channel_count = 3,
    .channels = {
        {"angle", "rad", "0.00314159265359", "0"},
        {"pulse_period", "us", "1", "0"},
        {"current", "A", "0.00201416015625", "-4.125"}, /* 3.3 V / 4096 / 0.4 V/A; zero at 1.65 V */
    },
};

static uint32_t boot __attribute__((section(".noinit"))); /* by chance after power-on, one more after a reset */
static uint8_t received[256];                             /* filled by DMA in a circle */
static uint8_t taken;
static char waiting[1024];
static volatile uint16_t first, after_last;
static uint32_t us;
static uint16_t us_before, counts_before;
static int32_t counts;
static uint32_t pulse_us, pulse_at;
static uint16_t capture_before;

const struct pf_board *hal_board(void)
{
    return &board;
}

static void clock_begin(void)
{
    FLASH_ACR = 0x12; /* two wait states, prefetch */
    RCC->CR |= 1u << 16;
    while (!(RCC->CR & 1u << 17)) {}
    RCC->CFGR = 7u << 18 | 1u << 16 | 2u << 14 | 4u << 8; /* PLL x9 from the crystal, ADC /6, APB1 /2 */
    RCC->CR |= 1u << 24;
    while (!(RCC->CR & 1u << 25)) {}
    RCC->CFGR |= 2u;
    while ((RCC->CFGR & 0xCu) != 0x8u) {}
    RCC->AHBENR |= 1u;                                                       /* DMA1 */
    RCC->APB2ENR |= 1u << 2 | 1u << 3 | 1u << 9 | 1u << 11 | 1u << 14;       /* ports A, B, ADC1, TIM1, USART1 */
    RCC->APB1ENR |= 1u | 1u << 1 | 1u << 2;                                  /* TIM2, TIM3, TIM4 */
}

static void pins_begin(void)
{
    GPIOB->CRH = (GPIOB->CRH & ~0x00FF0000u) | 0x00220000u; /* PB12, PB13 outputs */
    GPIOA->CRH = (GPIOA->CRH & ~0x00000FFFu) | 0x000004BBu; /* PA8 and PA9 alternate outputs, PA10 input */
    GPIOA->CRL = (GPIOA->CRL & ~0x0F000FFFu) | 0x08000088u; /* PA0, PA1, PA6 inputs with pull-up, PA2 analog */
    GPIOA->BSRR = 1u | 1u << 1 | 1u << 6;
}

static void timers_begin(void)
{
    TIM1->ARR = PWM_TOP - 1;
    TIM1->CCMR1 = 6u << 4 | 1u << 3; /* PWM mode 1, preloaded */
    TIM1->CCER = 1;
    TIM1->BDTR = 1u << 15;
    TIM1->CR1 = 1;
    TIM2->ARR = 0xFFFF;
    TIM2->CCMR1 = 0x6161; /* both inputs, filtered */
    TIM2->SMCR = 3;       /* encoder mode on both edges of both tracks */
    TIM2->CR1 = 1;
    TIM3->PSC = TIM4->PSC = 71; /* 1 MHz */
    TIM3->ARR = TIM4->ARR = 0xFFFF;
    TIM3->CCMR1 = 0x61;
    TIM3->CCER = 1;
    TIM3->EGR = TIM4->EGR = 1; /* load the prescalers */
    TIM3->SR = 0;
    TIM3->CR1 = TIM4->CR1 = 1;
}

static void line_begin_dma(void)
{
    USART1->BRR = 72;
    DMA1_CHANNEL5->CPAR = (uint32_t)(uintptr_t)&USART1->DR;
    DMA1_CHANNEL5->CMAR = (uint32_t)(uintptr_t)received;
    DMA1_CHANNEL5->CNDTR = sizeof received;
    DMA1_CHANNEL5->CCR = 1u << 7 | 1u << 5 | 1u; /* circular, memory forward */
    USART1->CR3 = 1u << 6;
    USART1->CR1 = 1u << 13 | 1u << 3 | 1u << 2;
    NVIC_ISER1 = 1u << (USART1_IRQ - 32u);
}

static void converter_begin(void)
{
    ADC1->SMPR2 = 7u << 6;
    ADC1->SQR3 = 2;
    ADC1->CR2 = 1u << 1 | 1u;
    for (volatile int k = 0; k < 1000; k++) {} /* it needs a microsecond to wake */
    ADC1->CR2 |= 1u;
}

void usart1_interrupt(void)
{
    if (!(USART1->SR & 1u << 7)) return;
    if (first == after_last) {
        USART1->CR1 &= ~(1u << 7);
        return;
    }
    USART1->DR = (uint8_t)waiting[first];
    first = (uint16_t)((first + 1u) % sizeof waiting);
}

uint32_t hal_micros(void)
{
    uint16_t now = (uint16_t)TIM4->CNT; /* asked for at least every round, far more often than it wraps */
    us += (uint16_t)(now - us_before);
    us_before = now;
    return us;
}

uint32_t hal_boot_id(void)
{
    return boot;
}

int hal_receive(void)
{
    uint8_t filled = (uint8_t)(sizeof received - DMA1_CHANNEL5->CNDTR);
    return taken == filled ? -1 : received[taken++];
}

bool hal_send(const char *bytes, uint8_t count)
{
    uint16_t end = after_last, used = (uint16_t)((end + sizeof waiting - first) % sizeof waiting);
    if (used + count >= sizeof waiting) return false;
    for (uint8_t k = 0; k < count; k++) {
        waiting[end] = bytes[k];
        end = (uint16_t)((end + 1u) % sizeof waiting);
    }
    after_last = end;
    USART1->CR1 |= 1u << 7;
    return true;
}

void hal_drive(int16_t raw)
{
    uint32_t size = (uint32_t)(raw < 0 ? -raw : raw);
    if (raw == 0) TIM1->CCR1 = 0;
    GPIOB->BSRR = (raw > 0 ? 1u << 12 : 1u << 28) | (raw < 0 ? 1u << 13 : 1u << 29);
    TIM1->CCR1 = size * PWM_TOP / 255u;
}

/* The 16-bit hardware counters carried on to 32 bits; called in every round. */
static void follow(void)
{
    uint16_t now = (uint16_t)TIM2->CNT;
    counts += (int16_t)(now - counts_before);
    counts_before = now;
    if (TIM3->SR & 2u) {
        uint16_t capture = (uint16_t)TIM3->CCR1; /* reading clears the flag */
        bool known = hal_micros() - pulse_at < STANDING_US;
        pulse_us = known ? (uint16_t)(capture - capture_before) : 0;
        capture_before = capture;
        pulse_at = us;
    }
}

void hal_read(int32_t *raw)
{
    follow();
    raw[0] = counts;
    raw[1] = hal_micros() - pulse_at > STANDING_US ? 0 : (int32_t)pulse_us;
    raw[2] = (int32_t)ADC1->DR;
}

void hal_alive(void)
{
    IWDG->KR = 0xAAAA;
    follow();
}

int main(void)
{
    boot++;
    clock_begin();
    pins_begin();
    timers_begin();
    line_begin_dma();
    converter_begin();
    IWDG->KR = 0x5555;
    IWDG->PR = 3;    /* 40 kHz / 32 */
    IWDG->RLR = 312; /* 250 ms: a program that hangs is reset, and the pins let go of the bridge */
    IWDG->KR = 0xCCCC;
    recorder_start();
    for (;;) recorder_poll();
}
