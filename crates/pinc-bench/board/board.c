/*
 * Runs the self-test of generated code on an emulated board and says what the measured function, called
 * by it, costs at worst: instructions and stack. The functions to measure are named by macros of the
 * command line; the linker's --wrap leads their calls here.
 */
#include <stdint.h>
#include <stdio.h>

extern uint32_t data_source, data_begin, data_end, bss_begin, bss_end, stack_top;
extern void initialise_monitor_handles(void);
extern int main(void);
extern void _exit(int code) __attribute__((noreturn));

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define FPU_ACCESS (*(volatile uint32_t *)0xE000ED88u)
#define PERIOD 0x1000000u

static volatile uint32_t periods;

static void tick(void)
{
    periods++;
}

static void fault(void)
{
    printf("fault\n");
    fflush(stdout);
    _exit(3);
}

void reset(void);

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))&stack_top, reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0,
    fault, tick};

/* The counter runs down at 25 MHz; QEMU with -icount shift=6 takes 64 ns an instruction. */
static uint64_t now(void)
{
    uint32_t before;
    uint32_t value;
    do {
        before = periods;
        value = SYSTICK_VALUE;
    } while (before != periods);
    return ((uint64_t)before * PERIOD) + (PERIOD - value);
}

/* Of what is measured: the most and the fewest instructions, and the most bytes of stack, of a call. */
typedef struct {
    const char *name;
    uint64_t ticks;
    uint64_t fewest;
    uint32_t stack;
} cost;

#define FILL 0xA5A5A5A5u
#define DEPTH 16384u /* words */

static void fill(volatile uint32_t *top)
{
    uint32_t i;
    for (i = 64; i < DEPTH; i++) {
        *(top - i) = FILL;
    }
}

static void judge(cost *c, volatile uint32_t *top, uint64_t ticks)
{
    uint32_t i = DEPTH - 1;
    while ((i > 64) && (*(top - i) == FILL)) {
        i--;
    }
    if (4 * i > c->stack) {
        c->stack = 4 * i;
    }
    if (ticks > c->ticks) {
        c->ticks = ticks;
    }
    if ((c->fewest == 0) || (ticks < c->fewest)) {
        c->fewest = ticks;
    }
}

#define MEASURE(variable, call)                                                                    \
    do {                                                                                           \
        volatile uint32_t here = 0;                                                                \
        uint64_t begin;                                                                            \
        uint64_t ticks;                                                                            \
        fill(&here);                                                                               \
        begin = now();                                                                             \
        call;                                                                                      \
        ticks = now() - begin;                                                                     \
        judge(&(variable), &here, ticks);                                                          \
    } while (0)

#include "measured.h"

void reset(void)
{
    uint32_t *from = &data_source;
    uint32_t *to;
    int code;
    /* Coprocessors 10 and 11: the floating-point unit. */
    FPU_ACCESS |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    for (to = &data_begin; to < &data_end; to++) {
        *to = *from++;
    }
    for (to = &bss_begin; to < &bss_end; to++) {
        *to = 0;
    }
    initialise_monitor_handles();
    SYSTICK_RELOAD = PERIOD - 1;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7;
    code = main();
    report();
    fflush(stdout);
    _exit(code);
}
