/* The registers of the STM32F103 that hal_stm32.c uses (reference manual RM0008); no vendor header is needed. */
#ifndef PF_REGISTERS_H
#define PF_REGISTERS_H

#include <stdint.h>

struct gpio { volatile uint32_t CRL, CRH, IDR, ODR, BSRR; };
struct rcc { volatile uint32_t CR, CFGR, CIR, APB2RSTR, APB1RSTR, AHBENR, APB2ENR, APB1ENR; };
struct usart { volatile uint32_t SR, DR, BRR, CR1, CR2, CR3; };
struct timer {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1, CCR2, CCR3, CCR4, BDTR;
};
struct adc { volatile uint32_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR; };
struct dma_channel { volatile uint32_t CCR, CNDTR, CPAR, CMAR; };
struct iwdg { volatile uint32_t KR, PR, RLR; };

#define RCC ((struct rcc *)0x40021000u)
#define FLASH_ACR (*(volatile uint32_t *)0x40022000u)
#define GPIOA ((struct gpio *)0x40010800u)
#define GPIOB ((struct gpio *)0x40010C00u)
#define USART1 ((struct usart *)0x40013800u)
#define TIM1 ((struct timer *)0x40012C00u)
#define TIM2 ((struct timer *)0x40000000u)
#define TIM3 ((struct timer *)0x40000400u)
#define TIM4 ((struct timer *)0x40000800u)
#define ADC1 ((struct adc *)0x40012400u)
#define DMA1_CHANNEL5 ((struct dma_channel *)0x40020058u)
#define IWDG ((struct iwdg *)0x40003000u)
#define NVIC_ISER1 (*(volatile uint32_t *)0xE000E104u)
#define USART1_IRQ 37u

#endif
