/* The policy in simavr: voltages for each row of rows.h, as bits in hexadecimal at the serial port. */

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include "pter.h"

static const float rows[][PTER_ENTRIES] = {
#include "rows.h"
};

static void put(char letter)
{
    while (!(UCSR0A & (1 << UDRE0)));
    UDR0 = (uint8_t)letter;
}

int main(void)
{
    static pter_state state;
    UCSR0B = 1 << TXEN0;
    pter_reset(&state);
    for (unsigned row = 0; row < sizeof rows / sizeof *rows; row++) {
        union {
            float volts[4];
            uint32_t bits[4];
        } out;
        pter_act(&state, rows[row], out.volts);
        for (int k = 0; k < 4; k++) {
            for (int shift = 28; shift >= 0; shift -= 4) {
                put("0123456789abcdef"[out.bits[k] >> shift & 15]);
            }
        }
        put('\n');
    }
    cli();
    sleep_enable();
    sleep_cpu(); /* simavr ends */
    return 0;
}
