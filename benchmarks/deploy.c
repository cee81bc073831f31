/* A board around a policy in C, for QEMU's netduinoplus2: a Cortex-M4F (STM32F405) at 168 MHz.

   It measures control steps: the file `rows` holds readings and observations, `out` gets voltages
   and ticks of 168 MHz, then the deepest stack [B]. With -DSERIAL it runs the main of another file,
   such as examples/serial_loop.c, at the serial port. */

#include <stdint.h>

#include "pter.h"

int main(void);
void start(void);

__attribute__((section(".vectors"), used)) static const void *const vectors[] = {
    (void *)0x20020000, /* the stack begins at the end of RAM */
    (void *)start,
};

void start(void)
{
    *(volatile uint32_t *)0xE000ED88 = 0xF << 20; /* turn the floating-point unit on */
    main();
}

#ifdef SERIAL
static volatile uint32_t *const port = (uint32_t *)0x40011000; /* USART1: status, data, -, control */

int serial_get(void)
{
    port[3] = 0x200C; /* on, both ways */
    while (!(port[0] & 0x20));
    return (int)(port[1] & 0xFF);
}

void serial_put(const unsigned char *bytes, int n)
{
    while (n-- > 0) {
        port[1] = *bytes++;
    }
}
#else
static pter_state state;
static struct {
    double reading[10]; /* as in pter_reading */
    float observation[PTER_ENTRIES];
} row;
static struct {
    float volts[4];
    uint32_t observe, act;
} out;

static void step(volatile uint32_t *timer)
{
    pter_path path = {pter_path_arcs, PTER_ARCS, (pter_real)0.25};
    pter_reading reading = {0};
    float observation[PTER_ENTRIES];
    int at[2] = {(int)(1e4 * row.reading[0]), (int)(1e4 * row.reading[1])};
    for (int k = 0; k < 4; k++) {
        reading.torque[k] = (pter_real)row.reading[4 + k];
    }
    uint32_t begin = timer[2];
    pter_encoder(&reading, 0, at[0], at[0] - 9, (pter_real)1e-4, 0);
    pter_encoder(&reading, 1, at[1], at[1] + 9, (pter_real)1e-4, 0);
    pter_observe(&state, &reading, &path, observation);
    uint32_t middle = timer[2];
    pter_act(&state, row.observation, out.volts);
    uint32_t end = timer[2];
    out.observe = (begin - middle) & 0xFFFFFF;
    out.act = (middle - end) & 0xFFFFFF;
}

static int host(int what, const void *arguments) /* semihosting */
{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

int main(void)
{
    volatile uint32_t *timer = (uint32_t *)0xE000E010; /* SysTick: control, reload, present value */
    int rows = host(1, (const void *[]){"rows", (void *)1, (void *)4});
    int to = host(1, (const void *[]){"out", (void *)5, (void *)3});
    volatile unsigned char *top, *deepest;
    __asm__("mov %0, sp" : "=r"(top));
    for (deepest = top - 16384; deepest < top; deepest++) {
        *deepest = 0xA5;
    }
    timer[1] = 0xFFFFFF;
    timer[0] = 5;
    pter_reset(&state);
    while (!host(6, (const void *[]){(void *)rows, &row, (void *)sizeof row})) {
        step(timer);
        host(5, (const void *[]){(void *)to, &out, (void *)sizeof out});
    }
    for (deepest = top - 16384; *deepest == 0xA5; deepest++);
    uint32_t stack = (uint32_t)(top - deepest);
    host(5, (const void *[]){(void *)to, &stack, (void *)sizeof stack});
    return host(0x18, (void *)0x20026);
}
#endif
