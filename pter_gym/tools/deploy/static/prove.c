/* What is proven of pter.c: from pter_reset on, for any number of control steps with any counts, readings, pace and
   path of at most PTER_ARCS arcs, another at each step, nothing is undefined and each voltage lies within
   [0, PTER_VOLTAGE_MAX].

       $command

   A volatile variable is any number each time that it is read, NaN and infinities included. */

#include "pter.h"

static volatile int32_t any_count;
static volatile uint32_t any_counter;
static volatile int any_bits, goes_on;
static volatile pter_real any_number;

int main(void)
{
    static pter_real arcs[PTER_ARCS * 7];
    pter_state state;
    for (int k = 0; k < PTER_ARCS * 7; k++) {
        arcs[k] = any_number;
    }
    pter_reset(&state);
    while (goes_on) {
        pter_path path = {arcs, any_count, any_number};
        pter_reading reading;
        float observation[PTER_ENTRIES], volts[4];
        if (path.count > PTER_ARCS) {
            return 0;
        }
        for (int link = 0; link < 2; link++) {
            int bits = any_bits;
            int32_t before = any_count;
            if (bits < 1 || bits > 32) {
                return 0;
            }
            int32_t count = pter_count(before, any_counter, bits);
            pter_encoder(&reading, link, count, before, any_number, any_number);
            reading.force[link] = any_number;
        }
        for (int k = 0; k < 4; k++) {
            reading.torque[k] = any_number;
        }
        pter_observe(&state, &reading, &path, observation);
        pter_act(&state, observation, volts);
        for (int k = 0; k < 4; k++) {
            float voltage = volts[k];
            /*@ assert 0 <= voltage <= PTER_VOLTAGE_MAX; */
            (void)voltage;
        }
    }
    return 0;
}
