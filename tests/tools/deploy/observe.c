/* For each line of link angles and velocities, torques, force and voltages: the observation on the way along a path. */

#include <stdio.h>

#include "pter.h"

int main(void)
{
    pter_state state;
    pter_reading r;
    pter_path path = {pter_path_arcs, PTER_ARCS, 0.25};
    pter_real *places[] = {r.angle,      r.angle + 1,  r.velocity,   r.velocity + 1, r.torque,
                           r.torque + 1, r.torque + 2, r.torque + 3, r.force,        r.force + 1};
    float observation[PTER_ENTRIES];
    double number;
    pter_reset(&state);
    for (;;) {
        for (int k = 0; k < 14; k++) {
            if (scanf("%lf%*1[,]", &number) != 1) {
                return 0;
            }
            if (k < 10) {
                *places[k] = (pter_real)number;
            } else {
                state.volts[k - 10] = (float)number;
            }
        }
        pter_observe(&state, &r, &path, observation);
        for (int k = 0; k < PTER_ENTRIES; k++) {
            printf("%.9g%s", observation[k], k == PTER_ENTRIES - 1 ? "\n" : ",");
        }
    }
}
